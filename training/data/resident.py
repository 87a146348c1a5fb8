"""Shots in the memory of the device that trains, as their files hold them, and batches of them as that device's tensors."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import torch
from torch import Tensor

from training.data.shots import Shot

# How a file holds a pass: its type, and the scale that it is stored at.
STORED = {
    "colour": (torch.float16, 1.0),
    "albedo": (torch.uint8, 255.0),
    "normal": (torch.int8, 127.0),
    "depth": (torch.float16, 1.0),
    "vector": (torch.float16, 1.0),
}


def packed(image: Tensor, kind: torch.dtype, scale: float) -> Tensor:
    """A pass in the type that its file has: what a file gave loses nothing."""
    return image.to(kind) if kind.is_floating_point else (image * scale).round().to(kind)


@dataclass(frozen=True)
class Crop:
    """A square of a frame: its first row and column, and its size."""

    row: int
    column: int
    size: int

    def of(self, images: Tensor) -> Tensor:
        return images[..., self.row : self.row + self.size, self.column : self.column + self.size]


@dataclass
class Pool:
    """N shots of one form: with the same number of frames n, size, and frames that have references.

    passes: name → (N, n, C, H, W) in the type of its file; references (N, R, 3, H, W) of the frames `referenced`; spp (N,).
    """

    referenced: tuple[int, ...]
    passes: dict[str, Tensor]
    references: Tensor
    spp: Tensor
    seeds: list[int]

    def __len__(self) -> int:
        return len(self.seeds)

    @property
    def frames(self) -> int:
        return self.passes["depth"].shape[1]

    @property
    def size(self) -> tuple[int, int]:
        return tuple(self.passes["depth"].shape[-2:])

    def shots(self, index: Tensor, first: int, last: int, crop: Crop | None = None) -> Shot:
        """Frames `first` to `last` of some shots, (B,) on the device, as one batch of shots in single precision."""
        cut = crop.of if crop else lambda x: x
        read = lambda name: cut(self.passes[name][:, first : last + 1])[index].float()
        passes = {name: read(name) if scale == 1.0 else read(name) / scale for name, (_, scale) in STORED.items()}
        inside = [(at, frame) for at, frame in enumerate(self.referenced) if first <= frame <= last]
        references = {frame - first: cut(self.references[:, at])[index] for at, frame in inside}
        return Shot(seed=-1, spp=self.spp[index], references=references, **passes)


@dataclass
class Resident:
    """Shots on a device, in pools of one form each."""

    device: torch.device
    pools: dict[tuple[object, ...], Pool] = field(default_factory=dict)

    def __len__(self) -> int:
        return sum(len(pool) for pool in self.pools.values())

    @property
    def seeds(self) -> list[int]:
        return sorted(seed for pool in self.pools.values() for seed in pool.seeds)

    def add(self, shots: Iterable[Shot]) -> None:
        """Takes shots into the device's memory."""
        found: dict[tuple[object, ...], list[Shot]] = {}
        for shot in shots:
            found.setdefault((*shot.depth.shape, *sorted(shot.references)), []).append(shot)
        for form, alike in found.items():
            more = self.pool_of(alike)
            known = self.pools.get(form)
            self.pools[form] = joined(known, more) if known else more

    def pool_of(self, shots: Sequence[Shot]) -> Pool:
        stacked = lambda images: torch.stack(images).to(self.device)
        passes = {name: stacked([packed(getattr(s, name), *how) for s in shots]) for name, how in STORED.items()}
        referenced = tuple(sorted(shots[0].references))
        references = stacked([torch.stack([s.references[k] for k in referenced]) for s in shots])
        spp = torch.tensor([float(s.spp) for s in shots], device=self.device)
        return Pool(referenced, passes, references, spp, [s.seed for s in shots])


def joined(first: Pool, second: Pool) -> Pool:
    passes = {name: torch.cat((images, second.passes[name])) for name, images in first.passes.items()}
    references, spp = torch.cat((first.references, second.references)), torch.cat((first.spp, second.spp))
    return Pool(first.referenced, passes, references, spp, first.seeds + second.seeds)

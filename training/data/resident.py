"""Shots in the memory of the device that trains, as their files hold them, and batches of them as that device's tensors."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

import torch
from torch import Tensor

from training.data.shots import Shot, Take, read_shot

# How a file holds the passes of a take: the type, and the scale that they are stored at. A part of the light is not in every shot.
STORED = {
    "colour": (torch.float16, 1.0),
    "albedo": (torch.uint8, 255.0),
    "normal": (torch.int8, 127.0),
    "depth": (torch.float16, 1.0),
    "part": (torch.float16, 1.0),
}

TARGETS = ("references", "reference_parts")  # what there is of a shot to learn


def packed(image: Tensor, kind: torch.dtype, scale: float) -> Tensor:
    """A pass in the type that its file has: what a file gave loses nothing."""
    return image.to(kind) if kind.is_floating_point else (image * scale).round().to(kind)


def takes_of(shot: Shot) -> list[Take]:
    return shot.takes or [Take(shot.spp, shot.colour, shot.albedo, shot.normal, shot.depth, shot.part)]


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
    """N shots of one form: with the same number of takes m and frames n, size, and frames that have references.

    passes: name → (N, m, n, C, H, W) in the type of its file; vector (N, n, 4, H, W); references: those of TARGETS that there are, of the
    frames `referenced`, (N, R, 3, H, W); spp (N, m).
    """

    referenced: tuple[int, ...]
    passes: dict[str, Tensor]
    vector: Tensor
    references: dict[str, Tensor]
    spp: Tensor
    seeds: list[int]

    def __len__(self) -> int:
        return len(self.seeds)

    @property
    def takes(self) -> int:
        return self.spp.shape[1]

    @property
    def frames(self) -> int:
        return self.vector.shape[1]

    @property
    def size(self) -> tuple[int, int]:
        return tuple(self.vector.shape[-2:])

    def to(self, device: torch.device) -> Pool:
        passes, references = ({k: images.to(device) for k, images in of.items()} for of in (self.passes, self.references))
        return Pool(self.referenced, passes, self.vector.to(device), references, self.spp.to(device), self.seeds)

    def shots(self, index: Tensor, take: Tensor, first: int, last: int, crop: Crop | None = None) -> Shot:
        """Frames `first` to `last` of some shots, (B,) on the device, and of each a take, (B,), as one batch of shots in f32."""
        cut = crop.of if crop else lambda x: x
        read = lambda name: cut(self.passes[name][:, :, first : last + 1])[index, take].float()
        passes = {name: read(name) if STORED[name][1] == 1.0 else read(name) / STORED[name][1] for name in self.passes}
        inside = [(at, frame) for at, frame in enumerate(self.referenced) if first <= frame <= last]
        of_frames = lambda images: {frame - first: cut(images[:, at])[index] for at, frame in inside}
        targets = {name: of_frames(images) for name, images in self.references.items()}
        vector = cut(self.vector[:, first : last + 1])[index]
        return Shot(seed=-1, spp=self.spp[index, take], vector=vector, **passes, **targets)


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
        self.join(pool_of(shot) for shot in shots)

    def read(self, paths: Iterable[Path], change: Callable[[Shot], Shot | None] | None = None) -> None:
        """Reads shots into the device's memory, each as `change` makes it, without those that it makes nothing of; several at once: most
        of the time goes into inflating their files."""

        def made(path: Path) -> Pool | None:
            shot = change(read_shot(path)) if change else read_shot(path)
            return pool_of(shot) if shot else None

        with ThreadPoolExecutor(os.cpu_count()) as readers:
            self.join(pool for pool in readers.map(made, paths) if pool)

    def join(self, single: Iterable[Pool]) -> None:
        found: dict[tuple[object, ...], list[Pool]] = {}
        for pool in single:
            form = (pool.takes, pool.frames, *pool.size, *pool.referenced, *pool.passes)
            found.setdefault(form, []).append(pool)
        for form, alike in found.items():
            more = joined(alike).to(self.device)
            self.pools[form] = joined([self.pools[form], more]) if form in self.pools else more


def pool_of(shot: Shot) -> Pool:
    """A shot as a pool of one, on the CPU."""
    takes, referenced = takes_of(shot), tuple(sorted(shot.references))
    there = {name: how for name, how in STORED.items() if getattr(shot, name) is not None}
    passes = {name: torch.stack([packed(getattr(t, name), *how) for t in takes])[None] for name, how in there.items()}
    of_frames = lambda images: torch.stack([images[k] for k in referenced])[None]
    references = {name: of_frames(images) for name in TARGETS if (images := getattr(shot, name))}
    spp = torch.tensor([[float(t.spp) for t in takes]])
    return Pool(referenced, passes, shot.vector[None], references, spp, [shot.seed])


def joined(pools: Sequence[Pool]) -> Pool:
    """Pools of one form as one."""
    every = lambda read: torch.cat([read(pool) for pool in pools])
    passes = {name: every(lambda pool, name=name: pool.passes[name]) for name in pools[0].passes}
    references = {name: every(lambda pool, name=name: pool.references[name]) for name in pools[0].references}
    seeds = [seed for pool in pools for seed in pool.seeds]
    return Pool(pools[0].referenced, passes, every(lambda p: p.vector), references, every(lambda p: p.spp), seeds)

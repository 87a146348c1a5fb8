"""Reads the rendered shots and draws the line between training and validation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import torch
from torch import Tensor

from training.shots.shot_file import Stored, load

OFFSETS = (-1, 1, -2, 2)
FARTHEST = 3
PARTS = (0.02, 0.98)  # share of the light that a part must have


@dataclass
class Take:
    """A shot's frames with noise of their own: samples a pixel, and what the renderer gave for them, as in `Shot`."""

    spp: int
    colour: Tensor
    albedo: Tensor
    normal: Tensor
    depth: Tensor
    part: Tensor | None = None


@dataclass
class Shot:
    """The n frames of a shot, 5 or 7; or of a batch of shots, with a leading dimension B in every tensor and spp (B,).

    colour, albedo, normal (n, 3, H, W), depth (n, 1, H, W), vector (n, 4, H, W); references: frame → (3, H, W), the middle one and
    in some shots the one before. takes: the same frames with other noise, of which the first is what colour, albedo, normal, depth and
    spp are; none in shots made by hand. halves: frame → (2, 3, H, W), two independent renders of which the reference is the mean, where
    there are two. reference_albedos: frame → (3, H, W), of the references' samples. part, reference_parts, part_halves: what a part of the
    light gives of colour, references and halves, in shots rendered with two.
    """

    seed: int
    spp: int | Tensor
    colour: Tensor
    albedo: Tensor
    normal: Tensor
    depth: Tensor
    vector: Tensor
    references: dict[int, Tensor]
    meta: dict[str, object] = field(default_factory=dict)
    takes: list[Take] = field(default_factory=list)
    halves: dict[int, Tensor] = field(default_factory=dict)
    reference_albedos: dict[int, Tensor] = field(default_factory=dict)
    part: Tensor | None = None
    reference_parts: dict[int, Tensor] = field(default_factory=dict)
    part_halves: dict[int, Tensor] = field(default_factory=dict)

    def __len__(self) -> int:
        return self.depth.shape[-4]

    @property
    def centre(self) -> int:
        return len(self) // 2

    @property
    def reference(self) -> Tensor:
        return self.references[self.centre]

    def window(self, frame: int, reach: int = FARTHEST) -> list[int]:
        """The offsets of the frame's neighbours that the shot has, at most `reach` away."""
        return [k for k in range(-reach, reach + 1) if k != 0 and 0 <= frame + k < len(self)]

    def of_take(self, number: int) -> Shot:
        """The shot with the frames of one of its takes, and that take alone."""
        t = self.takes[number]
        passes = {name: getattr(t, name) for name in ("spp", "colour", "albedo", "normal", "depth", "part")}
        return replace(self, **passes, takes=[t])


def in_parts(stored: Stored) -> bool:
    """Whether a shot has two parts of light, each with some of it."""
    return stored.part_halves is not None and PARTS[0] < stored.part_halves.mean() / stored.halves.mean() < PARTS[1]


def read_shot(path: Path) -> Shot:
    """Reads a shot of any format (`training/shots/shot_file.py`)."""
    stored = load(path)
    tensor = lambda a: torch.from_numpy(a.copy())
    parted = in_parts(stored)
    part = lambda t: tensor(t.part) if parted else None
    takes = [Take(t.spp, tensor(t.color), tensor(t.albedo), tensor(t.normal), tensor(t.depth)[:, None], part(t)) for t in stored.takes]
    middle = len(stored.vector) // 2
    part_halves = {middle - k: tensor(halves) for k, halves in enumerate(stored.part_halves)} if parted else {}
    halves = {middle - k: tensor(parts) for k, parts in enumerate(stored.halves)}
    t = takes[0]
    return Shot(
        seed=stored.meta["seed"],
        spp=t.spp,
        colour=t.colour,
        albedo=t.albedo,
        normal=t.normal,
        depth=t.depth,
        vector=tensor(stored.vector),
        references={frame: parts.mean(0) for frame, parts in halves.items()},
        meta=stored.meta,
        takes=takes,
        halves={frame: parts for frame, parts in halves.items() if len(parts) == 2},
        reference_albedos={middle - k: tensor(albedo) for k, albedo in enumerate(stored.ref_albedo)},
        part=t.part,
        reference_parts={frame: halves.mean(0) for frame, halves in part_halves.items()},
        part_halves=part_halves,
    )


def is_held(path: Path) -> bool:
    """Whether a shot is for validation: a seed divisible by 8 is never trained on."""
    return int(path.stem) % 8 == 0


def shot_paths(folders: Sequence[Path]) -> list[Path]:
    """The shots of some folders, by seed; one that is in several of them once, of the last."""
    found = {path.stem: path for folder in folders for path in folder.glob("[0-9]*.npz") if path.stem.isdigit()}
    return [found[seed] for seed in sorted(found)]


def held_paths(folders: Sequence[Path]) -> list[Path]:
    """The validation shots of some folders.

    Raises:
        SystemExit: There are none.
    """
    found = [path for path in shot_paths(folders) if is_held(path)]
    if not found:
        raise SystemExit(f"no validation shots in {', '.join(map(str, folders))}: NNNNNN.npz with seeds divisible by 8")
    return found


def read_held(folders: Sequence[Path]) -> list[Shot]:
    """The validation shots of some folders, read; as `held_paths`."""
    return [read_shot(path) for path in held_paths(folders)]

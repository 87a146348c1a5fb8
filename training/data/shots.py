"""Reads the rendered shots, draws the line between training and validation, and turns shots round."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import torch
from torch import Tensor

from training.data.geometry import Chain, chain
from training.shots.shot_file import load

OFFSETS = (-1, 1, -2, 2)
FARTHEST = 3


@dataclass
class Take:
    """A shot's frames with noise of their own: samples a pixel, and what the renderer gave for them, as in `Shot`."""

    spp: int
    colour: Tensor
    albedo: Tensor
    normal: Tensor
    depth: Tensor


@dataclass
class Shot:
    """The n frames of a shot, 5 or 7.

    colour, albedo, normal (n, 3, H, W), depth (n, 1, H, W), vector (n, 4, H, W); references: frame → (3, H, W), the middle one and
    in some shots the one before; paths: (frame, offset) → `geometry.chain`, filled when they are wanted. takes: the same frames with
    other noise, of which the first is what colour, albedo, normal, depth and spp are; none in shots made by hand. halves: frame →
    (2, 3, H, W), two independent renders of which the reference is the mean, where there are two.
    """

    seed: int
    spp: int
    colour: Tensor
    albedo: Tensor
    normal: Tensor
    depth: Tensor
    vector: Tensor
    references: dict[int, Tensor]
    meta: dict[str, object] = field(default_factory=dict)
    paths: dict[tuple[int, int], Chain] = field(default_factory=dict)
    takes: list[Take] = field(default_factory=list)
    halves: dict[int, Tensor] = field(default_factory=dict)

    @property
    def centre(self) -> int:
        return len(self.depth) // 2

    @property
    def reference(self) -> Tensor:
        return self.references[self.centre]

    def path(self, frame: int, offset: int) -> Chain:
        """Where frame's pixels lie in frame + offset."""
        if (frame, offset) not in self.paths:
            vectors = {k - frame: self.vector[k] for k in range(len(self.vector))}
            self.paths[frame, offset] = chain(vectors, offset)
        return self.paths[frame, offset]

    def window(self, frame: int, reach: int = FARTHEST) -> list[int]:
        """The offsets of the frame's neighbours that the shot has, at most `reach` away."""
        return [k for k in range(-reach, reach + 1) if k != 0 and 0 <= frame + k < len(self.depth)]

    def of_take(self, number: int) -> Shot:
        """The shot with the frames of one of its takes, and that take alone."""
        t = self.takes[number]
        return replace(self, spp=t.spp, colour=t.colour, albedo=t.albedo, normal=t.normal, depth=t.depth, takes=[t])


def read_shot(path: Path) -> Shot:
    """Reads a shot of any format (`training/shots/shot_file.py`)."""
    stored = load(path)
    tensor = lambda a: torch.from_numpy(a.copy())
    takes = [Take(t.spp, tensor(t.color), tensor(t.albedo), tensor(t.normal), tensor(t.depth)[:, None]) for t in stored.takes]
    middle = len(stored.vector) // 2
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
    )


def is_held(path: Path) -> bool:
    """Whether a shot is for validation: a seed divisible by 8 is never trained on."""
    return int(path.stem) % 8 == 0


def shot_paths(folders: Sequence[Path]) -> list[Path]:
    return sorted((path for folder in folders for path in folder.glob("[0-9]*.npz") if path.stem.isdigit()), key=lambda p: p.stem)


def read_split(folders: Sequence[Path]) -> tuple[list[Shot], list[Shot]]:
    """Training shots and validation shots of some folders."""
    paths = shot_paths(folders)
    return [read_shot(p) for p in paths if not is_held(p)], [read_shot(p) for p in paths if is_held(p)]


def turned(images: dict[str, Tensor], flip_x: bool, flip_y: bool, transpose: bool) -> dict[str, Tensor]:
    """Images by kind, mirrored; those of kind normal (camera space, y up) and vector (y up) turn with the image."""
    for wanted, dims in ((flip_x, -1), (flip_y, -2)):
        if not wanted:
            continue
        images = {name: torch.flip(x, (dims,)) for name, x in images.items()}
        axis = -1 - dims
        if "normal" in images:
            images["normal"][:, axis] *= -1
        if "vector" in images:
            images["vector"][:, axis] *= -1
            images["vector"][:, axis + 2] *= -1
    if transpose:
        images = {name: x.transpose(-1, -2) for name, x in images.items()}
        if "normal" in images:
            n = images["normal"]
            images["normal"] = torch.stack((-n[:, 1], -n[:, 0], n[:, 2]), 1)
        if "vector" in images:
            v = images["vector"]
            images["vector"] = torch.stack((-v[:, 1], -v[:, 0], -v[:, 3], -v[:, 2]), 1)
    return images


def turned_path(path: Chain, flip_x: bool, flip_y: bool, transpose: bool) -> Chain:
    position, trust, miss = path
    last = position.shape[-1] - 1.0, position.shape[-2] - 1.0
    for wanted, dims in ((flip_x, -1), (flip_y, -2)):
        if wanted:
            position, trust, miss = (torch.flip(x, (dims,)) for x in (position, trust, miss))
            axis = -1 - dims
            position[axis] = last[axis] - position[axis]
    if transpose:
        position, trust, miss = position.transpose(-1, -2).flip(0), trust.transpose(-1, -2), miss.transpose(-1, -2)
    return position, trust, miss


def oriented(shot: Shot, flip_x: bool, flip_y: bool, transpose: bool) -> Shot:
    """The shot mirrored, with all that it has."""
    turn = flip_x, flip_y, transpose
    kinds = ("colour", "albedo", "normal", "depth")
    takes = [Take(t.spp, **turned({kind: getattr(t, kind) for kind in kinds}, *turn)) for t in shot.takes]
    shared = bool(takes) and all(getattr(shot, kind) is getattr(shot.takes[0], kind) for kind in kinds)
    own = {kind: getattr(takes[0], kind) for kind in kinds} if shared else turned({kind: getattr(shot, kind) for kind in kinds}, *turn)
    plain = lambda images: {frame: turned({"image": image}, *turn)["image"] for frame, image in images.items()}
    return replace(
        shot,
        **own,
        vector=turned({"vector": shot.vector}, *turn)["vector"],
        references=plain(shot.references),
        paths={key: turned_path(path, *turn) for key, path in shot.paths.items()},
        takes=takes,
        halves=plain(shot.halves),
    )

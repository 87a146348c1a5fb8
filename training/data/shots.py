"""Reads the rendered shots, draws the line between training and validation, and turns shots round."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from training.data.geometry import Chain, chain

OFFSETS = (-1, 1, -2, 2)
FARTHEST = 3


@dataclass
class Shot:
    """The n frames of a shot, 5 or 7.

    colour, albedo, normal (n, 3, H, W), depth (n, 1, H, W), vector (n, 4, H, W); references: frame → (3, H, W), the middle one and
    in some shots the one before; paths: (frame, offset) → `geometry.chain`, filled when they are wanted.
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


def read_shot(path: Path) -> Shot:
    with np.load(path) as z:
        meta = json.loads(str(z["meta"]))
        image = lambda name: torch.from_numpy(np.moveaxis(z[name].astype(np.float32), -1, -3).copy())
        middle = len(z["depth"]) // 2
        references = {middle: image("ref")} | ({middle - 1: image("ref_before")} if "ref_before" in z else {})
        return Shot(
            seed=meta["seed"],
            spp=meta["spp"],
            colour=image("color"),
            albedo=image("albedo") / 255.0,
            normal=image("normal") / 127.0,
            depth=torch.from_numpy(z["depth"].astype(np.float32))[:, None],
            vector=image("vector"),
            references=references,
            meta=meta,
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


def oriented(shot: Shot, flip_x: bool, flip_y: bool, transpose: bool) -> Shot:
    """The shot mirrored; normals (camera space, y up), vectors (y up) and paths turn with the image."""
    images = [shot.colour, shot.albedo, shot.depth, shot.normal, shot.vector, *shot.references.values()]
    paths = dict(shot.paths)
    high, wide = shot.depth.shape[-2] - 1.0, shot.depth.shape[-1] - 1.0
    for wanted, dims in ((flip_x, -1), (flip_y, -2)):
        if not wanted:
            continue
        images = [torch.flip(x, (dims,)) for x in images]
        axis = -1 - dims
        images[3][:, axis] *= -1
        images[4][:, axis] *= -1
        images[4][:, axis + 2] *= -1
        for key, path in paths.items():
            position, trust, miss = (torch.flip(x, (dims,)) for x in path)
            position[axis] = (wide, high)[axis] - position[axis]
            paths[key] = position, trust, miss
    if transpose:
        images = [x.transpose(-1, -2) for x in images]
        n, v = images[3], images[4]
        images[3] = torch.stack((-n[:, 1], -n[:, 0], n[:, 2]), 1)
        images[4] = torch.stack((-v[:, 1], -v[:, 0], -v[:, 3], -v[:, 2]), 1)
        paths = {k: (p.transpose(-1, -2).flip(0), t.transpose(-1, -2), m.transpose(-1, -2)) for k, (p, t, m) in paths.items()}
    colour, albedo, depth, normal, vector, *references = images
    turned = dict(zip(shot.references, references, strict=True))
    return Shot(shot.seed, shot.spp, colour, albedo, normal, depth, vector, turned, shot.meta, paths)

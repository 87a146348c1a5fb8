"""Reads the rendered shots and draws the line between training and validation."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

OFFSETS = (-1, 1, -2, 2)
FARTHEST = 3


@dataclass
class Shot:
    """The n frames of a shot, 5 or 7; or of a batch of shots, with a leading dimension B in every tensor and spp (B,).

    colour, albedo, normal (n, 3, H, W), depth (n, 1, H, W), vector (n, 4, H, W); references: frame → (3, H, W), the middle one and
    in some shots the one before.
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

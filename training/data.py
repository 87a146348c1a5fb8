"""Reads the rendered shots and turns them into what the network takes."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import torch
from geometry import depth_scale, exposure, neighbour
from torch import Tensor

OFFSETS = (-1, 1, -2, 2)
CENTRE = 2
BRIGHTEST = 1e6


@dataclass
class Shot:
    """The five frames around the middle of a shot.

    colour, albedo, normal (5, 3, H, W), depth (5, 1, H, W), vector (5, 4, H, W), reference (3, H, W).
    """

    seed: int
    spp: int
    colour: Tensor
    albedo: Tensor
    normal: Tensor
    depth: Tensor
    vector: Tensor
    reference: Tensor
    meta: dict[str, object] = field(default_factory=dict)


def read_shot(path: Path) -> Shot:
    with np.load(path) as z:
        meta = json.loads(str(z["meta"]))
        first = len(z["depth"]) // 2 - CENTRE
        middle = slice(first, first + 2 * CENTRE + 1)
        image = lambda pixels: torch.from_numpy(np.moveaxis(pixels.astype(np.float32), -1, -3).copy())
        planes = lambda name: image(z[name][middle])
        return Shot(
            seed=meta["seed"],
            spp=meta["spp"],
            colour=planes("color"),
            albedo=planes("albedo") / 255.0,
            normal=planes("normal") / 127.0,
            depth=torch.from_numpy(z["depth"][middle].astype(np.float32))[:, None],
            vector=planes("vector"),
            reference=image(z["ref"]),
            meta=meta,
        )


def read_split(folder: Path) -> tuple[list[Shot], list[Shot]]:
    """Training shots and validation shots; a seed divisible by 8 is validation and never trained on."""
    paths = sorted(folder.glob("*.npz"))
    train = [read_shot(p) for p in paths if int(p.stem) % 8]
    held = [read_shot(p) for p in paths if int(p.stem) % 8 == 0]
    return train, held


def oriented(shot: Shot, flip_x: bool, flip_y: bool, transpose: bool) -> Shot:
    """The shot mirrored; normals (camera space, y up) and vectors (y up) turn with the image."""
    c, a, n, z, v, r = shot.colour, shot.albedo, shot.normal.clone(), shot.depth, shot.vector.clone(), shot.reference
    turn = lambda x, dims: torch.flip(x, dims)
    if flip_x:
        c, a, n, z, v, r = (turn(x, (-1,)) for x in (c, a, n, z, v, r))
        n[:, 0] *= -1
        v[:, 0] *= -1
        v[:, 2] *= -1
    if flip_y:
        c, a, n, z, v, r = (turn(x, (-2,)) for x in (c, a, n, z, v, r))
        n[:, 1] *= -1
        v[:, 1] *= -1
        v[:, 3] *= -1
    if transpose:
        c, a, n, z, v, r = (x.transpose(-1, -2) for x in (c, a, n, z, v, r))
        n = torch.stack((-n[:, 1], -n[:, 0], n[:, 2]), 1)
        v = torch.stack((-v[:, 1], -v[:, 0], -v[:, 3], -v[:, 2]), 1)
    return Shot(shot.seed, shot.spp, c, a, n, z, v, r, shot.meta)


@dataclass(frozen=True)
class Guides:
    """Which guide passes the network gets to see."""

    albedo: bool = True
    normal: bool = True
    depth: bool = True


ALL_GUIDES = Guides()


def prepare(
    shot: Shot,
    offsets: tuple[int, ...] = OFFSETS,
    guides: Guides = ALL_GUIDES,
    epsilon: float = 0.05,
    valid: Tensor | None = None,
) -> dict[str, Tensor]:
    """One shot's centre frame and neighbours as network tensors, without the batch dimension.

    valid (5, 1, H, W) in {0, 1} marks pixels that may be used; all where it is None.
    """
    frames = (0, *offsets)
    valid = torch.ones_like(shot.depth) if valid is None else valid
    inputs, demodulated, modulation, depths = {}, {}, {}, {}
    scale = {}
    for k in frames:
        i = CENTRE + k
        scale[k] = exposure(shot.colour[i], valid[i, 0])
        albedo = shot.albedo[i].clamp(0, 1)
        modulation[k] = albedo + epsilon if guides.albedo else torch.ones_like(albedo)
        demodulated[k] = shot.colour[i].clamp_min(0) / modulation[k]
        depth = shot.depth[i]
        front = torch.where((depth > 0) & (depth < 1e9), depth, 0.0)
        depths[k] = front * depth_scale(depth, valid[i]) if guides.depth else torch.zeros_like(depth)
        parts = (
            torch.log1p((demodulated[k] * scale[k]).clamp(max=BRIGHTEST)),
            albedo if guides.albedo else torch.zeros_like(albedo),
            shot.normal[i] if guides.normal else torch.zeros_like(shot.normal[i]),
            torch.log1p(depths[k]),
        )
        inputs[k] = torch.cat(parts)
    vectors = {k - CENTRE: shot.vector[k] for k in range(shot.vector.shape[0])}
    around = [
        neighbour(k, vectors, demodulated[k], modulation[k], depths[k], valid[CENTRE + k], (modulation[0], depths[0])) for k in offsets
    ]
    h, w = valid.shape[-2:]
    pick = lambda name, empty: torch.stack([n[name] for n in around]) if around else torch.zeros(0, *empty)
    return {
        "inputs": torch.stack([inputs[k] for k in frames]),
        "colour": torch.cat((demodulated[0][None], pick("colour", (3, h, w)))),
        "albedo": torch.cat((modulation[0][None], pick("albedo", (3, h, w)))),
        "valid": torch.cat((valid[CENTRE][None], pick("valid", (1, h, w)))),
        "position": pick("position", (2, h // 2, w // 2)),
        "extras": pick("extras", (7, h // 2, w // 2)),
        "noisy": shot.colour[CENTRE].clamp_min(0),
        "reference": shot.reference.clamp_min(0),
        "gain": 0.4 / shot.reference.mean().clamp_min(1e-6),
    }


def cropped(batch: dict[str, Tensor], row: int, column: int, size: int) -> dict[str, Tensor]:
    """A square crop; neighbours' samples that fall outside the crop lose their trust."""
    full = (slice(row, row + size), slice(column, column + size))
    half = (slice(row // 2, (row + size) // 2), slice(column // 2, (column + size) // 2))
    out = {k: batch[k][(..., *full)] for k in ("inputs", "colour", "albedo", "valid", "noisy", "reference")}
    out["gain"] = batch["gain"]
    out["extras"] = batch["extras"][(..., *half)].clone()
    position = batch["position"][(..., *half)].clone()
    position[:, 0] -= column // 2
    position[:, 1] -= row // 2
    out["position"] = position
    limit = size // 2 - 1
    lost = (position[:, 0] < -0.5) | (position[:, 0] > limit + 0.5) | (position[:, 1] < -0.5) | (position[:, 1] > limit + 0.5)
    keep = (~lost).float()[:, None]
    out["extras"][:, :6] *= keep
    fine = keep.repeat_interleave(2, -1).repeat_interleave(2, -2)
    out["valid"] = torch.cat((out["valid"][:1], out["valid"][1:] * fine))
    out["colour"] = torch.cat((out["colour"][:1], out["colour"][1:] * fine))
    out["albedo"] = torch.cat((out["albedo"][:1], out["albedo"][1:] * fine))
    return out

"""Shots of noise for the tests, as exact as a shot's file would hold them."""

from __future__ import annotations

import torch
import torch.nn.functional as F
from torch import Tensor

from training.data.resident import STORED, packed
from training.data.shots import Shot, Take


def noise(*shape: int, seed: int = 1) -> Tensor:
    return torch.rand(*shape, generator=torch.Generator().manual_seed(seed))


def stored(name: str, image: Tensor) -> Tensor:
    kind, scale = STORED[name]
    return packed(image, kind, scale).float() / scale


def noisy(count: int, rows: int, columns: int, seed: int) -> dict[str, Tensor]:
    """A take's passes; depth is smooth, with background."""
    n = lambda channels, k: noise(count, channels, rows, columns, seed=10 * seed + k)
    depth = F.interpolate(noise(count, 1, 5, 5, seed=10 * seed + 4), size=(rows, columns), mode="bilinear") * 9 - 1
    passes = {"colour": n(3, 1) * 3, "albedo": n(3, 2), "normal": n(3, 3) * 2 - 1, "depth": depth}
    return {name: stored(name, image) for name, image in passes.items()}


def moving_shot(
    count: int = 7,
    references: tuple[int, ...] = (3, 2),
    rows: int = 32,
    columns: int = 48,
    seed: int = 1,
    takes: int = 1,
    parted: bool = False,
) -> Shot:
    """Noise over smooth vectors that point out of the frame in places; `parted`, with light in two parts."""
    coarse = noise(count, 4, 3, 4, seed=seed + 5) * 12 - 6
    vector = F.interpolate(coarse, size=(rows, columns), mode="bilinear")
    targets = {k: noise(3, rows, columns, seed=seed + 20 + k) for k in references}
    others = [Take(4 * (k + 1), **noisy(count, rows, columns, seed + 100 * k)) for k in range(takes)]
    first = others[0]
    own = first.colour, first.albedo, first.normal, first.depth
    shot = Shot(seed, first.spp, *own, vector, targets, takes=others if takes > 1 else [])
    if parted:
        share = noise(3, rows, columns, seed=seed + 30)
        for of in [shot, *others]:
            of.part = stored("colour", of.colour * share)
        shot.reference_parts = {k: image * share for k, image in targets.items()}
    return shot

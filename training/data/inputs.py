"""What the network takes of a shot: its frames scaled and sanitised, and the neighbours as the centre frame sees them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from training.data.geometry import BRIGHTEST, depth_scale, exposure, neighbour
from training.data.shots import OFFSETS, Shot


@dataclass(frozen=True)
class Guides:
    """Which guide passes the network gets to see."""

    albedo: bool = True
    normal: bool = True
    depth: bool = True


ALL_GUIDES = Guides()


@dataclass
class Frames:
    """What the network takes of each frame by itself: inputs (n, 10, H, W), colour demodulated and albedo plus ε (n, 3, H, W), depth
    scaled (n, 1, H, W), valid (n, 1, H, W), exposure (n,)."""

    inputs: Tensor
    colour: Tensor
    albedo: Tensor
    depth: Tensor
    valid: Tensor
    exposure: Tensor


def frames(shot: Shot, guides: Guides = ALL_GUIDES, epsilon: float = 0.05, valid: Tensor | None = None) -> Frames:
    """The frames of a shot, sanitised and scaled. valid (n, 1, H, W) in {0, 1} marks pixels that may be used; all where it is None."""
    valid = torch.ones_like(shot.depth) if valid is None else valid
    albedo = shot.albedo.clamp(0, 1)
    modulation = albedo + epsilon if guides.albedo else torch.ones_like(albedo)
    colour = shot.colour.clamp_min(0) / modulation
    scale = lambda of: torch.tensor(of).view(-1, 1, 1, 1)
    pairs = lambda planes: zip(planes, valid, strict=True)
    exposures = [exposure(c, v[0]) for c, v in pairs(shot.colour)]
    seen = colour * scale(exposures)
    if guides.depth:
        front = torch.where((shot.depth > 0) & (shot.depth < 1e9), shot.depth, 0.0)
        depth = front * scale([depth_scale(z, v) for z, v in pairs(shot.depth)])
    else:
        depth = torch.zeros_like(shot.depth)
    parts = (
        torch.log1p(seen.clamp(max=BRIGHTEST)),
        albedo if guides.albedo else torch.zeros_like(albedo),
        shot.normal if guides.normal else torch.zeros_like(shot.normal),
        torch.log1p(depth),
    )
    return Frames(torch.cat(parts, 1), colour, modulation, depth, valid, torch.tensor(exposures))


def view(shot: Shot, of: Frames, centre: int, offsets: Sequence[int]) -> dict[str, Tensor]:
    """What `Hush.denoise` takes of one centre frame and its neighbours, without the batch dimension; the target if there is one."""
    around = [
        neighbour(
            shot.path(centre, k), k, of.colour[centre + k], of.albedo[centre + k], of.depth[centre + k], of.valid[centre + k],
            (of.albedo[centre], of.depth[centre]),
        )
        for k in offsets
    ]  # fmt: skip
    h, w = of.valid.shape[-2:]
    pick = lambda name, empty: torch.stack([n[name] for n in around]) if around else torch.zeros(0, *empty)
    made = {
        "colour": torch.cat((of.colour[centre][None], pick("colour", (3, h, w)))),
        "albedo": torch.cat((of.albedo[centre][None], pick("albedo", (3, h, w)))),
        "valid": torch.cat((of.valid[centre][None], pick("valid", (1, h, w)))),
        "position": pick("position", (2, h // 2, w // 2)),
        "extras": pick("extras", (7, h // 2, w // 2)),
        "noisy": shot.colour[centre].clamp_min(0),
        "exposure": of.exposure[centre],
    }
    if centre in shot.references:
        reference = shot.references[centre].clamp_min(0)
        made |= {"reference": reference, "gain": 0.4 / reference.mean().clamp_min(1e-6), "effort": torch.tensor((shot.spp / 8) ** 0.25)}
    return made


def prepare(
    shot: Shot,
    offsets: Sequence[int] = OFFSETS,
    guides: Guides = ALL_GUIDES,
    epsilon: float = 0.05,
    valid: Tensor | None = None,
) -> dict[str, Tensor]:
    """A shot's middle frame and its neighbours as `Hush.forward` takes them, without the batch dimension."""
    of = frames(shot, guides, epsilon, valid)
    order = [shot.centre, *(shot.centre + k for k in offsets)]
    return {"inputs": of.inputs[order], **view(shot, of, shot.centre, offsets)}

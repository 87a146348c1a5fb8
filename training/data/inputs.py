"""What the network takes of a shot: its frames scaled and sanitised, and the neighbours as the centre frame sees them.

`…` stands for any leading dimensions of the shot's tensors: none for one shot, B for a batch on any device.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from training.data.geometry import BRIGHTEST, Chain, chain, depth_scale, exposure, neighbours
from training.data.shots import OFFSETS, Shot


@dataclass(frozen=True)
class Guides:
    """Which guide passes the network gets to see: all shots alike, or a tensor (B,) in {0, 1} for the shots of a batch."""

    albedo: bool | Tensor = True
    normal: bool | Tensor = True
    depth: bool | Tensor = True


ALL_GUIDES = Guides()


@dataclass
class Frames:
    """What the network takes of each frame by itself: inputs (…, n, 10, H, W), colour demodulated and albedo plus ε (…, n, 3, H, W),
    depth scaled (…, n, 1, H, W), valid (…, n, 1, H, W), exposure (…, n)."""

    inputs: Tensor
    colour: Tensor
    albedo: Tensor
    depth: Tensor
    valid: Tensor
    exposure: Tensor


def share(guide: bool | Tensor) -> float | Tensor:
    """1 where a guide is seen, else 0, against (…, n, C, H, W)."""
    return guide.view(-1, 1, 1, 1, 1) if isinstance(guide, Tensor) else float(guide)


def of_frames(images: Tensor, order: Sequence[int]) -> Tensor:
    """Some frames of (…, n, C, H, W), in an order."""
    return torch.stack([images.select(-4, k) for k in order], -4)


def frames(shot: Shot, guides: Guides = ALL_GUIDES, epsilon: float = 0.05, valid: Tensor | None = None) -> Frames:
    """The frames of a shot, sanitised and scaled. valid (…, n, 1, H, W) in {0, 1} marks pixels that may be used; all where it is None."""
    valid = torch.ones_like(shot.depth) if valid is None else valid
    with_albedo, with_normal, with_depth = (share(guide) for guide in (guides.albedo, guides.normal, guides.depth))
    albedo = shot.albedo.clamp(0, 1)
    modulation = (albedo + epsilon) * with_albedo + (1.0 - with_albedo)
    light = shot.colour.clamp_min(0)
    colour = light / modulation
    exposures = exposure(light, valid)
    front = torch.where((shot.depth > 0) & (shot.depth < 1e9), shot.depth, 0.0)
    depth = front * depth_scale(shot.depth, valid)[..., None, None, None] * with_depth
    seen = (colour * exposures[..., None, None, None]).clamp(max=BRIGHTEST)
    inputs = torch.cat((torch.log1p(seen), albedo * with_albedo, shot.normal * with_normal, torch.log1p(depth)), -3)
    return Frames(inputs, colour, modulation, depth, valid, exposures)


def path(shot: Shot, centre: int, offset: int) -> Chain:
    """Where the pixels of frame `centre` lie in frame centre + offset."""
    return chain({k - centre: shot.vector.select(-4, k) for k in range(len(shot))}, offset)


def view(shot: Shot, of: Frames, centre: int, offsets: Sequence[int]) -> dict[str, Tensor]:
    """What `Hush.denoise` takes of one centre frame and its neighbours; the target if there is one."""
    own = {name: getattr(of, name).select(-4, centre) for name in ("colour", "albedo", "depth", "valid")}
    made = {name: own[name].unsqueeze(-4) for name in ("colour", "albedo", "valid")}
    lead, (h, w) = own["valid"].shape[:-3], own["valid"].shape[-2:]
    if offsets:
        paths = [path(shot, centre, k) for k in offsets]
        passes = (of_frames(getattr(of, name), [centre + k for k in offsets]) for name in ("colour", "albedo", "depth", "valid"))
        around = neighbours(paths, offsets, *passes, (own["albedo"], own["depth"]))
        made = {name: torch.cat((image, around[name]), -4) for name, image in made.items()}
        made |= {name: around[name] for name in ("position", "extras")}
    else:
        made |= {name: of.inputs.new_zeros(*lead, 0, maps, h // 2, w // 2) for name, maps in (("position", 2), ("extras", 7))}
    made |= {"noisy": shot.colour.select(-4, centre).clamp_min(0), "exposure": of.exposure[..., centre]}
    if centre in shot.references:
        reference = shot.references[centre].clamp_min(0)
        effort = (torch.as_tensor(shot.spp, dtype=torch.float32) / 8) ** 0.25
        made |= {"reference": reference, "gain": 0.4 / reference.mean((-3, -2, -1)).clamp_min(1e-6), "effort": effort}
    return made


def prepare(
    shot: Shot,
    offsets: Sequence[int] = OFFSETS,
    guides: Guides = ALL_GUIDES,
    epsilon: float = 0.05,
    valid: Tensor | None = None,
) -> dict[str, Tensor]:
    """A shot's middle frame and its neighbours as `Hush.forward` takes them."""
    of = frames(shot, guides, epsilon, valid)
    order = [shot.centre, *(shot.centre + k for k in offsets)]
    return {"inputs": of_frames(of.inputs, order), **view(shot, of, shot.centre, offsets)}

"""Other shots made of shots: turned round, in other colours, one in front of another. All take a shot or a batch of shots."""

from __future__ import annotations

from dataclasses import replace

import torch
import torch.nn.functional as F
from torch import Tensor

from training.data.shots import Shot

TINT = 0.25  # deviation of the logarithm of a channel's tint
RELIT = 1.0  # deviation of the logarithm of what a part of the light is multiplied by
BRIGHTNESS = 0.5  # deviation of the logarithm of the light of a shot behind another, beside equal light
NEAREST, FARTHEST = 0.15, 0.6  # share of a shot's pixels that is put in front of another


def remade(shot: Shot, **changes: object) -> Shot:
    """The shot with changes, which its other takes, its references' halves and its parts of light do not have."""
    return replace(shot, **{"takes": [], "halves": {}, "part": None, "reference_parts": {}, "part_halves": {}, **changes})


def relit(shots: Shot, share: float, generator: torch.Generator) -> Shot:
    """A share of the shots of a batch under other light: each of its two parts in another colour and brightness.

    Light adds up, so noise, guides and target belong together as before. Shots whose light is in one stay.
    """
    if shots.part is None:
        return shots
    b, device = len(shots.colour), shots.colour.device
    normal = lambda *shape: torch.randn(*shape, generator=generator, device=device)
    weights = torch.exp(normal(b, 2, 1) * RELIT + normal(b, 2, 3) * TINT)
    chosen = torch.rand(b, 1, 1, generator=generator, device=device) < share
    weights = torch.where(chosen, weights, 1.0)

    def lit(whole: Tensor, part: Tensor) -> Tensor:
        of_part, of_rest = (weights[:, k].view(b, *[1] * (whole.dim() - 4), 3, 1, 1) for k in range(2))
        return part * of_part + (whole - part) * of_rest

    references = {k: lit(x, shots.reference_parts[k]) for k, x in shots.references.items()}
    return remade(shots, colour=lit(shots.colour, shots.part), references=references)


def flipped(images: Tensor, dim: int, components: tuple[int, ...] = ()) -> Tensor:
    """(…, C, H, W) mirrored along rows or columns, with the sign of some components changed."""
    images = torch.flip(images, (dim,))
    for component in components:
        images.select(-3, component).neg_()
    return images


def exchanged(images: Tensor, components: tuple[tuple[int, float], ...]) -> Tensor:
    """Components of (…, C, H, W) in another order, each times a sign."""
    return torch.stack([images.select(-3, component) * sign for component, sign in components], -3)


def oriented(shot: Shot, flip_x: bool, flip_y: bool, transpose: bool) -> Shot:
    """The shot mirrored; normals (camera space, y up) and vectors (y up) turn with the image."""
    for wanted, axis, dim in ((flip_x, 0, -1), (flip_y, 1, -2)):
        if wanted:
            plain = {name: flipped(getattr(shot, name), dim) for name in ("colour", "albedo", "depth")}
            normal, vector = flipped(shot.normal, dim, (axis,)), flipped(shot.vector, dim, (axis, axis + 2))
            references = {k: flipped(x, dim) for k, x in shot.references.items()}
            shot = remade(shot, **plain, normal=normal, vector=vector, references=references)
    if transpose:
        plain = {name: getattr(shot, name).transpose(-1, -2) for name in ("colour", "albedo", "depth")}
        normal = exchanged(shot.normal.transpose(-1, -2), ((1, -1), (0, -1), (2, 1)))
        vector = exchanged(shot.vector.transpose(-1, -2), ((1, -1), (0, -1), (3, -1), (2, -1)))
        references = {k: x.transpose(-1, -2) for k, x in shot.references.items()}
        shot = remade(shot, **plain, normal=normal, vector=vector, references=references)
    return shot


def recoloured(shots: Shot, generator: torch.Generator) -> Shot:
    """Each shot of a batch with its channels in a random order, and tinted."""
    b, device = len(shots.colour), shots.colour.device
    order = torch.rand(b, 3, generator=generator, device=device).argsort(1)
    tint = torch.exp(torch.randn(b, 3, generator=generator, device=device) * TINT)
    mixed = lambda x: x.gather(-3, order.view(b, *[1] * (x.dim() - 4), 3, 1, 1).expand_as(x))
    tinted = lambda x: mixed(x) * tint.view(b, *[1] * (x.dim() - 4), 3, 1, 1)
    references = {k: tinted(x) for k, x in shots.references.items()}
    return remade(shots, colour=tinted(shots.colour), albedo=mixed(shots.albedo), references=references)


def composed(front: Shot, behind: Shot, generator: torch.Generator) -> Shot:
    """The nearer part of each shot of a batch in front of a shot of another: all that is nearer than a depth drawn at random.

    Every pass and reference of a pixel comes from one of the two, by the depth around that pixel in that frame, so that noise, guides,
    vectors and target belong together; between frames the front hides and uncovers what is behind it. What is behind is moved behind
    that depth, and its light is brought to about the light in front.
    """
    b, n = front.depth.shape[:2]
    rand = lambda: torch.rand(b, generator=generator, device=front.depth.device)
    middle = front.depth[:, n // 2].flatten(1)
    placed = torch.where((middle > 0) & (middle < 1e9), middle, torch.inf).sort(1).values
    at = ((NEAREST + (FARTHEST - NEAREST) * rand()) * placed.shape[1]).long()
    limit = placed.gather(1, at[:, None]).view(b, 1, 1, 1, 1)
    farthest = torch.where(placed.isfinite(), placed, 0.0).amax(1).view_as(limit) * 1.01
    limit = torch.where(limit.isfinite(), limit, farthest)
    nearer = ((front.depth > 0) & (front.depth < limit)).float()
    # By the most of 5×5 pixels: where a surface crosses the depth, noise in it would leave specks.
    most = F.avg_pool2d(nearer.flatten(0, 1), 5, 1, 2, count_include_pad=False).view_as(nearer) > 0.5
    near = most & (front.depth > 0)
    light = lambda shot: torch.stack([x.clamp_min(0).mean((1, 2, 3)) for x in shot.references.values()]).mean(0).clamp_min(1e-6)
    brightness = torch.exp(torch.randn(b, generator=generator, device=front.depth.device) * BRIGHTNESS)
    gain = (light(front) / light(behind) * brightness).view(b, 1, 1, 1, 1)
    moved = torch.where(behind.depth > 0, behind.depth + limit, behind.depth)
    covered = near.float().mean((1, 2, 3, 4))
    return remade(
        front,
        colour=torch.where(near, front.colour, behind.colour * gain),
        albedo=torch.where(near, front.albedo, behind.albedo),
        normal=torch.where(near, front.normal, behind.normal),
        depth=torch.where(near, front.depth, moved),
        vector=torch.where(near, front.vector, behind.vector),
        references={k: torch.where(near[:, k], x, behind.references[k] * gain[:, 0]) for k, x in front.references.items()},
        spp=front.spp * covered + behind.spp * (1 - covered),
    )

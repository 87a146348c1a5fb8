"""λ that varies inside the frame, drawn at random: what training shows the network of λ as a map."""

from __future__ import annotations

import math

import torch
import torch.nn.functional as F
from torch import Tensor

LAMBDA_MAX = 64.0
ORDINARY = 0.65  # of the examples have λ 1
KINDS = 4  # of masks: half-planes, blobs, smooth gradients, what looks like one object
OBJECT = 0.25  # how far albedo and normal of an object may lie from those of the pixel that it is found by


def constants(count: int, generator: torch.Generator) -> Tensor:
    """λ of each example, (B,): 1 in most, else log-uniform in 1…64."""
    rand = lambda: torch.rand(count, generator=generator, device=generator.device)
    return torch.where(rand() < ORDINARY, 1.0, LAMBDA_MAX ** rand())


def objects(albedo: Tensor, normal: Tensor, generator: torch.Generator) -> Tensor:
    """Which pixels are like one that is drawn at random, (B, 1, H, W) in {0, 1}; albedo and normal (B, 3, H, W)."""
    b, _, h, w = albedo.shape
    guides = torch.cat((albedo, 0.5 * normal), 1).flatten(2)
    at = torch.randint(h * w, (b, 1, 1), generator=generator, device=generator.device).expand(b, 6, 1)
    distance = (guides - guides.gather(2, at)).abs().amax(1, keepdim=True)
    return (distance < OBJECT).float().view(b, 1, h, w)


def masks(albedo: Tensor, normal: Tensor, generator: torch.Generator) -> Tensor:
    """A mask for each example, (B, 1, H, W) in 0…1, of a kind drawn at random."""
    b, _, h, w = albedo.shape
    device = generator.device
    rand = lambda *shape: torch.rand(*shape, generator=generator, device=device)
    rows, columns = torch.linspace(-1, 1, h, device=device).view(1, 1, h, 1), torch.linspace(-1, 1, w, device=device).view(1, 1, 1, w)
    angle, shift = rand(b, 1, 1, 1) * 2 * math.pi, rand(b, 1, 1, 1) - 0.5
    half_plane = (columns * torch.cos(angle) + rows * torch.sin(angle) > shift).float()
    coarse = rand(b, 1, 4, 4)
    gradient = F.interpolate(coarse, size=(h, w), mode="bilinear", align_corners=True)
    blobs = (gradient > 0.5).float()
    each = torch.stack((half_plane, blobs, gradient, objects(albedo, normal, generator)))
    kind = torch.randint(KINDS, (b,), generator=generator, device=device)
    return each[kind, torch.arange(b, device=device)]


def maps(constant: Tensor, share: float, albedo: Tensor, normal: Tensor, generator: torch.Generator) -> Tensor:
    """λ by pixel, (B, 1, H, W): `constant` (B,) everywhere, but in a share of the examples mixed with another λ along a mask.

    Mixed as logarithms, in which λ is perceived and given to the network.
    """
    b = len(constant)
    other = LAMBDA_MAX ** torch.rand(b, generator=generator, device=generator.device)
    varies = (torch.rand(b, generator=generator, device=generator.device) < share).view(b, 1, 1, 1)
    mask = masks(albedo, normal, generator) * varies
    first, second = (torch.log2(x).view(b, 1, 1, 1) for x in (constant, other))
    return torch.exp2(first + (second - first) * mask)

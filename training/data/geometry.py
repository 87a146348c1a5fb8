"""Where a pixel of the centre frame lies in its neighbours: chained motion vectors, trust and warping.

The Rust core's `network/warp.rs` follows this file. Positions are (column, row) in pixels of the source frame, rows down. `…` stands for
any leading dimensions: none for one shot, B for a batch on any device.
"""

from __future__ import annotations

from collections.abc import Sequence

import torch
import torch.nn.functional as F
from torch import Tensor

AGREEMENT_LIMIT = 4.0
BRIGHTEST = 1e4  # that the network and the keys tell apart, after exposure
EXTRAS = 7  # maps that go with a neighbour
FIREFLY = 1000.0
Chain = tuple[Tensor, Tensor, Tensor]


def displacements(vector: Tensor) -> tuple[Tensor, Tensor]:
    """Cycles' Vector pass (…, 4, H, W), y up, to displacements (column, row) towards frames t−1 and t+1."""
    x, y, z, w = vector.unbind(-3)
    return torch.stack((x, -y), -3), torch.stack((-z, w), -3)


def grid(h: int, w: int, device: torch.device | None = None) -> Tensor:
    steps = lambda n: torch.arange(n, dtype=torch.float32, device=device)
    rows, columns = torch.meshgrid(steps(h), steps(w), indexing="ij")
    return torch.stack((columns, rows))


def inside(position: Tensor) -> Tensor:
    """(…, 2, H, W) positions to (…, H, W) booleans: within the frame's pixel area, finite."""
    h, w = position.shape[-2:]
    x, y = position.unbind(-3)
    return (x >= -0.5) & (x <= w - 0.5) & (y >= -0.5) & (y <= h - 0.5)


def advance(position: Tensor, displacement: Tensor) -> Tensor:
    """Follow one frame's displacements (…, 2, H, W) from each position, read at the nearest pixel."""
    h, w = displacement.shape[-2:]
    x, y = (position + 0.5).floor().nan_to_num(0.0).unbind(-3)
    index = y.clamp(0, h - 1).long() * w + x.clamp(0, w - 1).long()
    read = displacement.flatten(-2).gather(-1, index.flatten(-2).unsqueeze(-2).expand(*displacement.shape[:-2], -1))
    return position + read.view_as(displacement)


def chain(vectors: dict[int, Tensor], offset: int) -> Chain:
    """Positions (…, 2, H, W) in frame t+offset, trust (…, H, W), and how far the way back misses its start (pixels, at most
    AGREEMENT_LIMIT), (…, H, W).

    vectors: frame offset → Vector pass (…, 4, H, W).
    """
    step = 1 if offset > 0 else -1
    h, w = vectors[0].shape[-2:]
    start = grid(h, w, vectors[0].device)
    position = start
    trust = torch.ones_like(vectors[0][..., 0, :, :], dtype=torch.bool)
    for k in range(0, offset, step):
        back, forth = displacements(vectors[k])
        position = advance(position.expand_as(back), forth if step > 0 else back)
        trust &= inside(position)
    home = position
    for k in range(offset, 0, -step):
        back, forth = displacements(vectors[k])
        home = advance(home, back if step > 0 else forth)
    miss = (home - start).abs().amax(-3).nan_to_num(AGREEMENT_LIMIT).clamp(max=AGREEMENT_LIMIT)
    return position, trust, miss


def exposure(colour: Tensor, valid: Tensor) -> Tensor:
    """The scale that brings a frame's log-average luminance, over 16×16 blocks, to 0.18; 1 for a black frame.

    colour (…, 3, H, W) sanitised; valid (…, 1, H, W) in {0, 1}; returns (…). After OIDN's auto-exposure, with a threshold relative to
    the frame. A block counts at most FIREFLY times what the steadiest light in the frame has: the most that a block has in each of its
    4×4 parts.
    """
    h, w = colour.shape[-2:]
    red, green, blue = colour.unbind(-3)
    luminance = (0.2126 * red + 0.7152 * green + 0.0722 * blue).unsqueeze(-3) * valid
    precise = torch.float32 if colour.device.type == "mps" else torch.float64
    padded = F.pad(torch.cat((luminance, valid), -3).reshape(-1, 2, h, w), (0, -w % 16, 0, -h % 16)).to(precise)
    means = lambda size: (lambda sums: sums[:, :1] / sums[:, 1:].clamp_min(1e-9))(F.avg_pool2d(padded, size))
    counted = F.avg_pool2d(padded[:, 1:], 4) > 0
    least = -F.max_pool2d(-torch.where(counted, means(4), torch.inf), 4)
    steady = torch.where(least.isfinite(), least, 0.0).flatten(1).amax(1, keepdim=True)
    mean = torch.minimum(means(16).flatten(1), torch.where(steady > 0, FIREFLY * steady, torch.inf))
    lit = mean > mean.amax(1, keepdim=True) * 1e-6
    average = torch.where(lit, mean, 1.0).log2().sum(1) / lit.sum(1).clamp_min(1)
    return torch.where(lit.any(1), 0.18 / torch.exp2(average), 1.0).float().reshape(colour.shape[:-3])


def depth_scale(depth: Tensor, valid: Tensor) -> Tensor:
    """One over the mean of a frame's valid depths in front of the background (0 < depth < 1e9); 1 where there are none.

    depth, valid (…, 1, H, W); returns (…).
    """
    front = ((depth > 0) & (depth < 1e9) & (valid > 0)).flatten(-3)
    total = torch.where(front, depth.flatten(-3), 0.0).sum(-1)
    return torch.where(front.any(-1), front.sum(-1) / total.clamp_min(1e-30), 1.0)


def warped(source: Tensor, position: Tensor) -> Tensor:
    """Bilinear samples of (N, C, H, W) at (N, 2, H', W') positions (column, row), clamped to the border."""
    h, w = source.shape[-2:]
    x = position[:, 0] * (2.0 / max(w - 1, 1)) - 1.0
    y = position[:, 1] * (2.0 / max(h - 1, 1)) - 1.0
    grid = torch.stack((x, y), -1)
    return F.grid_sample(source.float(), grid, mode="bilinear", padding_mode="border", align_corners=True).to(source.dtype)


def neighbours(
    paths: Sequence[Chain],
    offsets: Sequence[int],
    colour: Tensor,
    albedo: Tensor,
    depth: Tensor,
    valid: Tensor,
    centre: tuple[Tensor, Tensor],
) -> dict[str, Tensor]:
    """K ≥ 1 neighbours, seen from the centre frame.

    paths: `chain` to each; colour (…, K, 3, H, W) demodulated, albedo (…, K, 3, H, W) plus ε as used to demodulate, depth
    (…, K, 1, H, W) scaled, valid (…, K, 1, H, W): the neighbours'; centre: the centre frame's albedo (…, 3, H, W) and depth. Returns
    warped `colour`, `albedo`, `valid` at full resolution, `position` (…, K, 2, h, w) and `extras` (…, K, EXTRAS, h, w) at half.
    """
    position, trust, miss = (torch.stack(parts, dim) for parts, dim in zip(zip(*paths, strict=True), (-4, -3, -3), strict=True))
    lead, (h, w) = trust.shape[:-2], trust.shape[-2:]
    safe = position.nan_to_num(0.0)
    source = torch.cat((colour, albedo, depth, 1.0 - valid), -3)
    sampled = warped(source.reshape(-1, 8, h, w), safe.reshape(-1, 2, h, w)).view(*lead, 8, h, w)
    trusted = (trust & (sampled[..., 7, :, :] == 0)).float().unsqueeze(-3)
    sampled = sampled * trusted
    a0, z0 = (x.unsqueeze(-4) for x in centre)
    albedo_miss = (sampled[..., 3:6, :, :] - a0).abs() * trusted
    depth_miss = (torch.log1p(sampled[..., 6:7, :, :]) - torch.log1p(z0)).abs().clamp(max=1.0) * trusted
    distance = torch.cat([torch.full_like(trusted[..., :1, :, :, :], abs(k) / 2) for k in offsets], -4)
    maps = torch.cat((trusted, albedo_miss, depth_miss, miss.unsqueeze(-3) / AGREEMENT_LIMIT * trusted, distance), -3)
    moved = (safe - grid(h, w, safe.device))[..., ::2, ::2]
    return {
        "colour": sampled[..., :3, :, :],
        "albedo": sampled[..., 3:6, :, :],
        "valid": trusted,
        "position": grid(h // 2, w // 2, safe.device) + moved * 0.5,
        "extras": F.avg_pool2d(maps.reshape(-1, EXTRAS, h, w), 2).view(*lead, EXTRAS, h // 2, w // 2),
    }

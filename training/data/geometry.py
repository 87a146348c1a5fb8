"""Where a pixel of the centre frame lies in its neighbours: chained motion vectors, trust and warping.

The Rust core's `network/warp.rs` follows this file. Positions are (column, row) in pixels of the source frame, rows down.
"""

from __future__ import annotations

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


def grid(h: int, w: int) -> Tensor:
    rows, columns = torch.meshgrid(torch.arange(h, dtype=torch.float32), torch.arange(w, dtype=torch.float32), indexing="ij")
    return torch.stack((columns, rows))


def inside(position: Tensor) -> Tensor:
    """(2, H, W) positions to (H, W) booleans: within the frame's pixel area, finite."""
    h, w = position.shape[-2:]
    x, y = position[0], position[1]
    return (x >= -0.5) & (x <= w - 0.5) & (y >= -0.5) & (y <= h - 0.5)


def advance(position: Tensor, displacement: Tensor) -> Tensor:
    """Follow one frame's displacements (2, H, W) from each position, read at the nearest pixel."""
    h, w = displacement.shape[-2:]
    x = (position[0] + 0.5).floor().nan_to_num(0.0).clamp(0, w - 1).long()
    y = (position[1] + 0.5).floor().nan_to_num(0.0).clamp(0, h - 1).long()
    return position + displacement[:, y, x]


def chain(vectors: dict[int, Tensor], offset: int) -> Chain:
    """Positions in frame t+offset, trust, and how far the way back misses its start (pixels, at most AGREEMENT_LIMIT).

    vectors: frame offset → Vector pass (4, H, W).
    """
    step = 1 if offset > 0 else -1
    h, w = vectors[0].shape[-2:]
    start = grid(h, w)
    position = start
    trust = torch.ones(h, w, dtype=torch.bool)
    for k in range(0, offset, step):
        back, forth = displacements(vectors[k])
        position = advance(position, forth if step > 0 else back)
        trust &= inside(position)
    home = position
    for k in range(offset, 0, -step):
        back, forth = displacements(vectors[k])
        home = advance(home, back if step > 0 else forth)
    miss = (home - start).abs().amax(0).nan_to_num(AGREEMENT_LIMIT).clamp(max=AGREEMENT_LIMIT)
    return position, trust, miss


def exposure(colour: Tensor, valid: Tensor) -> float:
    """The scale that brings a frame's log-average luminance, over 16×16 blocks, to 0.18; 1 for a black frame.

    colour (3, H, W) sanitised; valid (H, W) in {0, 1}. After OIDN's auto-exposure, with a threshold relative to the frame. A block
    counts at most FIREFLY times what the steadiest light in the frame has: the most that a block has in each of its 4×4 parts.
    """
    luminance = (0.2126 * colour[0] + 0.7152 * colour[1] + 0.0722 * colour[2]) * valid
    h, w = luminance.shape
    padded = F.pad(torch.stack((luminance, valid))[:, None], (0, -w % 16, 0, -h % 16)).double()
    means = lambda size: (lambda sums: sums[0] / sums[1].clamp_min(1e-9))(F.avg_pool2d(padded, size))
    counted = F.avg_pool2d(padded[1], 4) > 0
    least = -F.max_pool2d(-torch.where(counted, means(4), torch.inf), 4)
    steady = float(torch.where(least.isfinite(), least, 0.0).max())
    mean = means(16).clamp(max=FIREFLY * steady if steady > 0 else torch.inf)
    lit = mean[mean > mean.max() * 1e-6]
    if lit.numel() == 0:
        return 1.0
    return float(0.18 / torch.exp2(torch.log2(lit).mean()))


def depth_scale(depth: Tensor, valid: Tensor) -> float:
    """One over the mean of a frame's valid depths in front of the background (0 < depth < 1e9); 1 where there are none."""
    front = depth[(depth > 0) & (depth < 1e9) & (valid > 0)]
    return float(1.0 / front.mean()) if front.numel() else 1.0


def warped(source: Tensor, position: Tensor) -> Tensor:
    """Bilinear samples of (N, C, H, W) at (N, 2, H', W') positions (column, row), clamped to the border."""
    h, w = source.shape[-2:]
    x = position[:, 0] * (2.0 / max(w - 1, 1)) - 1.0
    y = position[:, 1] * (2.0 / max(h - 1, 1)) - 1.0
    grid = torch.stack((x, y), -1)
    return F.grid_sample(source.float(), grid, mode="bilinear", padding_mode="border", align_corners=True).to(source.dtype)


def neighbour(
    path: Chain, offset: int, colour: Tensor, albedo: Tensor, depth: Tensor, valid: Tensor, centre: tuple[Tensor, Tensor]
) -> dict[str, Tensor]:
    """One neighbour, seen from the centre frame.

    path: `chain` to it; colour (3, H, W) demodulated, albedo (3, H, W) plus ε as used to demodulate, depth (1, H, W) scaled, valid
    (1, H, W): the neighbour's; centre: the centre frame's albedo and depth. Returns warped `colour`, `albedo`, `valid` at full resolution,
    `position` (2, h, w) and `extras` (EXTRAS, h, w) at half resolution.
    """
    position, trust, miss = path
    safe = position.nan_to_num(0.0)
    source = torch.cat((colour, albedo, depth, 1.0 - valid))[None]
    sampled = warped(source, safe[None])[0]
    trusted = (trust & (sampled[7] == 0)).float()[None]
    sampled = sampled * trusted
    a0, z0 = centre
    albedo_miss = (sampled[3:6] - a0).abs() * trusted
    depth_miss = (torch.log1p(sampled[6:7]) - torch.log1p(z0)).abs().clamp(max=1.0) * trusted
    distance = torch.full_like(trusted, abs(offset) / 2)
    maps = torch.cat((trusted, albedo_miss, depth_miss, miss[None] / AGREEMENT_LIMIT * trusted, distance))
    h, w = trusted.shape[-2:]
    start = grid(h // 2, w // 2)
    half = start + (safe - grid(h, w))[:, ::2, ::2] * 0.5
    return {
        "colour": sampled[:3],
        "albedo": sampled[3:6],
        "valid": trusted,
        "position": half,
        "extras": F.avg_pool2d(maps[None], 2)[0],
    }

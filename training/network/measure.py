"""Scores of a network on shots in a device's memory: what training prints at every checkpoint, and export writes beside the weights."""

from __future__ import annotations

import math
from collections.abc import Sequence

import torch
import torch.nn.functional as F
from torch import Tensor

from training.data.batches import Batch, looked_at
from training.data.inputs import ALL_GUIDES
from training.data.resident import Pool, Resident
from training.data.shots import OFFSETS
from training.network.loss import rel_mse, smape
from training.network.model import Hush
from training.network.objective import Output, changes, demodulated, denoised

Scores = dict[str, float]
Sample = list[tuple[Pool, Tensor]]
WINDOWS: tuple[tuple[int, tuple[int, ...]], ...] = ((2, OFFSETS), (0, ()))
PIXELS = 8 * 128**2  # of the shots that are denoised at once


def everything(shots: Resident) -> Sample:
    """All shots, as `scores` takes them."""
    return [(pool, torch.arange(len(pool), device=shots.device)) for pool in shots.pools.values()]


def sample(shots: Resident, count: int) -> Sample:
    """About `count` shots, the same at every call as long as none come: evenly out of each pool."""
    share = min(1.0, count / max(1, len(shots)))
    step = lambda pool: torch.linspace(0, len(pool) - 1, max(1, round(share * len(pool))), device=shots.device).round().long()
    return [(pool, step(pool)) for pool in shots.pools.values()]


def of_shots(out: Output, batch: Batch) -> dict[str, Tensor]:
    """Scores of each shot's middle frame, (B,), its reference scaled to mean 0.4."""
    seen = batch.views[0]
    gain = seen["gain"].view(-1, 1, 1, 1)
    image, reference = out["image"] * gain, seen["reference"] * gain
    half = F.avg_pool2d(demodulated(seen) * gain, 2)
    each = {
        "smape": smape(image, reference),
        "relmse": rel_mse(image, reference),
        "blocks": smape(F.avg_pool2d(image, 4), F.avg_pool2d(reference, 4)),
        "half": smape(out["half"] * gain, half),
        "quarter": smape(out["quarter"] * gain, F.avg_pool2d(half, 2)),
    }
    return {name: value.mean((1, 2, 3)) for name, value in each.items()}


def chunks(pool: Pool, index: Tensor) -> list[Tensor]:
    """Parts of one size, so that every part has one shape; the last one's repetitions are left out of its scores."""
    size = min(len(index), max(1, PIXELS // math.prod(pool.size)))
    return [index[at : at + size] for at in range(0, len(index), size)]


@torch.no_grad()
def scores(net: Hush, shots: Sample, windows: Sequence[tuple[int, tuple[int, ...]]] = WINDOWS, bf16: bool = False) -> Scores:
    """Means over the shots' middle frames at λ 1, by window: `smape_2`, `smape_0` …

    smape; relmse, geometric, for a few fireflies decide the other mean; blocks: SMAPE of means over 4×4 pixels, in which the references'
    own noise counts less; half, quarter: SMAPE of the demodulated levels; flicker: of the shots with two references in a row, over all
    pixels: those whose way back leaves the frame count as 0, `hush eval` leaves them out.
    """
    found: dict[str, list[Tensor]] = {}
    for pool, index in shots:
        for part in chunks(pool, index):
            whole = torch.cat((part, part[-1:].expand(len(chunks(pool, index)[0]) - len(part))))
            shot = pool.shots(whole, torch.zeros_like(whole), 0, pool.frames - 1)
            centre = pool.frames // 2
            paired = centre - 1 in pool.referenced
            for window, offsets in windows:
                centres = [centre, centre - 1] if paired and offsets else [centre]
                batch = looked_at(shot, ALL_GUIDES, centres, offsets, net.arch.albedo_epsilon)
                with torch.autocast(whole.device.type, torch.bfloat16, enabled=bf16):
                    out = denoised(net, batch)
                values = of_shots(out[0], batch)
                if len(out) > 1:
                    values["flicker"] = changes(out, batch.views).mean((1, 2, 3))
                for name, value in values.items():
                    found.setdefault(f"{name}_{window}", []).append(value[: len(part)])
    joined = {name: torch.cat(parts).double() for name, parts in found.items()}
    mean = lambda name, x: x.clamp_min(1e-12).log().mean().exp() if name.startswith("relmse") else x.mean()
    return {name: float(mean(name, x)) for name, x in joined.items()}

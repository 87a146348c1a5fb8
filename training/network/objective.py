"""What training minimises: the loss of a batch's denoised frames, and of what changes between two frames in a row."""

from __future__ import annotations

from dataclasses import dataclass

import torch.nn.functional as F
from torch import Tensor

from training.data.batches import Batch, View
from training.data.geometry import warped
from training.data.inputs import of_frames
from training.network.loss import BLOCK, asymmetric, by_pixel, fireflies, flicker, smape
from training.network.model import Hush

Output = dict[str, Tensor]


@dataclass(frozen=True)
class Shares:
    """Shares of the further terms beside the asymmetric loss of the final image."""

    half: float = 0.1  # SMAPE of the demodulated half level
    quarter: float = 0.05  # SMAPE of the demodulated quarter level
    blotches: float = 0.1  # SMAPE of the final image's means over squares, of each of SQUARES
    fireflies: float = 1.0  # log1p of relMSE by squares
    temporal: float = 0.75  # flicker of two frames in a row


SHARES = Shares()
# Sides of the squares whose means are looked at: what varies slowly, and whether light gets lost, drowns in the noise of single pixels.
SQUARES = (2, 4, 8, 16)


def demodulated(view: View) -> Tensor:
    """The reference without its albedo, (B, 3, H, W): what the levels of the pyramid approximate."""
    return view["reference"] / view["albedo"][:, 0]


def evened(lam: Tensor) -> Tensor:
    """What the terms that know λ are weighted by so that no λ outweighs the others, 2 / (1 + √λ), against images."""
    return 2.0 / (1.0 + by_pixel(lam).sqrt())


def still_loss(out: Output, view: View, lam: Tensor, shares: Shares = SHARES) -> Tensor:
    """The loss of one frame, on images scaled so that the reference's mean is 0.4; lam (B,) or (B, 1, H, W).

    The asymmetric loss and the fireflies are `evened`. Shots of many samples, whose errors are small, count more.
    """
    gain = view["gain"].view(-1, 1, 1, 1)
    image, reference, noisy = out["image"] * gain, view["reference"] * gain, view["noisy"] * gain
    effort = view["effort"].view(-1, 1, 1, 1)
    weight = evened(lam)
    total = (asymmetric(image, reference, noisy, lam) * weight * effort).mean()
    base = demodulated(view) * gain
    for level, share in (("half", shares.half), ("quarter", shares.quarter)):
        base = F.avg_pool2d(base, 2)
        total = total + share * (smape(out[level] * gain, base) * effort).mean()
    for side in SQUARES:
        total = total + shares.blotches * (smape(F.avg_pool2d(image, side), F.avg_pool2d(reference, side)) * effort).mean()
    weight = F.avg_pool2d(weight, BLOCK) if lam.dim() > 1 else weight
    return total + shares.fireflies * (fireflies(image, reference) * weight * effort).mean()


def changes(out: list[Output], views: list[View]) -> Tensor:
    """`loss.flicker` of two frames in a row, (B, 3, H, W)."""
    gain = views[0]["gain"].view(-1, 1, 1, 1)
    now, before = ((o["image"] * gain, v["reference"] * gain) for o, v in zip(out, views, strict=True))
    return flicker(*now, warped(before[0] - before[1], views[0]["before"]), views[0]["followed"])


def temporal_loss(out: list[Output], views: list[View], lam: Tensor) -> Tensor:
    """1 / λ of the flicker: what noise is left to be seen flickers too."""
    return (changes(out, views) / by_pixel(lam)).mean()


def denoised(net: Hush, batch: Batch) -> list[Output]:
    """The network's results for each of a batch's views."""
    features = net.encode(batch.inputs)
    frames = len(batch.inputs[0])
    of_view = lambda order: features if order == list(range(frames)) else of_frames(features, order)
    return [net.denoise(of_view(order), seen, batch.lam) for order, seen in zip(batch.orders, batch.views, strict=True)]


def objective(net: Hush, batch: Batch, shares: Shares = SHARES) -> Tensor:
    """The loss of a batch: the mean of its frames', and the temporal loss where there are two."""
    out = denoised(net, batch)
    total = sum(still_loss(o, v, batch.lam, shares) for o, v in zip(out, batch.views, strict=True)) / len(batch.views)
    return total + shares.temporal * temporal_loss(out, batch.views, batch.lam) if len(batch.views) > 1 else total

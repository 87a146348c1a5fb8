"""References of few samples, denoised by trained weights before another network learns from them.

A reference's noise is not only noise in the gradients. The losses are about medians, and what a few samples give is skewed: below its mean
for the most part, far above it now and then. So a network that learns from noisy references learns to darken.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import torch
from torch import Tensor

from training.data.batches import looked_at
from training.data.inputs import ALL_GUIDES
from training.data.resident import takes_of
from training.data.shots import Shot
from training.network import fused
from training.network.objective import denoised
from training.network.weights_file import Trained

ENOUGH = 1024  # samples from which on a reference is better than what is made of it
TIMES = 8  # as many samples as the noisy frames it must have, or what is made of it is hardly better than what is to be learnt
UNSAID = 256  # samples of the references of files that do not say


def samples(shot: Shot) -> float:
    """The samples a pixel of a shot's references, both halves."""
    said = shot.meta.get("reference", UNSAID)
    return 2 * said[0] if isinstance(said, list) else said


def is_worth_learning(shot: Shot) -> bool:
    """Whether its references have enough samples beside its noisy frames."""
    return samples(shot) >= TIMES * max(take.spp for take in takes_of(shot))


class ReferenceDenoiser:
    """Denoises the references of training shots, at λ 1, each with the other as its neighbour where there are two."""

    def __init__(self, weights: Path, in_c: bool) -> None:
        """in_c: apply the kernels in C++, which wants g++."""
        self.net = Trained.read(weights).network().requires_grad_(False)
        if in_c:
            self.net.average = fused.average

    def __call__(self, shot: Shot) -> Shot | None:
        """The shot with other references, where they have fewer samples than `ENOUGH`; None where it teaches nothing."""
        if samples(shot) >= ENOUGH:
            return shot
        if not is_worth_learning(shot):
            return None
        frames = sorted(shot.references)
        return replace(shot, references={frame: self.denoised(shot, frames, frame) for frame in frames})

    @torch.no_grad()
    def denoised(self, shot: Shot, frames: list[int], frame: int) -> Tensor:
        """One reference, (3, H, W)."""
        colour = torch.stack([shot.references[k] for k in frames])
        albedo = torch.stack([shot.reference_albedos.get(k, shot.albedo[k]) for k in frames])
        passes = (colour, albedo, *(getattr(shot, name)[frames] for name in ("normal", "depth", "vector")))
        alone = Shot(shot.seed, torch.ones(1), *(images[None] for images in passes), {})
        offsets = (-1,) if len(frames) > 1 else ()
        batch = looked_at(alone, ALL_GUIDES, [frames.index(frame)], offsets, self.net.arch.albedo_epsilon)
        return denoised(self.net, batch)[0]["image"][0]

"""References of few samples, denoised by trained weights before another network learns from them.

A reference's noise is not only noise in the gradients. The losses are about medians, and what a few samples give is skewed: below its mean
for the most part, far above it now and then. So a network that learns from noisy references learns to darken. And from denoised ones it
learns to blur what was blurred there: so where a reference's halves say that it is better as rendered, it stays so.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import torch
import torch.nn.functional as F
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
Images = dict[int, Tensor]  # of frames
SIDE = 5  # of the squares that the noise is measured over
DARK = 0.06  # of a reference's mean, that relative errors are over at least
UNKNOWN = 0.5  # share of the denoised one in references without halves


def samples(shot: Shot) -> float:
    """The samples a pixel of a shot's references, both halves."""
    said = shot.meta.get("reference", UNSAID)
    return 2 * said[0] if isinstance(said, list) else said


def is_worth_learning(shot: Shot) -> bool:
    """Whether its references have enough samples beside its noisy frames."""
    return samples(shot) >= TIMES * max(take.spp for take in takes_of(shot))


def mixed(rendered: Tensor, denoised: Tensor, halves: Tensor | None) -> Tensor:
    """The best of a reference as rendered and denoised, (3, H, W), by the two renders that it is the mean of, (2, 3, H, W).

    What denoising changes is the noise and what it wrongly takes away. The mean square of the change, relative and over SIDE² pixels,
    is both; a quarter of that of the halves' difference is the noise. So much of the change is made as the noise has of it (Wiener).
    """
    if halves is None:
        return UNKNOWN * denoised + (1 - UNKNOWN) * rendered
    smooth = lambda image: F.avg_pool2d(image[None], SIDE, 1, SIDE // 2, count_include_pad=False)[0]
    scale = (smooth(denoised.abs()) + DARK * denoised.abs().mean()).clamp_min(1e-12)
    power = lambda image: smooth((image / scale).square()).mean(0, keepdim=True)
    noise, change = power(halves[0] - halves[1]) / 4, power(denoised - rendered)
    return rendered + (noise / change.clamp_min(1e-12)).clamp_max(1) * (denoised - rendered)


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
        if not shot.reference_parts:
            return replace(shot, references=self.best(shot, shot.references, shot.halves))
        part = self.best(shot, shot.reference_parts, shot.part_halves)
        without = lambda whole, part: {frame: image - part[frame] for frame, image in whole.items()}
        rest = self.best(shot, without(shot.references, shot.reference_parts), without(shot.halves, shot.part_halves))
        return replace(shot, references={frame: image + rest[frame] for frame, image in part.items()}, reference_parts=part)

    def best(self, shot: Shot, references: Images, halves: Images) -> Images:
        """All of a shot's references, or a part of their light."""
        return {k: mixed(image, self.denoised(shot, references, k), halves.get(k)) for k, image in references.items()}

    @torch.no_grad()
    def denoised(self, shot: Shot, references: Images, frame: int) -> Tensor:
        """One of them, (3, H, W)."""
        frames = sorted(references)
        colour = torch.stack([references[k].clamp_min(0) for k in frames])
        albedo = torch.stack([shot.reference_albedos.get(k, shot.albedo[k]) for k in frames])
        passes = (colour, albedo, *(getattr(shot, name)[frames] for name in ("normal", "depth", "vector")))
        alone = Shot(shot.seed, torch.ones(1), *(images[None] for images in passes), {})
        offsets = (-1,) if len(frames) > 1 else ()
        batch = looked_at(alone, ALL_GUIDES, [frames.index(frame)], offsets, self.net.arch.albedo_epsilon)
        return denoised(self.net, batch)[0]["image"][0]

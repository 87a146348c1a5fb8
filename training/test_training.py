"""Tests of the training code, in its own environment: python -m pytest training"""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from training.benchmark import ablate
from training.benchmark.unbiased import relmse
from training.data.inputs import frames, prepare, view
from training.data.shots import OFFSETS, Shot
from training.network.loss import flicker
from training.network.model import Architecture, Hush

torch.set_num_threads(1)
ROWS, COLUMNS = 24, 40


def noise(*shape: int, seed: int = 1) -> Tensor:
    return torch.rand(*shape, generator=torch.Generator().manual_seed(seed))


def moving_shot(count: int = 7, references: tuple[int, ...] = (3, 2)) -> Shot:
    """Noise over smooth vectors that point out of the frame in places."""
    n = lambda channels, seed: noise(count, channels, ROWS, COLUMNS, seed=seed)
    vector = torch.nn.functional.interpolate(noise(count, 4, 3, 4, seed=5) * 12 - 6, size=(ROWS, COLUMNS), mode="bilinear")
    targets = {k: noise(3, ROWS, COLUMNS, seed=20 + k) for k in references}
    return Shot(1, 4, n(3, 1) * 3, n(3, 2), n(3, 3) * 2 - 1, n(1, 4) * 9 - 1, vector, targets)


def test_a_view_of_the_middle_is_what_prepare_gives() -> None:
    shot = moving_shot()
    whole, of = prepare(shot), frames(shot)
    part = view(shot, of, shot.centre, OFFSETS)
    assert all(torch.equal(whole[k], part[k]) for k in part)
    assert torch.equal(whole["inputs"], of.inputs[[3, 2, 4, 1, 5]])


def test_a_network_without_trust_in_its_neighbours_is_the_window_of_zero() -> None:
    net, shot = Hush(Architecture(features=8, half=8, quarter=8, eighth=8)), moving_shot()
    batch = {k: v[None] for k, v in prepare(shot).items()}
    batch["extras"][:, :, :1] = 0
    batch["valid"][:, 1:] = 0
    alone = {k: v[None] for k, v in prepare(shot, ()).items()}
    lam = torch.ones(1)
    torch.testing.assert_close(net(batch, lam)["image"], net(alone, lam)["image"])


def test_the_noise_of_two_references_averages_out_of_the_error() -> None:
    r = np.random.default_rng(1)
    truth = (0.3 + 0.2 * r.random((200, 200, 3))).astype(np.float32)
    noisy = lambda: (truth + 0.03 * r.standard_normal(truth.shape)).astype(np.float32)
    denoised = truth * 1.05
    exact, found = relmse(denoised, (truth, truth), truth), relmse(denoised, (noisy(), noisy()), truth)
    single = noisy()
    assert abs(found / exact - 1) < 0.05
    assert relmse(denoised, (single, single), truth) > 2 * exact


def test_what_is_left_out_has_no_effect() -> None:
    torch.manual_seed(1)
    net = Hush(Architecture(features=8, half=8, quarter=8, eighth=8))
    batch = {k: v[None] for k, v in prepare(moving_shot()).items()}
    other = batch | {"colour": torch.cat((batch["colour"][:, :1], 1 - batch["colour"][:, 1:]), 1)}
    assert (net(batch, torch.ones(1))["image"] - net(other, torch.ones(1))["image"]).abs().max() > 1e-3
    ablate.neighbour_taps(net)
    torch.testing.assert_close(net(batch, torch.ones(1))["image"], net(other, torch.ones(1))["image"])
    assert (net(batch, torch.ones(1))["albedo"] - batch["albedo"][:, 0]).abs().max() > 1e-3
    ablate.own_albedo(net)
    torch.testing.assert_close(net(batch, torch.ones(1))["albedo"], batch["albedo"][:, 0])


def test_flicker_is_nothing_where_the_error_moves_along() -> None:
    reference, error = noise(1, 3, 8, 8, seed=1), noise(1, 3, 8, 8, seed=2)
    followed = torch.ones(1, 1, 8, 8)
    assert flicker(reference + error, reference, error, followed).max() < 1e-6
    assert flicker(reference + error, reference, -error, followed).mean() > 0.1
    assert flicker(reference + error, reference, -error, 0 * followed).max() == 0

"""The sets of shots that show what denoisers fail at."""

from __future__ import annotations

import pytest
import torch

pytest.importorskip("pyoidn")

from training.benchmark import failures
from training.data.shots import Shot


def shot(features: list[str]) -> Shot:
    image = torch.full((5, 3, 64, 64), 0.5)
    halves = image[2] + 0.02 * torch.randn(2, 3, 64, 64, generator=torch.Generator().manual_seed(3))
    references, vector = {2: halves.mean(0)}, torch.zeros(5, 4, 64, 64)
    return Shot(8, 4, image, image, image, image[:, :1], vector, references, {"features": features}, [], {2: halves})


def test_every_feature_of_a_set_is_one_that_shots_are_rendered_with() -> None:
    source = (failures.Path(failures.__file__).parents[1] / "shots" / "cycles" / "features.py").read_text()
    missing = [name for names in failures.SETS.values() for name in names if f'"{name}"' not in source]
    assert missing == []


def test_a_shot_is_in_all_sets_of_its_features() -> None:
    found = failures.members([shot(["bokeh", "signs"]), shot([])])
    assert found == {"noisy guides": [0], "neighbours that mislead": [], "fireflies": [0], "every shot": [0, 1]}


def test_the_references_noise_is_not_in_the_error() -> None:
    one = shot([])
    truth = one.colour[2]
    assert failures.errors(one, truth)[1] < 2e-5
    assert failures.errors(one, truth * 1.2)[1] == pytest.approx((0.4 * 0.2) ** 2 / (0.4**2 + 1e-2), rel=0.1)


def test_limits_are_held() -> None:
    found = {"fireflies": failures.summary([(0.8, 0.5, 1.0, 1.0, 0.5), (0.8, 2.0, 1.0, 1.0, 2.0)])}
    assert found["fireflies"] == pytest.approx((0.8, 1.0, 1.0, 1.0, 1.0, 2.0))
    assert failures.above(found, {"fireflies": [0.9, 1.1, 1.1, 1.1, 1.1, 2.1]}) == []
    assert failures.above(found, {"fireflies": [0.9, 1.1, 1.1, 1.1, 1.1, 1.9]}) == ["fireflies: the worst 2.000, at most 1.900"]

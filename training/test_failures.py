"""The sets of shots that show what denoisers fail at."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest
import torch

pytest.importorskip("pyoidn")

from training.benchmark import failures
from training.data.shots import Shot
from training.network.model import Architecture, Hush
from training.network.weights_file import WeightsFile


def shot(features: list[str]) -> Shot:
    image = torch.full((5, 3, 64, 64), 0.5)
    halves = image[2] + 0.02 * torch.randn(2, 3, 64, 64, generator=torch.Generator().manual_seed(3))
    references, vector = {2: halves.mean(0)}, torch.zeros(5, 4, 64, 64)
    return Shot(8, 4, image, image, image, image[:, :1], vector, references, {"features": features}, [], {2: halves})


def test_every_feature_of_a_set_is_one_that_shots_are_rendered_with() -> None:
    source = (Path(failures.__file__).parents[1] / "shots" / "cycles" / "features.py").read_text()
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


def test_the_limits_are_of_shots_that_are_for_validation() -> None:
    limits = json.loads(Path(failures.__file__).with_suffix(".json").read_text())
    assert list(limits["seeds"]) == list(limits["limits"]) == [*failures.SETS, failures.EVERY]
    every = limits["seeds"][failures.EVERY]
    assert all(seed % 8 == 0 for seed in every)
    assert all(set(seeds) <= set(every) for seeds in limits["seeds"].values())
    assert all(len(row) == len(failures.COLUMNS) for row in limits["limits"].values())


def test_limits_of_other_shots_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    weights, limits = tmp_path / "small.safetensors", tmp_path / "limits.json"
    arch = Architecture(features=16, half=16, quarter=16, eighth=16, pair=16)
    header = {"hush.architecture": json.dumps(arch.header())}
    WeightsFile({k: v.contiguous() for k, v in Hush(arch).state_dict().items()}, header).write(weights)
    held = [shot(["signs"])]
    monkeypatch.setattr(failures, "read_held", lambda _folders: held)

    def run(*options: object) -> None:
        monkeypatch.setattr(sys, "argv", ["failures", *map(str, (weights, "--shots", "x", *options))])
        failures.main()

    with pytest.raises(SystemExit):
        run("--write")
    run("--limits", limits, "--write")
    assert json.loads(limits.read_text())["seeds"] == {"fireflies": [8], failures.EVERY: [8]}
    run("--limits", limits)
    held.append(shot([]))
    with pytest.raises(SystemExit, match="other shots"):
        run("--limits", limits)


def test_limits_are_held() -> None:
    found = {"fireflies": failures.summary([(0.8, 0.5, 1.0, 1.0, 0.5), (0.8, 2.0, 1.0, 1.0, 2.0)])}
    assert found["fireflies"] == pytest.approx((0.8, 1.0, 1.0, 1.0, 1.0, 2.0))
    assert failures.above(found, {"fireflies": [0.9, 1.1, 1.1, 1.1, 1.1, 2.1]}) == []
    assert failures.above(found, {"fireflies": [0.9, 1.1, 1.1, 1.1, 1.1, 1.9]}) == ["fireflies: the worst 2.000, at most 1.900"]

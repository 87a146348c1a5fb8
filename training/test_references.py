"""Tests of references that trained weights denoise: python -m pytest training"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
import torch
from torch import Tensor

from training.data.inputs import prepare
from training.data.resident import Resident
from training.data.shots import Shot
from training.example_shots import moving_shot, noise
from training.network.references import ReferenceDenoiser, mixed, samples
from training.network.run import Run

torch.set_num_threads(1)
WEIGHTS = Path(__file__).parents[1] / "models/hush.safetensors"


def still_shot(strength: float) -> tuple[Shot, Tensor]:
    """A ramp that nothing moves on, with noisy references; and the ramp."""
    size = 64
    ramp = torch.linspace(0.2, 1.0, size).expand(3, size, size)
    whole = lambda value, channels: torch.full((7, channels, size, size), value)
    references = {k: ramp * (1 + strength * (noise(3, size, size, seed=k) - 0.5)) for k in (2, 3)}
    albedos = {k: torch.full((3, size, size), 0.5) for k in (2, 3)}
    shot = Shot(1, 4, whole(0.5, 3), whole(0.5, 3), whole(0.5, 3), whole(2.0, 1), whole(0.0, 4), references, reference_albedos=albedos)
    return shot, ramp


def test_references_lose_their_noise_and_nothing_else_changes() -> None:
    shot, ramp = still_shot(1.0)
    made = ReferenceDenoiser(WEIGHTS, in_c=False)(shot)
    error = lambda image: float(((image - ramp) / ramp).square().mean())
    for frame, before in shot.references.items():
        assert error(made.references[frame]) < 0.3 * error(before), "half of the noise is kept where nothing tells how much it is"
    halves = {k: ramp * (1 + 2**0.5 * (noise(2, 3, 64, 64, seed=k) - 0.5)) for k in (2, 3)}
    with_halves = replace(shot, halves=halves, references={k: pair.mean(0) for k, pair in halves.items()})
    for frame, image in ReferenceDenoiser(WEIGHTS, in_c=False)(with_halves).references.items():
        assert error(image) < 0.1 * error(with_halves.references[frame])
    assert replace(made, references={}) == replace(shot, references={})


def test_what_halves_say_is_there_is_not_taken_away() -> None:
    stripes = torch.ones(3, 32, 32)
    stripes[..., ::2] = 0.5
    blurred = torch.full((3, 32, 32), 0.75)
    still = mixed(stripes, blurred, torch.stack((stripes, stripes)))
    torch.testing.assert_close(still, stripes)
    # All of the change is noise where the halves differ by twice as much, as the noise of their mean is half of their difference.
    grain = 0.25 * (-1) ** torch.arange(32 * 32).view(32, 32)
    torch.testing.assert_close(mixed(blurred + grain, blurred, torch.stack((blurred, blurred + 2 * grain))), blurred)
    # Three quarters of the change are none.
    less = mixed(blurred + grain, blurred, torch.stack((blurred + grain / 2, blurred - grain / 2)))
    torch.testing.assert_close(less, blurred + 0.75 * grain)
    black = torch.zeros(3, 32, 32)
    assert mixed(black, black, torch.stack((black, black))).abs().max() == 0


def test_each_reference_has_the_other_as_its_neighbour() -> None:
    shot = moving_shot(rows=32, columns=32)
    shot.reference_albedos = {3: noise(3, 32, 32, seed=7)}
    denoiser = ReferenceDenoiser(WEIGHTS, in_c=False)
    made = denoiser(shot).references
    frames = [1, 2, 3]
    colour = torch.stack([shot.colour[1], shot.references[2], shot.references[3]])
    albedo = torch.stack([shot.albedo[1], shot.albedo[2], shot.reference_albedos[3]])
    around = Shot(1, 1, colour, albedo, shot.normal[frames], shot.depth[frames], shot.vector[frames], {})
    pair = replace(around, **{name: getattr(around, name)[1:] for name in ("colour", "albedo", "normal", "depth", "vector")})
    for frame, of, offset in ((2, around, 1), (3, pair, -1)):
        batch = {name: image[None] for name, image in prepare(of, (offset,), epsilon=denoiser.net.arch.albedo_epsilon).items()}
        best = mixed(shot.references[frame], denoiser.net(batch, torch.ones(1))["image"][0], None)
        torch.testing.assert_close(made[frame], best)
    alone = {name: image[None] for name, image in prepare(pair, (), epsilon=denoiser.net.arch.albedo_epsilon).items()}
    lonely = replace(shot, references={3: shot.references[3]})
    best = mixed(shot.references[3], denoiser.net(alone, torch.ones(1))["image"][0], None)
    torch.testing.assert_close(denoiser(lonely).references[3], best)


def test_parts_of_the_light_are_denoised_by_themselves() -> None:
    shot, ramp = still_shot(1.0)
    denoiser = ReferenceDenoiser(WEIGHTS, in_c=False)
    of_part = {k: image * ramp for k, image in shot.references.items()}
    of_rest = {k: image - of_part[k] for k, image in shot.references.items()}
    made = denoiser(replace(shot, reference_parts=of_part))
    for frame in shot.references:
        torch.testing.assert_close(made.reference_parts[frame], denoiser.best(shot, of_part, {})[frame])
        torch.testing.assert_close(made.references[frame], made.reference_parts[frame] + denoiser.best(shot, of_rest, {})[frame])


@pytest.mark.parametrize(
    ("said", "count", "taught"),
    [
        ({}, 256, True),
        ({"reference": 2048}, 2048, False),
        ({"reference": [32, 0.0]}, 64, True),
        ({"reference": [1024, 0.0056]}, 2048, False),
    ],
)
def test_references_of_many_samples_stay(said: dict[str, object], count: int, taught: bool) -> None:
    shot = replace(still_shot(1.0)[0], meta=said)
    made = ReferenceDenoiser(WEIGHTS, in_c=False)(shot)
    assert made is not None
    assert (samples(shot), made is not shot) == (count, taught)


def test_references_hardly_better_than_the_noisy_frames_teach_nothing() -> None:
    few = replace(still_shot(1.0)[0], meta={"reference": [32, 0.0]})
    denoiser = ReferenceDenoiser(WEIGHTS, in_c=False)
    assert denoiser(replace(few, spp=8))
    assert denoiser(replace(few, spp=9)) is None
    other = moving_shot(takes=2)
    assert other.takes[1].spp == 8
    assert denoiser(replace(other, meta={"reference": [32, 0.0]}))
    assert denoiser(replace(other, meta={"reference": [31, 0.0]})) is None
    assert denoiser(replace(few, spp=1000, meta={"reference": 2048})), "as the renderer's own are good"


def test_what_is_measured_against_is_never_denoised(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for seed in (16, 17, 18):
        (tmp_path / f"{seed:06d}.npz").touch()
    monkeypatch.setattr("training.data.resident.read_shot", lambda path: moving_shot(seed=int(path.stem)))
    changed: list[int] = []
    denoiser = lambda shot: changed.append(shot.seed) or (shot if shot.seed != 18 else None)
    device = torch.device("cpu")
    run = Run(tmp_path, [tmp_path], *[None] * 4, Resident(device), Resident(device), denoiser)
    run.find_shots()
    assert (sorted(changed), run.shots.seeds, run.held.seeds) == ([17, 18], [17], [16])
    changed.clear()
    run.find_shots()
    assert (changed, len(run.shots)) == ([], 1)

"""The optimiser, the losses, weights of any architecture, and whole runs: python -m pytest training"""

from __future__ import annotations

import copy
import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.torch import load_file
from torch import Tensor, nn

from training.benchmark import ablate
from training.data.batches import Batches, Recipe
from training.data.inputs import prepare
from training.data.resident import Resident
from training.encoder import train as encoder
from training.example_shots import moving_shot, noise
from training.network import clock, export, fused, measure, pack, train
from training.network.loss import asymmetric, fireflies, smape
from training.network.model import Architecture, Hush
from training.network.muon import QUINTIC, Both, Muon, is_coarse
from training.network.objective import Shares, objective, still_loss
from training.network.run import bound_gradients
from training.network.weights_file import Trained, WeightsFile, begin_from, changed, mean_of
from training.shots.shot_file import save

SMALL = Architecture(features=16, half=16, quarter=16, eighth=16, pair=16, blocks_quarter=2, blocks_eighth=2, blocks_out=2)


def random_weights(arch: Architecture = SMALL) -> Trained:
    torch.manual_seed(1)
    return Trained(arch, {k: torch.randn_like(v) * 0.1 for k, v in Hush(arch).state_dict().items()})


def batches(recipe: Recipe, references: tuple[int, ...] = (3, 2)) -> Batches:
    resident = Resident(torch.device("cpu"))
    resident.add([moving_shot(references=references, rows=32, columns=32)])
    return Batches(resident, recipe, 1)


def stepped_alone(p: Tensor, mean: Tensor, rate: float) -> Tensor:
    """Muon's step of one parameter, as Jordan et al. give it."""
    mean.lerp_(p.grad, 0.05)
    x = p.grad.lerp(mean, 0.95).flatten(1)
    wide = x.shape[0] <= x.shape[1]
    x = x if wide else x.T
    x = x / x.norm()
    for _ in range(5):
        square = x @ x.T
        x = QUINTIC[0] * x + (QUINTIC[1] * square + QUINTIC[2] * square @ square) @ x
    return p * (1 - rate * 0.01) - rate * 0.2 * max(x.shape) ** 0.5 * (x if wide else x.T).reshape(p.shape)


def test_steps_batched_by_shape_are_the_steps_of_each_parameter() -> None:
    shapes = [(8, 4, 3, 3), (8, 4, 3, 3), (4, 32, 1, 1), (32, 4, 1, 1), (8, 4, 3, 3)]
    parameters = [nn.Parameter(noise(*shape, seed=k) - 0.5) for k, shape in enumerate(shapes)]
    expected, means = [p.detach().clone() for p in parameters], [torch.zeros_like(p) for p in parameters]
    optimiser = Muon(parameters, 0.02, weight_decay=0.01)
    for step in range(3):
        for k, p in enumerate(parameters):
            p.grad = noise(*p.shape, seed=100 * step + k) - 0.5
        alone = [copy.copy(p.grad) for p in parameters]
        for k, gradient in enumerate(alone):
            expected[k].grad = gradient
            expected[k] = stepped_alone(expected[k], means[k], 0.02)
        optimiser.step()
        for p, one in zip(parameters, expected, strict=True):
            torch.testing.assert_close(p.detach(), one, rtol=1e-4, atol=1e-6)


def test_every_parameter_is_trained_once_and_what_sees_far_decays_by_itself() -> None:
    net = Hush(SMALL)
    both = Both(net, 1e-3, decay=0.1, decay_coarse=0.7)
    groups = [group for part in both.parts for group in part.param_groups]
    assert sorted(id(p) for group in groups for p in group["params"]) == sorted(id(p) for p in net.parameters())
    coarse = {id(p) for n, p in net.named_parameters() if is_coarse(n)}
    assert len(coarse) == 10
    assert {id(p) for group in groups if group["weight_decay"] == 0.7 for p in group["params"]} == coarse


def test_gradients_are_bounded_and_nothing_is_learnt_from_what_is_not_finite() -> None:
    net = Hush(SMALL)
    for p in net.parameters():
        p.grad = torch.ones_like(p)
    bound_gradients(net)
    assert abs(float(torch.nn.utils.get_total_norm([p.grad for p in net.parameters()])) - 1) < 1e-3
    next(net.parameters()).grad[0] = float("nan")
    bound_gradients(net)
    assert all(float(p.grad.abs().max()) == 0 for p in net.parameters())


def test_a_map_of_one_lambda_costs_what_the_lambda_costs() -> None:
    image, reference, noisy = (noise(2, 3, 32, 32, seed=k) for k in (1, 2, 3))
    lam = torch.tensor([1.0, 9.0])
    as_map = lam.view(2, 1, 1, 1).expand(2, 1, 32, 32)
    torch.testing.assert_close(asymmetric(image, reference, noisy, as_map), asymmetric(image, reference, noisy, lam))
    batch = batches(Recipe(outputs=4, crop=32, composed=0, paired=1, alone=0)).draw()
    out = {"image": noise(2, 3, 32, 32), "half": noise(2, 3, 16, 16), "quarter": noise(2, 3, 8, 8)}
    torch.testing.assert_close(still_loss(out, batch.views[0], as_map), still_loss(out, batch.views[0], lam))
    half_and_half = torch.cat((as_map[..., :16], torch.full((2, 1, 32, 16), 64.0)), -1)
    assert (still_loss(out, batch.views[0], half_and_half) - still_loss(out, batch.views[0], lam)).abs() > 1e-3


def test_the_pull_on_a_tap_stays_bounded_however_bright_the_firefly() -> None:
    reference = torch.full((1, 3, 4, 4), 0.4)
    pulls = []
    for brightness in (2.0, 20.0, 2e3, 2e5):
        image = reference.clone()
        image[..., 1, 1] += brightness
        image.requires_grad_()
        loss = fireflies(image, reference).mean()
        (gradient,) = torch.autograd.grad(loss, image)
        pulls.append(float(gradient[0, 0, 1, 1]) * brightness)
        assert loss > 0.1
    assert 0.5 < pulls[-1] < 1.0 and max(pulls) < 1.0
    assert pulls == sorted(pulls)


def test_blocks_that_are_left_out_are_the_identity_and_the_rest_close_up() -> None:
    trained = random_weights()
    less = trained.without(["eighth.0", "half_out.1"])
    assert (less.architecture.blocks_eighth, less.architecture.blocks_out, less.architecture.blocks_quarter) == (1, 1, 2)
    assert torch.equal(less.weights["eighth.0.first.weight"], trained.weights["eighth.1.first.weight"])
    assert trained.without(["eighth.0", "eighth.1"]).architecture.blocks_eighth == 0
    whole = trained.network()
    for block in ("eighth.0", "half_out.1"):
        ablate.identity(whole.get_submodule(block))
    batch = batches(Recipe(outputs=2, crop=32, paired=0, alone=0)).draw()
    run = lambda net: net.denoise(net.encode(batch.inputs), batch.views[0], batch.lam)["image"]
    with torch.no_grad():
        torch.testing.assert_close(run(less.network()), run(whole))
    with pytest.raises(SystemExit, match="quarter_in.1"):
        trained.without(["eighth.7"])


def test_added_blocks_begin_as_the_identity() -> None:
    trained = random_weights()
    net = Hush(changed(SMALL, ["blocks_quarter=3", "blocks_encoder=2"]))
    begin_from(net, trained.weights)
    batch = batches(Recipe(outputs=2, crop=32, paired=0, alone=0)).draw()
    run = lambda net: net.denoise(net.encode(batch.inputs), batch.views[0], batch.lam)["image"]
    with torch.no_grad():
        torch.testing.assert_close(run(net), run(trained.network()))
    with pytest.raises(SystemExit, match="no blocks_none"):
        changed(SMALL, ["blocks_none=3"])


def test_the_mean_of_weights_wants_one_architecture() -> None:
    first = random_weights()
    second = Trained(SMALL, {k: v + 2 for k, v in first.weights.items()})
    torch.testing.assert_close(mean_of([first, second]).weights["mix.bias"], first.weights["mix.bias"] + 1)
    with pytest.raises(SystemExit, match="different architectures"):
        mean_of([first, first.without(["eighth.0"])])


def test_the_schedule_goes_on_where_it_was_and_ends_with_the_time(monkeypatch: pytest.MonkeyPatch) -> None:
    now = [100.0]
    monkeypatch.setattr(clock.time, "monotonic", lambda: now[0])
    first = clock.Clock(100)
    now[0] += 20  # reading
    assert first.done == 0
    first.start()
    assert first.done == 0
    now[0] += 40
    assert first.done == pytest.approx(0.5)
    again = clock.Clock(100, first.spent, first.done)
    now[0] += 20
    assert again.done == pytest.approx(0.5)
    again.start()
    assert again.done == pytest.approx(0.5)
    again.reserve = 10
    now[0] += 5
    assert again.done == pytest.approx(0.75)
    now[0] += 5
    assert again.done == 1
    assert clock.rate_share(1000, 1.0) == clock.LOWEST
    assert clock.rate_share(0, 0.0) == 1 / clock.WARM_UP


def test_dropped_coarse_features_are_those_of_whole_examples() -> None:
    net = random_weights().network()
    train.drop_coarse(net, 0.5)
    seen: list[Tensor] = []
    net.from_eighth.register_forward_pre_hook(lambda _, inputs: seen.append(inputs[0]))
    batch = batches(Recipe(outputs=40, crop=32, paired=0, alone=0)).draw()
    with torch.no_grad():
        net.denoise(net.encode(batch.inputs), batch.views[0], batch.lam)
    far = seen[0][:, : SMALL.eighth].flatten(1).abs().amax(1)
    near = seen[0][:, SMALL.eighth :].flatten(1).abs().amax(1)
    assert 0 < int((far == 0).sum()) < len(far) or len(far) == 1
    assert near.min() > 0


def test_a_step_is_one_graph_to_the_compiler() -> None:
    net = random_weights().network().train()
    net.average = fused.average
    train.drop_coarse(net, 0.5)
    batch = batches(Recipe(outputs=2, crop=32, alone=0, paired=1)).draw()
    found = torch._dynamo.explain(objective)(net, batch, Shares())
    assert (found.graph_count, found.graph_break_count) == (1, 0), found.break_reasons


@pytest.mark.parametrize("references", [(3, 2), (3,)])
def test_training_lowers_the_loss(references: tuple[int, ...]) -> None:
    torch.manual_seed(1)
    net = Hush(SMALL)
    net.average = fused.average
    optimiser = torch.optim.Adam(net.parameters(), 3e-3)
    batch = batches(Recipe(outputs=2, crop=32, alone=0, paired=1, lambda_maps=0.5), references).draw()
    assert len(batch.views) == len(references)
    losses = []
    for _ in range(12):
        loss = objective(net, batch, Shares(temporal=0.25))
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        losses.append(float(loss.detach()))
    assert losses[-1] < 0.97 * losses[0]


def passes(shot_seed: int, frame: int, size: int = 32) -> dict[str, np.ndarray]:
    n = lambda channels, k: noise(size, size, channels, seed=100 * shot_seed + 10 * frame + k).numpy()
    return {"color": n(3, 1), "albedo": n(3, 2), "normal": n(3, 3) * 2 - 1, "depth": n(1, 4) + 1, "vector": n(4, 5) * 4 - 2}


@pytest.fixture
def shots(tmp_path: Path) -> Path:
    """A folder of four shots, of which one is for validation."""
    folder = tmp_path / "shots"
    folder.mkdir()
    for seed in (8, 9, 10, 11):
        takes = [[passes(seed + 50 * k, frame) for frame in range(7)] for k in range(2)]
        references = [[passes(seed, 20 + k), passes(seed, 30 + k)] for k in range(2)]
        save(folder / f"{seed:06}.npz", takes, references, {"seed": seed, "spp": [4, 16]})
    return folder


def started(monkeypatch: pytest.MonkeyPatch, module: object, *arguments: object) -> None:
    monkeypatch.setattr(sys, "argv", ["program", *map(str, arguments)])
    module.main()


def test_a_run_starts_from_weights_goes_on_and_is_exported_with_its_architecture(
    shots: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    weights, out = tmp_path / "start.safetensors", tmp_path / "run"
    trained = random_weights()
    header = {"hush.architecture": json.dumps(SMALL.header()), "hush.training": "{}"}
    WeightsFile({k: v.contiguous() for k, v in trained.weights.items()}, header).write(weights)
    options = ["--shots", shots, "--out", out, "--start", weights, "--without", "eighth.1", "--architecture", "blocks_quarter=3"]
    options += ["--crop", 32, "--seconds", 600, "--fused", "--drop-coarse", 0.5, "--decay-coarse", 0.1, "--lambda-maps", 0.3]
    started(monkeypatch, train, *options, "--steps", 2, "--every", 0)
    first = torch.load(out / "checkpoint.pt", weights_only=True)
    assert first["step"] == 2 and first["seeds"] == [9, 10, 11]
    started(monkeypatch, train, *options, "--steps", 4)
    again = torch.load(out / "checkpoint.pt", weights_only=True)
    assert again["step"] == 4 and again["done"] > first["done"] and again["spent"] > first["spent"]
    lines = [json.loads(line) for line in (out / "log.jsonl").read_text().splitlines()]
    assert [line["step"] for line in lines] == [0, 1, 2, 2, 2, 4]
    assert lines[-1]["shots"] == 3 and lines[-1]["held_shots"] == 1
    names = {f"{name}_{window}" for name in ("smape", "relmse", "blocks", "half", "quarter") for window in (0, 2)} | {"flicker_2"}
    assert all(set(lines[-1][part]) == names for part in ("held", "trained", "gap"))
    started(monkeypatch, export, out / "checkpoint.pt", "--out", tmp_path / "out.safetensors", "--shots", shots)
    written = WeightsFile.read(tmp_path / "out.safetensors")
    assert written.architecture() == changed(SMALL, ["blocks_quarter=3", "blocks_eighth=1"])
    assert load_file(tmp_path / "out.safetensors")["mix.bias"].dtype == torch.float16
    assert json.loads(written.header["hush.validation"])["seeds"] == [8]
    capsys.readouterr()
    monkeypatch.setattr(ablate, "parts", lambda net: [ablate.Part("nothing"), ablate.Part("keys", ablate.keys)])
    started(monkeypatch, ablate, tmp_path / "out.safetensors", "--shots", shots)
    table = capsys.readouterr().out
    assert "nothing 1.000" in table and "keys" in table


def test_a_pack_trains_where_nothing_of_the_project_is(shots: Path, tmp_path: Path) -> None:
    weights, there = tmp_path / "start.safetensors", tmp_path / "there"
    trained = random_weights()
    WeightsFile(trained.weights, {"hush.architecture": json.dumps(SMALL.header())}).write(weights)
    pieces = pack.write(tmp_path / "pack", sorted(shots.iterdir()), weights, None, 100_000)
    assert pieces > 2
    assert all(path.stat().st_size <= 100_000 for path in (tmp_path / "pack").iterdir())
    subprocess.run(["sh", tmp_path / "pack/unpack.sh", there], check=True)
    options = ["--crop", "32", "--steps", "1", "--batch", "1", "--seconds", "600"]
    environment = {"PATH": os.environ["PATH"], "PYTHON": sys.executable}
    subprocess.run([there / "train", *options], check=True, env=environment, cwd=tmp_path)
    subprocess.run([there / "export", "--out", there / "out.safetensors"], check=True, env=environment, cwd=tmp_path)
    assert WeightsFile.read(there / "out.safetensors").architecture() == SMALL
    pack.write(tmp_path / "again", sorted(shots.iterdir()), None, there / "run/checkpoint.pt", 1_000_000)
    subprocess.run(["sh", tmp_path / "again/unpack.sh", tmp_path / "third"], check=True)
    subprocess.run([tmp_path / "third/train", *options, "--steps", "2"], check=True, env=environment, cwd=tmp_path)
    assert torch.load(tmp_path / "third/run/checkpoint.pt", weights_only=True)["step"] == 2
    (tmp_path / "pack/pack.001").write_bytes(b"damaged")
    assert subprocess.run(["sh", tmp_path / "pack/unpack.sh", there], capture_output=True).returncode != 0


def test_another_renderers_encoder_is_trained_by_itself(shots: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    weights = tmp_path / "weights.safetensors"
    trained = random_weights()
    WeightsFile(trained.weights, {"hush.architecture": json.dumps(SMALL.header())}).write(weights)
    options = ["--weights", weights, "--shots", shots, "--renderer", "other", "--normals", "world", "--out", tmp_path / "encoder"]
    with pytest.raises(SystemExit):
        started(monkeypatch, encoder, *options, "--renderer", "Other.1")
    started(monkeypatch, encoder, *options, "--minutes", 0.02, "--batch", 1, "--fused")
    written = WeightsFile.read(weights)
    assert written.renderers() == ["cycles", "other"]
    assert all(torch.equal(written.tensors[name], value) for name, value in trained.weights.items())
    assert (written.weights("other")["encoder.first.weight"] - trained.weights["encoder.first.weight"]).abs().max() > 1e-5
    assert json.loads(written.header["hush.validation.other"])["smape_window_2"] > 0


def test_the_albedos_epsilon_is_the_architectures() -> None:
    arch = replace(SMALL, albedo_epsilon=0.3)
    draw = batches(Recipe(outputs=40, crop=32, composed=0, epsilon=arch.albedo_epsilon)).draw
    assert min(float(draw().views[0]["albedo"][:, 0].min()) for _ in range(3)) >= 0.3
    resident = Resident(torch.device("cpu"))
    shot = moving_shot(rows=32, columns=32)
    resident.add([shot])
    net = Trained(arch, random_weights().weights).network()
    with torch.no_grad():
        batch = {name: value[None] for name, value in prepare(shot, (), epsilon=0.3).items()}
        image, reference = net(batch, torch.ones(1))["image"] * batch["gain"], batch["reference"] * batch["gain"]
    found = measure.scores(net, measure.everything(resident), [(0, ())])["smape_0"]
    assert found == pytest.approx(float(smape(image, reference).mean()), rel=1e-5)


def test_scores_do_not_depend_on_how_shots_are_taken_together(monkeypatch: pytest.MonkeyPatch) -> None:
    resident = Resident(torch.device("cpu"))
    resident.add([moving_shot(rows=32, columns=32, seed=k) for k in (1, 2, 3)])
    net = random_weights().network()
    whole = measure.scores(net, measure.everything(resident))
    monkeypatch.setattr(measure, "PIXELS", 2 * 32**2)
    parts = measure.scores(net, measure.everything(resident))
    assert whole == pytest.approx(parts, rel=1e-5)
    assert len(measure.sample(resident, 2)[0][1]) == 2

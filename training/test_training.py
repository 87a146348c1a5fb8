"""Tests of the training code, in its own environment: python -m pytest training"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from training.benchmark import ablate
from training.data.inputs import frames, prepare, view
from training.data.shots import OFFSETS, held_paths, read_shot, shot_paths
from training.example_shots import moving_shot, noise
from training.network.loss import flicker
from training.network.model import VARIANCES, Architecture, Hush
from training.shots import shot_file
from training.shots.cycles.pack import Chunks
from training.shots.processes import run_all

torch.set_num_threads(1)
ROWS, COLUMNS = 24, 40  # of shots as a renderer gives them


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


@pytest.mark.parametrize("arch", [Architecture(), Architecture(albedo_levels=3, variance=1)])
def test_what_is_left_out_has_no_effect(arch: Architecture) -> None:
    torch.manual_seed(1)
    net = Hush(replace(arch, features=8, half=8, quarter=8, eighth=8))
    net.load_state_dict({k: v + 0.1 * torch.randn_like(v) for k, v in net.state_dict().items()})
    batch = {k: v[None] for k, v in prepare(moving_shot()).items()}
    other = batch | {k: torch.cat((batch[k][:, :1], 1 - batch[k][:, 1:]), 1) for k in ("colour", "albedo")}
    run = lambda of, name="image": net(of, torch.ones(1))[name].detach()
    assert (run(batch) - run(other)).abs().max() > 1e-3
    ablate.neighbour_taps(net)
    if arch.variance:
        assert (run(batch) - run(other)).abs().max() > 1e-5, "the variances still know of them"
        before = run(batch)
        ablate.variances(net)
        assert (run(batch) - before).abs().max() > 1e-5
    torch.testing.assert_close(run(batch), run(other))
    torch.testing.assert_close(run(batch, "albedo"), run(other, "albedo"))
    assert (run(batch, "albedo") - batch["albedo"][:, 0]).abs().max() > 1e-3
    ablate.own_albedo(net)
    torch.testing.assert_close(run(batch, "albedo"), batch["albedo"][:, 0])


def test_the_temporal_extractor_is_left_out_without_the_variances() -> None:
    net = Hush(Architecture(features=8, half=8, quarter=8, eighth=8, variance=1))
    ablate.temporal_extractor(net)
    assert [bool(part.abs().max() > 0) for part in net.mix.weight.detach().split((8, 8, VARIANCES), 1)] == [True, False, True]


def test_flicker_is_nothing_where_the_error_moves_along() -> None:
    reference, error = noise(1, 3, 8, 8, seed=1), noise(1, 3, 8, 8, seed=2)
    followed = torch.ones(1, 1, 8, 8)
    assert flicker(reference + error, reference, error, followed).max() < 1e-6
    assert flicker(reference + error, reference, -error, followed).mean() > 0.1
    assert flicker(reference + error, reference, -error, 0 * followed).max() == 0


def stored_passes(seed: int, scale: float = 1.0) -> shot_file.Passes:
    """One frame as a renderer gives it: a firefly, a NaN, and background as Blender 5.2 writes it."""
    r = np.random.default_rng(seed)
    made = {name: r.random((ROWS, COLUMNS, n), np.float32) for name, n in (("color", 3), ("albedo", 3), ("normal", 3), ("depth", 1))}
    made["color"] = made["color"] * scale
    made["color"][0, 0], made["color"][0, 1] = 1e9, np.nan
    made["depth"][0] = 3e38
    return made | {"vector": (r.random((ROWS, COLUMNS, 4), np.float32) - 0.5) * 40}


def stored_shot(target: Path, halves: int = 2) -> tuple[list[list[shot_file.Passes]], list[list[shot_file.Passes]]]:
    takes = [[stored_passes(10 * take + frame) for frame in range(7)] for take in range(3)]
    references = [[stored_passes(100 + 10 * frame + part) for part in range(halves)] for frame in range(2)]
    shot_file.save(target, takes, references, {"seed": 50001, "spp": [4, 1, 32]})
    return takes, references


def test_a_shots_file_gives_back_takes_and_halves(tmp_path: Path) -> None:
    takes, references = stored_shot(tmp_path / "050001.npz")
    shot = read_shot(tmp_path / "050001.npz")
    assert [take.spp for take in shot.takes] == [4, 1, 32]
    assert (shot.spp, shot.seed, shot.centre) == (4, 50001, 3)
    inner = np.s_[1:]  # the first row has what cannot be kept
    for number, take in enumerate(takes):
        of = shot.of_take(number)
        assert of.takes == [shot.takes[number]]
        assert of.spp == shot.takes[number].spp
        for frame, passes in enumerate(take):
            for name, image, close in (
                ("color", of.colour, 2e-3),
                ("albedo", of.albedo, 3e-3),
                ("normal", of.normal, 5e-3),
                ("depth", of.depth, 2e-3),
            ):
                assert np.abs(np.moveaxis(image[frame].numpy(), 0, -1)[inner] - passes[name][inner]).max() < close, name
            assert of.depth[frame, 0, 0].abs().max() == 0, "background is 0"
            assert of.colour[frame, :, 0, 0].tolist() == [65024] * 3
            assert of.colour[frame, :, 0, 1].tolist() == [0] * 3
    for frame, passes in enumerate(takes[0]):
        assert np.abs(np.moveaxis(shot.vector[frame].numpy(), 0, -1) - passes["vector"]).max() <= 0.5 / 128
    assert sorted(shot.halves) == sorted(shot.references) == [2, 3]
    for frame, parts in ((3, references[0]), (2, references[1])):
        for half, passes in zip(shot.halves[frame], parts, strict=True):
            assert np.abs(np.moveaxis(half.numpy(), 0, -1)[inner] - passes["color"][inner]).max() < 5e-4
        torch.testing.assert_close(shot.references[frame], shot.halves[frame].mean(0))
        albedo = np.mean([passes["albedo"] for passes in parts], 0)
        assert np.abs(np.moveaxis(shot.reference_albedos[frame].numpy(), 0, -1) - albedo).max() < 3e-3


@pytest.mark.parametrize(("share", "kept"), [(0.3, True), (0.01, False), (0.99, False)])
def test_a_shots_file_keeps_the_parts_of_its_light_where_both_have_some(tmp_path: Path, share: float, kept: bool) -> None:
    def frame(seed: int) -> shot_file.Passes:
        passes = stored_passes(seed)
        passes["color"][0] = 0.5
        return passes | {"part": passes["color"] * np.float32(share)}

    takes, halves = [[frame(10 * take + k) for k in range(7)] for take in range(2)], [[frame(90 + k)] * 2 for k in range(2)]
    shot_file.save(tmp_path / "050001.npz", takes, halves, {"seed": 50001, "spp": [4, 1]})
    shot = read_shot(tmp_path / "050001.npz")
    assert [take.part is not None for take in shot.takes] == [kept] * 2
    assert sorted(shot.reference_parts) == sorted(shot.part_halves) == ([2, 3] if kept else [])
    if kept:
        for number in range(2):
            of = shot.of_take(number)
            torch.testing.assert_close(of.part, of.colour * share, rtol=5e-3, atol=1e-3)
        torch.testing.assert_close(shot.reference_parts[3], shot.references[3] * share, rtol=2e-3, atol=1e-3)
        torch.testing.assert_close(shot.part_halves[2][1], shot.halves[2][1] * share, rtol=2e-3, atol=1e-3)


def test_a_seed_that_is_in_two_folders_is_one_shot(tmp_path: Path) -> None:
    for name in ("a/000008.npz", "a/000010.npz", "b/000008.npz", "b/000009.npz", "b/000011.part.npz", "b/notes.npz"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    found = shot_paths([tmp_path / "a", tmp_path / "b"])
    assert [str(path.relative_to(tmp_path)) for path in found] == ["b/000008.npz", "b/000009.npz", "a/000010.npz"]
    assert held_paths([tmp_path / "a", tmp_path / "b"]) == found[:1]
    found[0].unlink()
    with pytest.raises(SystemExit, match="no validation shots in .*b: "):
        held_paths([tmp_path / "b"])


def test_a_reference_that_is_one_render_has_no_halves(tmp_path: Path) -> None:
    stored_shot(tmp_path / "050001.npz", halves=1)
    shot = read_shot(tmp_path / "050001.npz")
    assert shot.halves == {}
    assert sorted(shot.references) == [2, 3]


@pytest.mark.parametrize("count", [5, 7])
def test_shots_of_the_first_format_are_read(tmp_path: Path, count: int) -> None:
    r = np.random.default_rng(1)
    image = lambda *shape: r.random((*shape, ROWS, COLUMNS, 3)).astype(np.float16)
    depth = r.random((count, ROWS, COLUMNS)).astype(np.float16)
    depth[:, 0] = 65000
    arrays = {
        "color": image(count),
        "albedo": (image(count) * 255).astype(np.uint8),
        "normal": (image(count) * 127).astype(np.int8),
        "ref": image(),
        "ref_albedo": (image() * 255).astype(np.uint8),
    }
    arrays |= {"depth": depth, "vector": r.random((count, ROWS, COLUMNS, 4)).astype(np.float16)} | (
        {"ref_before": image()} if count == 7 else {}
    )
    np.savez_compressed(tmp_path / "001001.npz", meta=json.dumps({"seed": 1001, "spp": 3}), **arrays)
    shot = read_shot(tmp_path / "001001.npz")
    same = lambda tensor, array: np.array_equal(np.moveaxis(tensor.numpy(), -3, -1), array.astype(np.float32))
    assert same(shot.colour, arrays["color"])
    assert same(shot.vector, arrays["vector"])
    assert same(shot.reference, arrays["ref"])
    assert np.array_equal(shot.depth[:, 0, 1:].numpy(), depth[:, 1:].astype(np.float32))
    assert shot.depth[:, 0, 0].abs().max() == 0, "Blender 5.2's background, clamped, is background"
    assert (shot.spp, len(shot.takes), shot.halves) == (3, 1, {})
    assert sorted(shot.references) == ([2, 3] if count == 7 else [2])
    assert same(255 * shot.reference_albedos[shot.centre], arrays["ref_albedo"])


@pytest.mark.parametrize("bits", [np.float16, np.int16])
def test_planes_of_bytes_lose_nothing(bits: type[np.generic]) -> None:
    every = np.arange(1 << 16, dtype=np.uint16).view(bits).reshape(2, 1 << 15)
    assert shot_file.whole(shot_file.planes(every), bits).tobytes() == every.tobytes()


def test_a_pack_is_cut_into_pieces_with_their_checksums(tmp_path: Path) -> None:
    data = np.random.default_rng(1).bytes(2500)
    with Chunks(tmp_path, 1000) as pieces:
        for start in range(0, len(data), 700):
            pieces.write(data[start : start + 700])
    names = sorted(path.name for path in tmp_path.glob("pack.0*"))
    assert [(tmp_path / name).stat().st_size for name in names] == [1000, 1000, 500]
    assert b"".join((tmp_path / name).read_bytes() for name in names) == data
    lines = [line.split("  ") for line in (tmp_path / "pack.sha256").read_text().splitlines()]
    assert lines == [[hashlib.sha256((tmp_path / name).read_bytes()).hexdigest(), name] for name in names]


def write_or_die(job: str) -> str:
    """A job of the next test: its file, or the end of its process."""
    folder, number = job.rsplit("/", 1)
    if number == "2":
        os._exit(3)
    if number == "4":
        raise ValueError(number)
    Path(folder, number).write_text(str(os.getpid()))
    return number


@pytest.mark.parametrize("count", [1, 3])
def test_a_process_that_dies_costs_its_job_only(tmp_path: Path, capfd: pytest.CaptureFixture[str], count: int) -> None:
    jobs: Sequence[str] = [f"{tmp_path}/{number}" for number in range(8)]
    lost = run_all(write_or_die, jobs, count)
    assert sorted(lost) == [jobs[2], jobs[4]]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["0", "1", "3", "5", "6", "7"]
    said = capfd.readouterr()
    assert sorted(said.out.split()) == ["0", "1", "3", "5", "6", "7"]
    assert f"died at {jobs[2]} (exit code 3)" in said.err
    assert f"died at {jobs[4]} (exit code 1)" in said.err
    assert len({path.read_text() for path in tmp_path.iterdir()}) >= min(count, 2)

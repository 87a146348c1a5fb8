"""The command line on the sample shot, as a user drives it."""

from __future__ import annotations

import hashlib
import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from conftest import Hush
from images import channels, combined, flicker, frames, layer, parts, smape

NAMES = [f"frame_{i:04d}.exr" for i in range(1, 9)]
COLOUR = {f"ViewLayer.Combined.{c}" for c in "RGB"}


def hashes(folder: Path) -> dict[str, str]:
    return {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in frames(folder)}


def files(folder: Path) -> list[str]:
    """All that is in a folder but the manifest."""
    return sorted(path.name for path in folder.iterdir() if path.suffix != ".json") if folder.is_dir() else []


@pytest.fixture
def two_frames(shot: Path, tmp_path: Path) -> Path:
    folder = tmp_path / "two"
    folder.mkdir()
    for name in NAMES[:2]:
        shutil.copy(shot / name, folder)
    return folder


def test_every_frame_is_written_and_nothing_is_left_behind(denoised: Path) -> None:
    assert files(denoised) == NAMES


def test_everything_but_the_colour_is_bit_exact(shot: Path, denoised: Path) -> None:
    for name in NAMES:
        before, after = channels(shot / name), channels(denoised / name)
        assert before.keys() == after.keys()
        for channel in before.keys() - COLOUR:
            assert before[channel].dtype == after[channel].dtype
            assert before[channel].tobytes() == after[channel].tobytes(), f"{name}: {channel}"


def test_layout_and_metadata_are_kept(shot: Path, denoised: Path) -> None:
    for name in NAMES:
        before, after = parts(shot / name), parts(denoised / name)
        assert list(before) == list(after)
        for part, original in before.items():
            kept = after[part].attributes
            assert {key: str(kept.get(key)) for key in original.attributes} == {k: str(v) for k, v in original.attributes.items()}
            assert {k: v.dtype for k, v in original.channels.items()} == {k: v.dtype for k, v in after[part].channels.items()}
    assert parts(denoised / NAMES[0])["ViewLayer.Combined"].attributes["Software"] == "Blender 5.0.1"


def test_the_colour_is_new_finite_and_no_brighter_than_its_taps(shot: Path, denoised: Path) -> None:
    """The weights are convex: without albedo, a pixel cannot leave the range that the whole shot spans."""
    brightest = np.zeros(3)
    for name in NAMES:
        albedo = np.clip(layer(shot / name, "ViewLayer.Denoising Albedo"), 0.05, 1)
        brightest = np.maximum(brightest, (combined(shot / name) / albedo).max((0, 1)))
    for name in NAMES:
        noisy, clean = combined(shot / name), combined(denoised / name)
        assert np.isfinite(clean).all()
        assert (clean >= 0).all()
        assert (clean.max((0, 1)) <= 1.01 * brightest).all()
        assert np.mean(np.abs(clean - noisy) > 1e-3) > 0.5, f"{name} is hardly changed"


def test_the_error_is_far_below_the_noisy_one(shot: Path, denoised: Path, reference: Path) -> None:
    for name in NAMES:
        truth = combined(reference / name)
        before, after = smape(combined(shot / name), truth), smape(combined(denoised / name), truth)
        assert after <= 0.6 * before, f"{name}: SMAPE {after:.4f}, noisy {before:.4f}"


def test_brightness_is_kept(denoised: Path, reference: Path) -> None:
    for name in NAMES:
        truth, clean = combined(reference / name).mean((0, 1)), combined(denoised / name).mean((0, 1))
        assert np.allclose(clean, truth, rtol=0.06), f"{name}: mean {clean}, reference {truth}"


def test_the_shot_flickers_far_less(shot: Path, denoised: Path, reference: Path) -> None:
    truth = [combined(reference / name) for name in NAMES]
    before = flicker([combined(shot / name) for name in NAMES], truth)
    after = flicker([combined(denoised / name) for name in NAMES], truth)
    assert after <= 0.6 * before, f"flicker {after:.5f}, noisy {before:.5f}"


def test_neighbouring_frames_help(hush: Hush, shot: Path, denoised: Path, reference: Path, tmp_path: Path) -> None:
    result = hush("denoise", shot, "--output", tmp_path / "alone", "--window", "0", "--quiet")
    assert result.returncode == 0, result.stderr
    truth = [combined(reference / name) for name in NAMES]
    alone, together = ([combined(folder / name) for name in NAMES] for folder in (tmp_path / "alone", denoised))
    assert flicker(together, truth) < flicker(alone, truth)
    assert np.mean([smape(a, b) for a, b in zip(together, truth, strict=True)]) < np.mean(
        [smape(a, b) for a, b in zip(alone, truth, strict=True)]
    )


def test_the_originals_are_not_touched(hush: Hush, shot: Path, tmp_path: Path) -> None:
    before = hashes(shot)
    result = hush("denoise", shot, "--output", tmp_path / "out", "--frames", "3-4", "--quiet")
    assert result.returncode == 0, result.stderr
    assert files(tmp_path / "out") == NAMES[2:4]
    assert hashes(shot) == before


def test_the_same_folder_is_refused(hush: Hush, two_frames: Path) -> None:
    before = hashes(two_frames)
    result = hush("denoise", two_frames, "--output", two_frames, "--overwrite")
    assert result.returncode == 1
    assert hashes(two_frames) == before


def test_keep_noisy_keeps_the_input_beside_the_result(hush: Hush, two_frames: Path, tmp_path: Path) -> None:
    result = hush("denoise", two_frames, "--output", tmp_path / "out", "--keep-noisy", "--quiet")
    assert result.returncode == 0, result.stderr
    for path in frames(two_frames):
        before, after = channels(path), channels(tmp_path / "out" / path.name)
        for c in "RGB":
            kept = after[f"ViewLayer.Noisy Image.{c}"]
            assert kept.tobytes() == before[f"ViewLayer.Combined.{c}"].tobytes()
            assert kept.tobytes() != after[f"ViewLayer.Combined.{c}"].tobytes()


def test_a_second_run_skips_what_is_there(hush: Hush, two_frames: Path, tmp_path: Path) -> None:
    output = tmp_path / "out"
    assert hush("denoise", two_frames, "--output", output, "--quiet").returncode == 0
    before = {path.name: path.stat().st_mtime_ns for path in frames(output)}
    result = hush("denoise", two_frames, "--output", output, "--json")
    assert result.returncode == 0, result.stderr
    events = [json.loads(line) for line in result.stdout.splitlines()]
    assert [event["status"] for event in events if event["event"] == "frame"] == ["skipped", "skipped"]
    assert {path.name: path.stat().st_mtime_ns for path in frames(output)} == before


def test_a_lost_output_is_made_again_and_the_others_stay(hush: Hush, two_frames: Path, tmp_path: Path) -> None:
    output = tmp_path / "out"
    assert hush("denoise", two_frames, "--output", output, "--quiet").returncode == 0
    before = hashes(output)
    kept = (output / NAMES[1]).stat().st_mtime_ns
    (output / NAMES[0]).unlink()
    assert hush("denoise", two_frames, "--output", output, "--quiet").returncode == 0
    assert hashes(output) == before
    assert (output / NAMES[1]).stat().st_mtime_ns == kept


def test_threads_do_not_change_a_bit(hush: Hush, two_frames: Path, tmp_path: Path) -> None:
    for threads in ("1", "3"):
        assert hush("denoise", two_frames, "--output", tmp_path / threads, "--threads", threads, "--quiet").returncode == 0
    for name in NAMES[:2]:
        one, three = channels(tmp_path / "1" / name), channels(tmp_path / "3" / name)
        assert all(one[c].tobytes() == three[c].tobytes() for c in COLOUR)


def test_one_truncated_frame_does_not_stop_the_shot(hush: Hush, shot: Path, tmp_path: Path) -> None:
    broken = tmp_path / "broken"
    shutil.copytree(shot, broken)
    path = broken / NAMES[3]
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    result = hush("denoise", broken, "--output", tmp_path / "out")
    assert result.returncode == 2
    assert NAMES[3] in result.stderr
    assert files(tmp_path / "out") == NAMES[:3] + NAMES[4:]
    for name in files(tmp_path / "out"):
        assert np.isfinite(combined(tmp_path / "out" / name)).all()
    assert hush("denoise", broken, "--output", tmp_path / "strict", "--strict").returncode != 0


def test_a_missing_frame_is_told(hush: Hush, shot: Path, tmp_path: Path) -> None:
    """A gap may be meant, so it is a failure only where the range was asked for."""
    gap = tmp_path / "gap"
    gap.mkdir()
    names = [NAMES[0], NAMES[1], NAMES[3]]
    for name in names:
        shutil.copy(shot / name, gap)
    for options, code in (([], 0), (["--frames", "1-4"], 2), (["--strict"], 1)):
        output = tmp_path / f"out{code}"
        result = hush("denoise", gap, "--output", output, *options)
        assert result.returncode == code, result.stderr
        assert "missing frame 3:" in result.stderr
        assert files(output) == ([] if code == 1 else names)


def test_inspect_names_the_passes(hush: Hush, shot: Path) -> None:
    result = hush("inspect", shot / NAMES[0])
    assert result.returncode == 0, result.stderr
    for name in ("Combined", "Denoising Albedo", "Denoising Normal", "Denoising Depth", "Vector", "480", "270"):
        assert name in result.stdout
    found = json.loads(hush("inspect", "--json", shot / NAMES[0]).stdout)
    assert {use["purpose"]: use["pass"] for use in found["uses"]}["vector"] == "ViewLayer.Vector"


@pytest.mark.parametrize("dial", ["0.5", "0", "-3", "nan", "much"])
def test_a_bad_lambda_is_refused(hush: Hush, two_frames: Path, tmp_path: Path, dial: str) -> None:
    result = hush("denoise", two_frames, "--output", tmp_path / "out", "--lambda", dial)
    assert result.returncode == 1
    assert f"invalid value '{dial}' for '--lambda" in result.stderr
    assert files(tmp_path / "out") == []


def test_a_high_lambda_is_clamped_with_a_message(hush: Hush, two_frames: Path, tmp_path: Path) -> None:
    result = hush("denoise", two_frames, "--output", tmp_path / "out", "--lambda", "100")
    assert result.returncode == 0, result.stderr
    assert "lambda 100 is beyond the range, 64 is used" in result.stderr
    assert files(tmp_path / "out") == NAMES[:2]


def test_lambda_keeps_more_of_the_input(hush: Hush, two_frames: Path, tmp_path: Path) -> None:
    distance = []
    for dial in ("1", "64"):
        assert hush("denoise", two_frames, "--output", tmp_path / dial, "--lambda", dial, "--quiet").returncode == 0
        distance.append(smape(combined(tmp_path / dial / NAMES[0]), combined(two_frames / NAMES[0])))
    assert distance[1] < distance[0]


def test_unknown_and_useless_files_are_refused_by_name(hush: Hush, tmp_path: Path) -> None:
    garbage, empty = tmp_path / "garbage_0001.exr", tmp_path / "empty_0001.exr"
    garbage.write_bytes(b"not an image" * 100)
    empty.touch()
    for path in (tmp_path / "nowhere", tmp_path / "nowhere_####.exr", garbage, empty):
        result = hush("denoise", path, "--output", tmp_path / "out")
        assert result.returncode == 1
        assert path.name.split("_")[0] in result.stderr
        assert "panicked" not in result.stderr
    for path in (tmp_path / "nowhere.exr", garbage, empty):
        result = hush("inspect", path)
        assert result.returncode == 1
        assert path.name in result.stderr
    assert files(tmp_path / "out") == []


def test_help_and_version(hush: Hush) -> None:
    assert hush("--version").stdout.startswith("hush ")
    assert "--keep-noisy" in hush("denoise", "--help").stdout
    assert hush("denoise").returncode == 1

"""The Python module and the command line go through one door: the same folder gives the same pixels and the same answers."""

from __future__ import annotations

import json
import os
import time
from pathlib import Path

import hush
import pytest
from conftest import Hush
from exr_shots import write_shot

SIDE_FILE = 'lambda = 8\nwindow = 1\nkeep_noisy = true\nguides = ["albedo", "vector"]\noutput = "../out"\n'


def pixels(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in sorted(folder.glob("*.exr"))}


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A shot of four small frames."""
    return write_shot(tmp_path_factory.mktemp("small") / "shot", 4)


@pytest.fixture
def with_settings(small: Path, tmp_path: Path) -> Path:
    """A shot with a hush.toml beside its frames."""
    shot = tmp_path / "shot"
    shot.mkdir()
    for path in small.glob("*.exr"):
        (shot / path.name).write_bytes(path.read_bytes())
    (shot / "hush.toml").write_text(SIDE_FILE, encoding="utf-8")
    return shot


def test_what_stands_beside_the_frames_holds_for_both(command_line: Hush, with_settings: Path, tmp_path: Path) -> None:
    told: list[str] = []
    hush.denoise_sequence(with_settings, progress=lambda event: told.append(event.get("message", "")))
    by_module = pixels(tmp_path / "out")
    assert len(by_module) > 1
    assert any("hush.toml" in text and "lambda" in text and "guides" in text for text in told), told
    result = command_line("denoise", with_settings, "--overwrite")
    assert result.returncode == 0, result.stderr
    assert pixels(tmp_path / "out") == by_module
    assert hush.check_sequence(with_settings)["counts"]["stale"] == 0


def test_arguments_win_and_settings_can_be_left_out(with_settings: Path, small: Path, tmp_path: Path) -> None:
    plan = hush.dry_run_sequence(with_settings, tmp_path / "a", lam=2, guides=("albedo", "normal", "vector"))["settings"]
    assert (plan["lambda"], plan["window"], plan["keep_noisy"]) == (2, 1, True)
    assert plan["guides"] == ["albedo", "normal", "vector"]
    bare = hush.dry_run_sequence(with_settings, tmp_path / "a", settings=False)["settings"]
    assert bare == hush.dry_run_sequence(small, tmp_path / "a")["settings"]
    other = tmp_path / "other.toml"
    other.write_text("lambda = 3\n", encoding="utf-8")
    assert hush.dry_run_sequence(with_settings, tmp_path / "a", settings=other)["settings"]["lambda"] == 3


def test_stage_passes_and_rules_can_be_given(small: Path, tmp_path: Path) -> None:
    stage = tmp_path / "shot.usda"
    stage.write_text(
        '#usda 1.0\ndef Scope "Render" {\n def RenderSettings "Settings" {\n  custom float hush:lambda = 4\n }\n}\n', encoding="utf-8"
    )
    assert hush.dry_run_sequence(small, tmp_path / "a", usd=stage)["settings"]["lambda"] == 4
    skip = hush.dry_run_sequence(small, tmp_path / "a", skip=("still",))["settings"]["skip"]
    assert skip == ["still"]
    assert hush.dry_run_sequence(small, tmp_path / "a", skip="none")["settings"]["skip"] == []
    named = hush.dry_run_sequence(small, tmp_path / "a", passes={"beauty": "Combined"})["settings"]
    assert named["passes.beauty"] == "Combined"


def test_a_shot_that_is_switched_off_is_refused(with_settings: Path, tmp_path: Path) -> None:
    (with_settings / "hush.toml").write_text("enable = false\n", encoding="utf-8")
    with pytest.raises(hush.HushError, match="switched off"):
        hush.denoise_sequence(with_settings, tmp_path / "a")
    assert hush.dry_run_sequence(with_settings, tmp_path / "a", enable=True)["frames"]


@pytest.mark.parametrize(
    ("wrong", "error"),
    [
        ({"lamda": 2}, TypeError),
        ({"guides": 3}, TypeError),
        ({"guides": ("colour",)}, ValueError),
        ({"passes": {"colour": "C"}}, ValueError),
        ({"skip": ("fog",)}, ValueError),
        ({"threads": 0}, ValueError),
        ({"usd": ""}, ValueError),
    ],
)
def test_what_is_no_setting_is_refused_by_name(small: Path, tmp_path: Path, wrong: dict[str, object], error: type[Exception]) -> None:
    with pytest.raises(error, match=next(iter(wrong)) if "lamda" not in wrong else "lamda"):
        hush.dry_run_sequence(small, tmp_path / "a", **wrong)  # type: ignore[arg-type]


def test_the_check_says_what_the_run_would_do(command_line: Hush, with_settings: Path, tmp_path: Path) -> None:
    checker = hush.SequenceCheck()
    count = len(list(with_settings.glob("*.exr")))
    assert checker.check(with_settings)["counts"] == {"current": 0, "stale": 0, "missing": count, "unrendered": 0}
    hush.denoise_sequence(with_settings)
    assert checker.check(with_settings)["counts"]["current"] == count
    assert command_line("check", with_settings).returncode == 0
    stale = checker.check(with_settings, lam=9)["frames"]
    assert {(frame["state"], frame["kind"]) for frame in stale} == {("stale", "lambda")}
    result = command_line("check", with_settings, "--lambda", "9", "--json")
    assert result.returncode == 2
    assert json.loads(result.stdout)["frames"] == stale
    assert "out of date: lambda 8 → 9" in command_line("check", with_settings, "--lambda", "9").stdout
    for path in with_settings.glob("*.exr"):
        path.unlink()
    assert {frame["kind"] for frame in checker.check(with_settings)["frames"]} == {"input_missing"}
    gone = checker.check(with_settings / "f_####.exr", tmp_path / "nowhere", frames="1-2")
    assert gone["counts"]["unrendered"] == 2


def bytes_read() -> int:
    """What this process has read so far; 0 where the system does not tell."""
    told = Path("/proc/self/io")
    return int(told.read_text().split("rchar:")[1].split()[0]) if told.exists() else 0


def test_a_second_check_is_cheap(with_settings: Path) -> None:
    hush.denoise_sequence(with_settings)
    checker = hush.SequenceCheck()
    first = checker.check(with_settings)
    path = next(iter(sorted(with_settings.glob("*.exr"))))
    began, before = time.perf_counter(), bytes_read()
    for _ in range(20):
        assert checker.check(with_settings) == first
    assert time.perf_counter() - began < 2.0
    assert bytes_read() - before < path.stat().st_size, "files that did not change were read again"
    os.utime(path, (1, 1))
    assert checker.check(with_settings)["counts"] == first["counts"], "a file that was only touched is the same"
    path.write_bytes(path.read_bytes()[:-20])
    assert checker.check(with_settings)["frames"][0]["kind"] == "input_damaged"


def test_what_can_be_no_setting_is_refused(small: Path, tmp_path: Path) -> None:
    endless: list[object] = []
    endless.append(endless)
    with pytest.raises(ValueError, match="aovs: is nested too deep"):
        hush.dry_run_sequence(small, tmp_path / "out", aovs=endless)  # type: ignore[arg-type]
    with pytest.raises(FileNotFoundError, match="gone\\.usda"):
        hush.dry_run_sequence(small, tmp_path / "out", usd=tmp_path / "gone.usda")
    if os.name != "nt":
        odd = Path(os.fsdecode(os.fsencode(tmp_path) + b"/out\xff"))
        for output in (odd, str(odd)):
            with pytest.raises(ValueError, match="output: "):
                hush.denoise_sequence(small, output)
        assert not list(tmp_path.iterdir()), "a folder of another name was made"

"""The examples in Python run as they stand, beside the wheel that is installed."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import ROOT
from exr_shots import write_shot

EXAMPLES = ROOT / "examples"


def example(name: str, *arguments: str | Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, EXAMPLES / name, *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=600, check=False)


@pytest.mark.parametrize("name", ["one_frame", "sliding_window"])
def test_an_example_in_memory_runs(name: str) -> None:
    result = example(f"python/{name}.py")
    assert result.returncode == 0, result.stderr
    assert "error" in result.stdout


def test_the_example_for_a_file_writes_it(tmp_path: Path) -> None:
    shot = write_shot(tmp_path / "shot", 1)
    source = next(iter(sorted(shot.glob("*.exr"))))
    result = example("python/one_file.py", source, tmp_path / "out")
    assert result.returncode == 0, result.stderr
    assert (tmp_path / "out" / source.name).is_file()


def farm(shot: Path, output: Path, *more: str) -> subprocess.CompletedProcess[str]:
    binary = os.environ.get("HUSH_BIN", str(ROOT / "target" / "release" / "hush"))
    return example("farm_wrapper.py", shot, output, "--hush", binary, "--chunk", "2", *more)


def test_the_farm_wrapper_denoises_all_chunks(tmp_path: Path) -> None:
    shot = write_shot(tmp_path / "shot", 5)
    result = farm(shot, tmp_path / "out", "--frames", "1-5", "--window", "1")
    assert result.returncode == 0, result.stderr
    assert "3 chunks, exit codes [0, 0, 0]" in result.stdout
    assert sorted(p.name for p in (tmp_path / "out").glob("*.exr")) == sorted(p.name for p in shot.glob("*.exr"))


def test_the_farm_wrapper_retries_and_tells_what_failed(tmp_path: Path) -> None:
    shot = write_shot(tmp_path / "shot", 4)
    last = sorted(shot.glob("*.exr"))[-1]
    last.write_bytes(last.read_bytes()[:-100])
    result = farm(shot, tmp_path / "out", "--frames", "1-4", "--window", "0")
    assert result.returncode == 2, result.stdout + result.stderr
    assert "[3-4] exit code 2, trying again" in result.stderr and last.name in result.stderr
    assert "2 chunks, exit codes [0, 2]" in result.stdout


def test_the_farm_wrapper_tells_that_the_program_is_not_there(tmp_path: Path) -> None:
    result = example("farm_wrapper.py", tmp_path, tmp_path / "out", "--frames", "1-4", "--hush", "no-such-hush")
    assert result.returncode == 1 and result.stderr.startswith("--hush: there is no program no-such-hush"), result.stderr


def test_the_farm_wrapper_does_its_sums() -> None:
    result = subprocess.run(
        [sys.executable, "-m", "doctest", EXAMPLES / "farm_wrapper.py"], capture_output=True, text=True, timeout=60, check=False
    )
    assert result.returncode == 0, result.stdout

"""The types of the Python module: complete, true, and no narrower than what runs."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

USE = """
from pathlib import Path

import hush
import numpy as np

color = np.zeros((4, 4, 3), np.float32)
clean = hush.denoise(color, lam=color.max() + np.float32(1))
clean = hush.denoise(color, lam=np.int64(2), out=clean)
for result in hush.Denoiser(0, lam=np.float32(2)).push(color.astype(np.float16), lam=np.float32(2), aovs={"Mist": clean}):
    clean = result.color
hush.dry_run_sequence(Path("shot").glob("*.exr"), "out", lam={1: 2}, frames=np.arange(1, 4), memory="4G")
hush.preview_sheet("shot", 1, Path("a.png"), lam=[1, 4], window=range(2))
settings: hush.SequenceSettings = {"lam": 2.0, "window": 1}
hush.check_sequence("shot", "out", **settings)
hush.main(["denoise", Path("shot")])
"""


@pytest.mark.parametrize("tool", [["mypy.stubtest", "hush", "--concise"], ["mypy", "--strict", "-p", "hush"]])
def test_the_types_are_right(tool: list[str], tmp_path: Path) -> None:
    checked = subprocess.run([sys.executable, "-m", *tool], capture_output=True, text=True, timeout=300, check=False, cwd=tmp_path)
    assert checked.returncode == 0, checked.stdout + checked.stderr


def test_what_runs_is_what_the_types_allow(tmp_path: Path) -> None:
    (tmp_path / "use.py").write_text(USE)
    checked = subprocess.run(
        [sys.executable, "-m", "mypy", "--strict", "use.py"], capture_output=True, text=True, timeout=300, check=False, cwd=tmp_path
    )
    assert checked.returncode == 0, checked.stdout + checked.stderr

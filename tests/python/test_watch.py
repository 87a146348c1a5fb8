"""`hush watch` in short soaks; the long one is `tests/soak.py`."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import pytest
from conftest import ROOT

sys.path.insert(0, str(ROOT / "tests"))
from soak import Settings, describe, soak  # noqa: E402


@pytest.mark.parametrize(("frames", "kills", "watchers"), [(150, 3, 1), (80, 2, 2)])
def test_outputs_are_those_of_a_plain_run(tmp_path: Path, frames: int, kills: int, watchers: int) -> None:
    binary = Path(os.environ.get("HUSH_BIN", ROOT / "target" / "release" / "hush")).resolve()
    settings = Settings(binary, frames, kills, seconds=frames / 10, watchers=watchers)
    result = soak(settings, tmp_path)
    assert not result.problems, describe(settings, result)
    assert len(result.denoised) == frames

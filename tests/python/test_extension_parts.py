"""Parts of the extension that need no Blender: what paths mean one file, and how a process ended."""

from __future__ import annotations

import importlib
import sys
import time
import types
from pathlib import Path

import pytest
from conftest import ROOT


@pytest.fixture
def parts(monkeypatch: pytest.MonkeyPatch) -> types.ModuleType:
    """The add-on's files without the add-on, as its worker has them."""
    made = types.ModuleType("hush_parts")
    made.__path__ = [str(ROOT / "blender_addon")]
    monkeypatch.setitem(sys.modules, "hush_parts", made)
    return made


@pytest.mark.usefixtures("parts")
def test_places_are_the_same_through_links_and_in_other_letter_case(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    paths = importlib.import_module("hush_parts.paths")
    (tmp_path / "Render").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "Render")
    frame, through = tmp_path / "Render" / "Shot_", tmp_path / "link" / ".." / "Render" / "Shot_"
    assert paths.place(frame) == paths.place(str(through)) == paths.place(tmp_path / "link" / "Shot_")
    assert paths.place_of_folder(tmp_path / "link") == paths.place_of_folder(f"{tmp_path / 'Render'}/")
    for ignores in (True, False):
        monkeypatch.setattr(paths, "IGNORES_CASE", ignores)
        assert (paths.place(frame) == paths.place(tmp_path / "Render" / "SHOT_")) == ignores
        assert (paths.folded("Ærø.EXR") == paths.folded("ærø.exr")) == ignores


@pytest.mark.usefixtures("parts")
@pytest.mark.parametrize(
    ("end", "expected"),
    [
        ("os.kill(os.getpid(), 9)", "memory ran out"),
        ("os._exit(137)", "memory ran out"),
        ("os.kill(os.getpid(), 15)", "signal 15"),
        ("print('a bad day', file=sys.stderr, flush=True); os._exit(3)", "exit code 3: a bad day"),
    ],
)
def test_how_a_process_ended_is_told(end: str, expected: str) -> None:
    job = importlib.import_module("hush_parts.jobs.job")
    made = job.Job(
        types.SimpleNamespace(name="Scene", session_uid=1), [sys.executable, "-c", f"import os, sys; sys.stdin.readline(); {end}"], {}
    )
    limit = time.monotonic() + 30
    while not made.ended and time.monotonic() < limit:
        made.poll()
        time.sleep(0.02)
    assert len(made.errors) == 1 and expected in made.errors[0], made.errors

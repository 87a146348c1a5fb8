"""samples/headless.py makes denoised, composited frames from nothing, with the installed extension and with the repository's."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import bpy
import kit
import numpy as np

SCRIPT = Path(kit.__file__).resolve().parents[2] / "samples" / "headless.py"
SMALL = ("--frames", "2", "--size", "64x36", "--samples", "2")


def run(*arguments: str | Path, expected: int = 0, **environment: str) -> str:
    """Runs the script as a user does; returns what it said."""
    command = [sys.executable, str(SCRIPT), *map(str, arguments)]
    result = subprocess.run(
        command, env={**os.environ, **environment}, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, timeout=120, check=False
    )
    assert result.returncode == expected, f"exit code {result.returncode}\n{result.stdout}"
    return result.stdout


def check(folder: Path) -> None:
    names = ["frame_0001", "frame_0002"]
    expected = {f"{place}/{name}.exr" for place in ("noisy", "denoised") for name in names} | {f"composited/{name}.png" for name in names}
    assert set(kit.files(folder)) == expected | {"denoised/hush-manifest.json"}
    noisy, denoised = (kit.layer(folder / place / "frame_0002.exr", "ViewLayer.Combined") for place in ("noisy", "denoised"))
    kit.assert_differs(denoised, noisy, 0.01)
    picture = bpy.data.images.load(str(folder / "composited" / "frame_0002.png"))
    assert tuple(picture.size) == (64, 36)
    assert np.ptp(np.array(picture.pixels[:])) > 0.2, "the picture is empty"


def test_with_the_installed_extension() -> None:
    folder = kit.folder("installed")
    told = run(*SMALL, "--output", folder)
    assert "frame 2 denoised with 1" in told, told
    check(folder)


def test_with_the_extension_of_the_repository() -> None:
    import hush

    if bpy.app.version < (4, 5):
        # As a Python module, 4.2 crashes at its end after any add-on that is not installed as an extension.
        return
    folder = kit.folder("repository")
    run(*SMALL, "--output", folder, BLENDER_USER_RESOURCES=str(kit.folder("nobody")), PYTHONPATH=str(Path(hush.__file__).parents[1]))
    check(folder)


def test_with_motion_blur() -> None:
    folder = kit.folder("blurred")
    told = run(*SMALL, "--motion-blur", "--output", folder)
    assert "Hush Vectors added" in told and "frame 2 denoised with 1" in told, told


def test_wrong_arguments_and_a_missing_library() -> None:
    assert "no size" in run("--size", "big", expected=2)
    assert "above 0" in run("--frames", "0", expected=2)
    told = run(*SMALL, "--output", kit.folder("without"), expected=1, BLENDER_USER_RESOURCES=str(kit.folder("nothing")))
    assert "docs/install.md" in told
    blocked = kit.folder("blocked")
    (blocked / "denoised").write_text("a file where the folder should be")
    assert "is a file" in run(*SMALL, "--output", blocked, expected=1)

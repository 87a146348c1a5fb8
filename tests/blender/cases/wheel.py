"""The wheel inside the zip works in Blender's own Python and with its numpy."""

from __future__ import annotations

import os
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import kit
import numpy as np

USER = Path(os.environ["BLENDER_USER_RESOURCES"]).resolve()


def version() -> str:
    with zipfile.ZipFile(kit.archive()) as archive:
        return tomllib.loads(archive.read("blender_manifest.toml").decode())["version"]


def test_it_is_the_one_from_the_zip() -> None:
    import hush

    place = Path(hush.__file__).resolve()
    assert place.is_relative_to(USER / "extensions" / ".local"), place
    assert hush.__version__ == version()


def test_images_in_memory() -> None:
    import hush

    rng = np.random.default_rng(1)
    noisy = (0.5 + rng.normal(0, 0.2, (32, 48, 3))).astype(np.float32)
    clean = hush.denoise(noisy, lam=1.0)
    assert clean.shape == noisy.shape and clean.dtype == np.float32 and np.isfinite(clean).all()
    assert np.abs(clean - 0.5).mean() < 0.5 * np.abs(noisy - 0.5).mean()


def test_its_errors_reach_python() -> None:
    import hush

    for wrong in (np.zeros((8, 8), np.float32), np.zeros((0, 8, 3), np.float32)):
        try:
            hush.denoise(wrong)
        except (TypeError, ValueError) as error:
            assert str(error)
        else:
            raise AssertionError(f"took an array of shape {wrong.shape}")


def test_the_command_line_comes_along() -> None:
    import hush

    env = {**os.environ, "PYTHONPATH": str(Path(hush.__file__).parents[1])}
    result = subprocess.run([sys.executable, "-m", "hush", "--version"], env=env, capture_output=True, text=True, check=False)
    assert result.returncode == 0 and version() in result.stdout, result.stdout + result.stderr

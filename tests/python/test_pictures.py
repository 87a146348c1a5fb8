"""The script that makes the picture of samples/README.md."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
from conftest import ROOT
from PIL import Image


def test_the_picture_shows_three_different_crops(shot: Path, tmp_path: Path) -> None:
    target = tmp_path / "pair.png"
    script = ROOT / "samples" / "pictures.py"
    options = ["--crop", "200", "60", "40", "30", "--zoom", "2", "--output", str(target)]
    subprocess.run([sys.executable, str(script), str(shot), *options], check=True)
    with Image.open(target) as image:
        pixels = np.asarray(image.convert("RGB")).astype(int)
    height, width = 60, 80
    noisy, same, reference = (pixels[-height:, i * (width + 6) :][:, :width] for i in range(3))
    assert (noisy == same).all()
    assert np.abs(noisy - reference).mean() > 2
    assert noisy.std() > 10

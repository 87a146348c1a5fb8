"""Time with and without what is left out, and the largest difference, on three kinds of made-up shots.

    python benches/leave_out.py target/release/hush

`static`: everything noisy, nothing moves. `background`: a noisy square on a third of the width before an empty, transparent ground.
`converged`: free of noise, half of it flat and half a slow gradient. Five frames of 960×540, the middle one measured by `hush survey`.
Wants numpy and OpenEXR.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import tempfile
from pathlib import Path

import numpy as np
import OpenEXR

ROWS, COLUMNS, FRAMES = 540, 960, 5
Passes = dict[str, np.ndarray]


def base(number: int) -> Passes:
    """An opaque frame of nothing but noise that stands still."""
    r = np.random.default_rng(number)
    full = lambda value, channels: np.full((ROWS, COLUMNS, channels), value, np.float32)
    return {
        "Combined": r.gamma(1.0, 0.5, (ROWS, COLUMNS, 3)).astype(np.float32),
        "Alpha": full(1, 1),
        "Denoising Albedo": full(0.5, 3),
        "Denoising Normal": full(0, 3),
        "Denoising Depth": full(5, 1),
        "Vector": full(0, 4),
    }


def background(number: int) -> Passes:
    passes = base(number)
    empty = np.ones((ROWS, COLUMNS), bool)
    left = 300 + 4 * number
    empty[120:420, left : left + 320] = False
    for name in ("Combined", "Alpha", "Denoising Albedo", "Denoising Depth"):
        passes[name][empty] = 0
    passes["Vector"][~empty] = (-4, 0, -4, 0)
    return passes


def converged(number: int) -> Passes:
    passes = base(number)
    passes["Combined"][:] = 0.4
    passes["Combined"][:, COLUMNS // 2 :] += np.linspace(0, 1, COLUMNS - COLUMNS // 2, dtype=np.float32)[None, :, None]
    return passes


def write(path: Path, passes: Passes) -> None:
    """As Blender does, one part."""
    letters = {"Combined": "RGB", "Denoising Albedo": "RGB", "Denoising Normal": "XYZ", "Denoising Depth": "Z", "Vector": "XYZW"}
    channels = {
        f"ViewLayer.{name}.{c}": np.ascontiguousarray(passes[name][..., i]) for name in letters for i, c in enumerate(letters[name])
    }
    channels["ViewLayer.Combined.A"] = np.ascontiguousarray(passes["Alpha"][..., 0])
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File(header, channels).write(str(path))


def colours(folder: Path) -> np.ndarray:
    """(frames, rows, columns, RGBA)."""
    read = lambda path: OpenEXR.File(str(path), separate_channels=True).parts[0].channels
    files = [read(path) for path in sorted(folder.glob("*.exr"))]
    return np.stack([np.stack([file[f"ViewLayer.Combined.{c}"].pixels for c in "RGBA"], -1) for file in files])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("hush", type=Path, help="the program")
    hush: Path = parser.parse_args().hush
    print(f"{'':12}  seconds without, with   share   largest difference (float16 steps)")
    for name, make in {"static": base, "background": background, "converged": converged}.items():
        with tempfile.TemporaryDirectory() as scratch:
            shot = Path(scratch) / "shot"
            shot.mkdir()
            for number in range(1, FRAMES + 1):
                write(shot / f"f_{number:04d}.exr", make(number))
            survey = json.loads(subprocess.run([hush, "survey", shot, "--json"], capture_output=True, check=True).stdout)
            for folder, options in (("with", []), ("without", ["--skip", "none"])):
                subprocess.run([hush, "denoise", shot, "-o", Path(scratch) / folder, "--quiet", *options], check=True)
            a, b = colours(Path(scratch) / "with"), colours(Path(scratch) / "without")
            step = np.maximum(np.spacing(np.maximum(a, b).astype(np.float16)).astype(np.float64), 2.0**-24)
            time = survey["time"]
            times = f"{time['without']:.3f}, {time['with']:.3f}" if time else "–"
            share = f"{time['with'] / time['without']:.2f}" if time else "–"
            print(f"{name:12}  {times:>21}   {share:>5}   {(np.abs(a - b) / step).max():.4f}")


if __name__ == "__main__":
    main()

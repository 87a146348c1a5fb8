"""Measures the `hush` program itself on the validation shots: each is written as EXR frames, denoised and compared.

    python -m training.benchmark.validate_hush --shots runs/shots --hush target/release/hush

A shot's scores are those of `training.network.measure`. The table, on standard output, has their means; training takes the geometric one
of relMSE.
"""

from __future__ import annotations

import argparse
import subprocess
import tempfile
from pathlib import Path

import numpy as np
import OpenEXR
import torch
from torch import Tensor

from training.benchmark.frames import beauty
from training.benchmark.tables import validation_table
from training.data.shots import Shot, read_held
from training.network.loss import rel_mse, smape

WINDOWS = (0, 1, 2)


def write_frame(shot: Shot, index: int, path: Path) -> None:
    """One frame as Blender 5 writes it: a part for each pass."""
    passes = {
        "Combined": ("RGB", shot.colour[index]),
        "Denoising Albedo": ("RGB", shot.albedo[index]),
        "Denoising Normal": ("XYZ", shot.normal[index]),
        "Denoising Depth": ("Z", shot.depth[index]),
        "Vector": ("XYZW", shot.vector[index]),
    }
    parts = []
    for name, (components, planes) in passes.items():
        channels = {f"ViewLayer.{name}.{c}": np.ascontiguousarray(p.numpy()) for c, p in zip(components, planes, strict=True)}
        header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
        parts.append(OpenEXR.Part(header, channels, f"ViewLayer.{name}"))
    OpenEXR.File(parts).write(str(path))


def main() -> None:
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("--shots", type=Path, nargs="+", required=True, help="folders of NNNNNN.npz; seeds divisible by 8 are measured")
    p.add_argument("--hush", type=Path, required=True, help="the program")
    p.add_argument("--renderer", default="cycles", help="whose encoder to use")
    p.add_argument("--lambda", dest="lam", type=float, default=1.0)
    a = p.parse_args()
    held = read_held(a.shots)
    scores: dict[str, list[tuple[float, float]]] = {"noisy": [], **{f"window {w}": [] for w in WINDOWS}}
    for shot in held:
        reference = shot.reference.clamp_min(0)
        gain = 0.4 / reference.mean().clamp_min(1e-6)

        def score(image: Tensor, reference: Tensor = reference * gain, gain: Tensor = gain) -> tuple[float, float]:
            return float(smape(image * gain, reference).mean()), float(rel_mse(image * gain, reference).mean())

        scores["noisy"].append(score(shot.colour[shot.centre].clamp_min(0)))
        with tempfile.TemporaryDirectory() as folder:
            for index in range(shot.colour.shape[0]):
                write_frame(shot, index, Path(folder) / f"frame_{index:04d}.exr")
            for window in WINDOWS:
                out = Path(folder) / f"window{window}"
                options = ["--window", str(window), "--frames", str(shot.centre), "--lambda", str(a.lam)]
                options += ["--renderer", a.renderer, "--quiet"]
                subprocess.run([a.hush, "denoise", folder, "--output", out, *options], check=True)
                scores[f"window {window}"].append(score(torch.from_numpy(beauty(out / f"frame_{shot.centre:04d}.exr")).permute(2, 0, 1)))
    print(validation_table(scores))


if __name__ == "__main__":
    main()

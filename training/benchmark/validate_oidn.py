"""Measures Open Image Denoise on the validation shots: SMAPE and relMSE of the middle frame, next to the noisy input's.

    python -m training.benchmark.validate_oidn --shots runs/shots > runs/oidn.json

Three rows a shot: `oidn_clean_aux`, as Cycles runs it, first filters the albedo and the normal, each by itself, and says so with
cleanAux; `oidn_high` and `oidn_fast` take them as rendered. Scores and their means are those of validate_hush.py. A markdown table goes to
stderr, the numbers of every shot go to stdout as JSON. Needs pyoidn.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pyoidn
import torch
from torch import Tensor

from training.benchmark import oidn
from training.benchmark.tables import METHODS as NAMES
from training.benchmark.tables import validation_table
from training.data.inputs import prepare
from training.data.shots import Shot, read_held
from training.network.loss import rel_mse, smape

METHODS = ("noisy", *oidn.METHODS)


def interleaved(planes: Tensor) -> oidn.Image:
    """(3, H, W) as (H, W, 3), which OIDN takes."""
    return np.ascontiguousarray(planes.permute(1, 2, 0).numpy(), dtype=np.float32)


def denoised(device: pyoidn.Device, shot: Shot, methods: Sequence[str] = METHODS) -> dict[str, Tensor]:
    """The middle frame of a shot by each method, (3, H, W)."""
    colour = interleaved(shot.colour[shot.centre].clamp_min(0))
    albedo = interleaved(shot.albedo[shot.centre].clamp(0, 1))
    normal = interleaved(shot.normal[shot.centre])
    images = {name: colour if name == "noisy" else oidn.METHODS[name](device, colour, albedo, normal) for name in methods}
    return {name: torch.from_numpy(image).permute(2, 0, 1) for name, image in images.items()}


def main() -> None:
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("--shots", type=Path, nargs="+", required=True, help="folders of NNNNNN.npz; seeds divisible by 8 are measured")
    p.add_argument("--threads", type=int, default=1)
    a = p.parse_args()
    torch.set_num_threads(a.threads)
    held = read_held(a.shots)
    scores: list[dict[str, dict[str, float]]] = []
    with oidn.device(a.threads) as device:
        for shot in held:
            target = prepare(shot, ())
            reference = target["reference"] * target["gain"]
            row: dict[str, dict[str, float]] = {}
            for name, image in denoised(device, shot).items():
                scaled = image * target["gain"]
                row[name] = {"smape": float(smape(scaled, reference).mean()), "rel_mse": float(rel_mse(scaled, reference).mean())}
            scores.append(row)
    mean = {m: {k: float(np.mean([s[m][k] for s in scores])) for k in ("smape", "rel_mse")} for m in METHODS}
    print(validation_table({NAMES[m]: [(s[m]["smape"], s[m]["rel_mse"]) for s in scores] for m in METHODS}), file=sys.stderr)
    shots = [{"seed": shot.seed, "spp": shot.spp, **row} for shot, row in zip(held, scores, strict=True)]
    print(json.dumps({"pyoidn": version("pyoidn"), "mean": mean, "shots": shots}, indent=1))


if __name__ == "__main__":
    main()

"""Measures the encoders of a weights file on another renderer's validation shots, beside the noisy image and OIDN.

    python -m training.encoder.measure --weights models/hush.safetensors --shots runs/mitsuba

SMAPE and relMSE of the middle frames at λ 1, with the means of benchmark/validate_hush.py; a table on standard output.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import torch
from torch import Tensor

from training.benchmark import oidn
from training.benchmark.tables import METHODS, validation_table
from training.benchmark.validate_oidn import denoised
from training.data.inputs import prepare
from training.data.shots import OFFSETS, read_held
from training.network.loss import rel_mse, smape
from training.network.weights_file import WeightsFile


@torch.no_grad()
def main() -> None:
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("--weights", type=Path, required=True)
    p.add_argument("--shots", type=Path, nargs="+", required=True, help="folders of NNNNNN.npz; seeds divisible by 8 are measured")
    p.add_argument("--threads", type=int, default=1)
    a = p.parse_args()
    torch.set_num_threads(a.threads)
    held = read_held(a.shots)
    file = WeightsFile.read(a.weights)
    scores: dict[str, list[tuple[float, float]]] = {}
    with oidn.device(a.threads) as device:
        nets = {name: file.network(name) for name in file.renderers()}
        for shot in held:
            images: dict[str, Tensor] = {METHODS[name]: image for name, image in denoised(device, shot).items()}
            for window, offsets in ((0, ()), (2, OFFSETS)):
                batch = {name: value[None] for name, value in prepare(shot, offsets, epsilon=file.architecture().albedo_epsilon).items()}
                for name, net in nets.items():
                    images[f"Hush, window {window}, {name} encoder"] = net(batch, torch.ones(1))["image"][0]
            target = prepare(shot, ())
            reference = target["reference"] * target["gain"]
            for name, image in images.items():
                scaled = image * target["gain"]
                scores.setdefault(name, []).append((float(smape(scaled, reference).mean()), float(rel_mse(scaled, reference).mean())))
    print(validation_table(scores))


if __name__ == "__main__":
    main()

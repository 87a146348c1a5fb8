"""Writes the averaged weights of checkpoints, and their architecture, as the safetensors file that the Rust core embeds.

    python -m training.network.export runs/first/checkpoint.pt --out models/hush.safetensors --shots runs/shots

Of several checkpoints, of runs that began alike and differ in their `--seed`, it writes the mean.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import torch

from training.data.resident import Resident
from training.data.shots import held_paths
from training.network.measure import everything, scores
from training.network.weights_file import Trained, WeightsFile, mean_of


def main() -> None:
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("checkpoints", type=Path, nargs="+")
    p.add_argument("--out", type=Path, required=True, help="the weights file")
    p.add_argument("--shots", type=Path, nargs="+", required=True, help="folders of shots; measures on their validation split")
    p.add_argument("--without", nargs="+", default=[], help="residual blocks to leave out, that ablate.py found worthless: eighth.0")
    p.add_argument("--device", default="cpu", choices=("cpu", "cuda", "mps"))
    p.add_argument("--threads", type=int, default=1)
    a = p.parse_args()
    torch.set_num_threads(a.threads)
    states = [torch.load(path, weights_only=True, map_location="cpu") for path in a.checkpoints]
    mean = mean_of([Trained.of_checkpoint(state) for state in states]).without(a.without)
    tensors = {k: v.to(torch.float16).contiguous() for k, v in mean.weights.items()}
    rounded = Trained(mean.architecture, {k: v.float() for k, v in tensors.items()})
    held = Resident(torch.device(a.device))
    held.read(held_paths(a.shots))
    found = scores(rounded.network().to(held.device), everything(held))
    measured = {"smape_window_2": found["smape_2"], "smape_window_0": found["smape_0"]}
    header = {
        "hush.architecture": json.dumps(mean.architecture.header(), separators=(",", ":")),
        "hush.training": json.dumps(
            {
                "steps": sum(state["step"] for state in states),
                "seconds": round(sum(state["spent"] for state in states)),
                "seeds": sorted({seed for state in states for seed in state["seeds"]}),
            }
        ),
        "hush.validation": json.dumps({"seeds": held.seeds, **measured}),
    }
    WeightsFile(tensors, header).write(a.out)
    print(json.dumps(measured), a.out.stat().st_size, "bytes")


if __name__ == "__main__":
    main()

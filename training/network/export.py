"""Writes the averaged weights of checkpoints as the safetensors file that the Rust core embeds.

    python -m training.network.export runs/first/checkpoint.pt --out models/hush.safetensors --shots runs/shots

Of several checkpoints, of runs that began alike and differ in their `--seed`, it writes the mean.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import torch
from safetensors.torch import save_file

from training.data.shots import OFFSETS, is_held, read_shot, shot_paths
from training.network.model import Architecture, Hush
from training.network.train import averaged_of, mean_of, validate


def main() -> None:
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("checkpoints", type=Path, nargs="+")
    p.add_argument("--out", type=Path, required=True, help="the weights file")
    p.add_argument("--shots", type=Path, nargs="+", required=True, help="folders of shots; measures on their validation split")
    p.add_argument("--threads", type=int, default=1)
    a = p.parse_args()
    torch.set_num_threads(a.threads)
    states = [torch.load(path, weights_only=True, map_location="cpu") for path in a.checkpoints]
    net = Hush(Architecture())
    tensors = {k: v.to(torch.float16).contiguous() for k, v in mean_of([averaged_of(state) for state in states]).items()}
    net.load_state_dict({k: v.float() for k, v in tensors.items()})
    net.eval()
    held = [read_shot(path) for path in shot_paths(a.shots) if is_held(path)]
    measured = {"smape_window_2": validate(net, held, OFFSETS), "smape_window_0": validate(net, held, ())}
    header = {
        "hush.architecture": json.dumps(net.arch.header(), separators=(",", ":")),
        "hush.training": json.dumps(
            {
                "steps": sum(state["step"] for state in states),
                "seconds": round(sum(state["spent"] for state in states)),
                "seeds": sorted({seed for state in states for seed in state["seeds"]}),
            }
        ),
        "hush.validation": json.dumps({"seeds": [s.seed for s in held], **measured}),
    }
    save_file(tensors, a.out, metadata=header)
    print(json.dumps(measured), a.out.stat().st_size, "bytes")


if __name__ == "__main__":
    main()

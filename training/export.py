"""Writes a checkpoint's averaged weights as the safetensors file that the Rust core embeds.

python export.py runs/first/checkpoint.pt ../models/hush.safetensors --shots shots
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import torch
from data import OFFSETS, is_held, read_shot, shot_paths
from model import Architecture, Hush
from safetensors.torch import save_file
from train import averaged, validate


def main() -> None:
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("checkpoint", type=Path)
    p.add_argument("weights", type=Path)
    p.add_argument("--shots", type=Path, nargs="+", required=True, help="folders of shots; measures on their validation split")
    p.add_argument("--threads", type=int, default=1)
    a = p.parse_args()
    torch.set_num_threads(a.threads)
    state = torch.load(a.checkpoint, weights_only=True, map_location="cpu")
    net = Hush(Architecture())
    tensors = {k: v.to(torch.float16).contiguous() for k, v in averaged(a.checkpoint).items()}
    net.load_state_dict({k: v.float() for k, v in tensors.items()})
    net.eval()
    held = [read_shot(path) for path in shot_paths(a.shots) if is_held(path)]
    measured = {"smape_window_2": validate(net, held, OFFSETS), "smape_window_0": validate(net, held, ())}
    header = {
        "hush.architecture": json.dumps(net.arch.header(), separators=(",", ":")),
        "hush.training": json.dumps({"steps": state["step"], "seconds": round(state["spent"]), "seeds": state["seeds"]}),
        "hush.validation": json.dumps({"seeds": [s.seed for s in held], **measured}),
    }
    save_file(tensors, a.weights, metadata=header)
    print(json.dumps(measured), a.weights.stat().st_size, "bytes")


if __name__ == "__main__":
    main()

"""Trains a source encoder for another renderer. Everything behind it stays as it is, and so does the first encoder.

    python -m training.encoder.train --weights models/hush.safetensors --shots runs/mitsuba --renderer mitsuba --normals world \
        --out runs/encoder --minutes 15 --bf16 --fused

Starts from the first renderer's encoder. Resumable: start it again with the same folder and it goes on. At the end it measures both
encoders on the validation shots and adds the new one to the weights file, `--write` to write another.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import re
import time
from dataclasses import dataclass, field
from pathlib import Path

import torch
from torch.optim import AdamW
from torch.optim.swa_utils import AveragedModel, get_ema_multi_avg_fn

from training.data.batches import Batches, Recipe
from training.data.resident import Resident
from training.data.shots import held_paths, is_held, shot_paths
from training.network import fused
from training.network.measure import everything, scores
from training.network.model import Hush
from training.network.objective import objective
from training.network.train import keep_memory
from training.network.weights_file import WeightsFile


@dataclass
class Run:
    """The state of a training run; `checkpoint.pt` in its folder holds all of it."""

    folder: Path
    source: str
    net: Hush
    mean: AveragedModel
    optimiser: AdamW
    step: int = 0
    spent: float = 0.0
    log: list[str] = field(default_factory=list)

    def resume(self) -> None:
        path = self.folder / "checkpoint.pt"
        if not path.exists():
            return
        state = torch.load(path, weights_only=True)
        if state["source"] != self.source:
            raise SystemExit(f"{path} belongs to other weights: choose another folder, or remove it")
        self.net.encoder.load_state_dict(state["encoder"])
        self.mean.load_state_dict(state["mean"])
        self.optimiser.load_state_dict(state["optimiser"])
        self.step, self.spent = state["step"], state["spent"]

    def save(self) -> None:
        parts = {"encoder": self.net.encoder.state_dict(), "mean": self.mean.state_dict(), "optimiser": self.optimiser.state_dict()}
        aside = self.folder / "checkpoint.tmp"
        torch.save({**parts, "source": self.source, "step": self.step, "spent": self.spent}, aside)
        os.replace(aside, self.folder / "checkpoint.pt")


def train(run: Run, shots: Resident, a: argparse.Namespace) -> None:
    """Trains the encoder for as long as is left of `--minutes`."""
    batches = Batches(shots, Recipe(outputs=a.batch, epsilon=run.net.arch.albedo_epsilon, turned=a.normals == "world"), run.step + 31)
    begun, running = time.monotonic() - run.spent, None
    while (spent := time.monotonic() - begun) < a.minutes * 60:
        done = spent / (a.minutes * 60)
        rate = a.rate * min(1.0, (run.step + 1) / 100) * max(0.005, 0.5 * (1 + math.cos(math.pi * done)))
        for group in run.optimiser.param_groups:
            group["lr"] = rate
        with torch.autocast("cpu", torch.bfloat16, enabled=a.bf16):
            loss = objective(run.net, batches.draw())
        run.optimiser.zero_grad(set_to_none=True)
        loss.backward()
        if torch.isfinite(torch.nn.utils.clip_grad_norm_(run.net.encoder.parameters(), 1.0)):
            run.optimiser.step()
            run.mean.update_parameters(run.net.encoder)
        run.step += 1
        run.spent = spent
        running = float(loss.detach()) if running is None else 0.99 * running + 0.01 * float(loss.detach())
        if run.step % 100 == 0:
            print(f"step {run.step} loss {running:.4f} rate {rate:.2e} {spent / run.step:.3f} s/step", flush=True)
        if run.step % 500 == 0:
            run.save()
    run.spent = a.minutes * 60
    run.save()


def main() -> None:
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("--weights", type=Path, required=True, help="the weights file to start from")
    p.add_argument("--shots", type=Path, nargs="+", required=True, help="folders of NNNNNN.npz; seeds divisible by 8 are for validation")
    p.add_argument("--renderer", required=True, help="its name, a to z, 0 to 9, - and _; what --renderer will take")
    p.add_argument("--out", type=Path, required=True, help="folder for the checkpoint")
    p.add_argument("--write", type=Path, help="weights file to write [default: the one of --weights]")
    p.add_argument("--normals", choices=("camera", "world"), default="camera", help="the space that the renderer's normals are in")
    p.add_argument("--minutes", type=float, default=15.0, help="wall-clock time of the whole schedule, resumed runs included")
    p.add_argument("--batch", type=int, default=4, help="denoised frames a step")
    p.add_argument("--rate", type=float, default=1e-3)
    p.add_argument("--threads", type=int, default=1)
    p.add_argument("--bf16", action="store_true", help="convolutions in bfloat16 (fast on CPUs with AVX512-BF16)")
    p.add_argument("--fused", action="store_true", help="apply the kernels in C++ (needs g++): twice as fast")
    a = p.parse_args()
    if not re.fullmatch("[a-z0-9_-]+", a.renderer):
        p.error(f"--renderer {a.renderer!r} must be made of a to z, 0 to 9, - and _")
    torch.set_num_threads(a.threads)
    keep_memory()
    a.out.mkdir(parents=True, exist_ok=True)
    file = WeightsFile.read(a.weights)
    if a.renderer == file.renderers()[0]:
        raise SystemExit(f"{a.renderer} is the renderer that the whole network was trained for")
    shots, held = Resident(torch.device("cpu")), Resident(torch.device("cpu"))
    held.read(held_paths(a.shots))
    shots.read(path for path in shot_paths(a.shots) if not is_held(path))
    if not len(shots):
        raise SystemExit(f"no training shots in {', '.join(map(str, a.shots))}: NNNNNN.npz with seeds not divisible by 8")
    torch.manual_seed(1)
    net = file.network().to(memory_format=torch.channels_last)
    if a.fused:
        net.average = fused.average
    net.requires_grad_(False)
    net.encoder.requires_grad_(True)
    mean = AveragedModel(net.encoder, multi_avg_fn=get_ema_multi_avg_fn(0.995))
    optimiser = AdamW(net.encoder.parameters(), lr=a.rate, betas=(0.9, 0.99), weight_decay=1e-4)
    run = Run(a.out, file.fingerprint(), net, mean, optimiser)
    run.resume()
    train(run, shots, a)
    encoder = {k: v.to(torch.float16).contiguous() for k, v in mean.module.state_dict().items()}
    measured: dict[str, object] = {"seeds": held.seeds}
    for who, tensors in ((f"{file.renderers()[0]}_encoder_", file.network().encoder.state_dict()), ("", encoder)):
        net.encoder.load_state_dict({k: v.float() for k, v in tensors.items()})
        found = scores(net, everything(held))
        measured |= {f"{who}smape_window_{window}": found[f"smape_{window}"] for window in (2, 0)}
    training = {"steps": run.step, "seconds": round(run.spent), "seeds": shots.seeds}
    file.add(a.renderer, encoder, {"training": training, "validation": measured})
    file.write(a.write or a.weights)
    print(json.dumps(measured))


if __name__ == "__main__":
    main()

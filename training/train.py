"""Trains the network. Resumable: start it again with the same folder and it goes on.

python train.py --shots shots --out runs/first --hours 2
"""

from __future__ import annotations

import argparse
import json
import math
import os
import random
import time
from dataclasses import dataclass
from pathlib import Path

import torch
import torch.nn.functional as F
from data import OFFSETS, Guides, Shot, cropped, oriented, prepare, read_split
from loss import asymmetric, smape
from model import LAMBDA_MAX, Architecture, Hush
from torch import Tensor
from torch.optim import AdamW
from torch.optim.swa_utils import AveragedModel, get_ema_multi_avg_fn


def example(r: random.Random, shots: list[Shot], size: int) -> dict[str, Tensor]:
    """One random crop, augmented: mirrored, tinted, guides and neighbours dropped at random."""
    shot = oriented(r.choice(shots), r.random() < 0.5, r.random() < 0.5, r.random() < 0.5)
    order = r.sample(range(3), 3)
    tint = torch.tensor([math.exp(r.gauss(0, 0.25)) for _ in range(3)]).view(3, 1, 1)
    shot.colour = shot.colour[:, order] * tint
    shot.reference = shot.reference[order] * tint
    shot.albedo = shot.albedo[:, order]
    guides = Guides(r.random() >= 0.08, r.random() >= 0.12, r.random() >= 0.12)
    batch = prepare(shot, OFFSETS, guides)
    h, w = batch["noisy"].shape[-2:]
    row, column = 8 * r.randint(0, (h - size) // 8), 8 * r.randint(0, (w - size) // 8)
    batch = cropped(batch, row, column, size)
    drop = r.random()
    if drop < 0.3:
        keep = 0.0 if drop < 0.12 else 0.5
        gone = torch.tensor([float(r.random() < keep) for _ in OFFSETS]).view(-1, 1, 1, 1)
        batch["extras"][:, :6] *= gone
        for name in ("valid", "colour", "albedo"):
            batch[name] = torch.cat((batch[name][:1], batch[name][1:] * gone))
    lam = 1.0 if r.random() < 0.5 else LAMBDA_MAX ** r.random()
    batch["lam"] = torch.tensor(lam)
    return batch


def collate(parts: list[dict[str, Tensor]]) -> dict[str, Tensor]:
    return {k: torch.stack([p[k] for p in parts]) for k in parts[0]}


def objective(net: Hush, batch: dict[str, Tensor]) -> Tensor:
    """The loss of a batch, on images scaled so that the reference's mean is 0.4.

    The asymmetric loss of the final image, weighted 2 / (1 + √λ) so that no λ outweighs the others; 0.1 and 0.05 of the SMAPE of
    the demodulated half and quarter levels; 0.1 of the SMAPE of the final image at half resolution, against blotches.
    """
    lam = batch["lam"]
    out = net(batch, lam)
    gain = batch["gain"].view(-1, 1, 1, 1)
    reference, noisy = batch["reference"] * gain, batch["noisy"] * gain
    weight = (2.0 / (1.0 + lam.sqrt())).view(-1, 1, 1, 1)
    total = (asymmetric(out["image"] * gain, reference, noisy, lam) * weight).mean()
    base = batch["reference"] / batch["albedo"][:, 0].clamp_min(0.05) * gain
    for level, share in (("half", 0.1), ("quarter", 0.05)):
        base = F.avg_pool2d(base, 2)
        total = total + share * smape(out[level] * gain, base).mean()
    return total + 0.1 * smape(F.avg_pool2d(out["image"] * gain, 2), F.avg_pool2d(reference, 2)).mean()


@torch.no_grad()
def validate(net: Hush, shots: list[Shot], offsets: tuple[int, ...], lam: float = 1.0) -> float:
    """Mean SMAPE over the shots' centre frames, the reference scaled to mean 0.4."""
    total = 0.0
    for shot in shots:
        batch = collate([prepare(shot, offsets)])
        image = net(batch, torch.tensor([lam]))["image"]
        gain = batch["gain"].view(-1, 1, 1, 1)
        total += float(smape(image * gain, batch["reference"] * gain).mean())
    return total / len(shots)


@dataclass
class Run:
    """The state of a training run; `checkpoint.pt` in its folder holds all of it."""

    folder: Path
    net: Hush
    mean: AveragedModel
    optimiser: AdamW
    step: int = 0
    spent: float = 0.0

    def resume(self) -> None:
        """Goes on where the folder's checkpoint was written; from the start where there is none."""
        path = self.folder / "checkpoint.pt"
        if not path.exists():
            return
        state = torch.load(path, weights_only=True)
        self.net.load_state_dict(state["net"])
        self.mean.load_state_dict(state["mean"])
        self.optimiser.load_state_dict(state["optimiser"])
        self.step, self.spent = state["step"], state["spent"]

    def record(self, held: list[Shot], loss: float) -> None:
        """Validates the averaged weights, adds a line to log.jsonl and writes the checkpoint."""
        net = self.mean.module
        scores = {"window2": validate(net, held, OFFSETS), "window0": validate(net, held, ())}
        line = json.dumps({"step": self.step, "spent": self.spent, "loss": loss, **scores})
        print(line, flush=True)
        with (self.folder / "log.jsonl").open("a") as log:
            log.write(line + "\n")
        parts = {"net": self.net.state_dict(), "mean": self.mean.state_dict(), "optimiser": self.optimiser.state_dict()}
        aside = self.folder / "checkpoint.tmp"
        torch.save({**parts, "step": self.step, "spent": self.spent}, aside)
        os.replace(aside, self.folder / "checkpoint.pt")


def main() -> None:
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("--shots", type=Path, required=True)
    p.add_argument("--out", type=Path, required=True)
    p.add_argument("--hours", type=float, default=2.0, help="wall-clock hours of the whole schedule, resumed runs included")
    p.add_argument("--batch", type=int, default=4)
    p.add_argument("--crop", type=int, default=96)
    p.add_argument("--rate", type=float, default=1e-3)
    p.add_argument("--threads", type=int, default=1)
    p.add_argument("--bf16", action="store_true", help="convolutions in bfloat16 (fast on CPUs with AVX512-BF16)")
    p.add_argument("--every", type=int, default=1000, help="steps between checkpoints and validations")
    a = p.parse_args()
    torch.set_num_threads(a.threads)
    a.out.mkdir(parents=True, exist_ok=True)
    train, held = read_split(a.shots)
    torch.manual_seed(1)
    net = Hush(Architecture()).to(memory_format=torch.channels_last)
    mean = AveragedModel(net, multi_avg_fn=get_ema_multi_avg_fn(0.999))
    optimiser = AdamW(net.parameters(), lr=a.rate, betas=(0.9, 0.99), weight_decay=1e-4)
    run = Run(a.out, net, mean, optimiser)
    run.resume()
    recorded = run.step
    r = random.Random(run.step + 17)
    begun, running = time.monotonic() - run.spent, None
    while (spent := time.monotonic() - begun) < a.hours * 3600:
        done = spent / (a.hours * 3600)
        rate = a.rate * min(1.0, (run.step + 1) / 200) * max(0.005, 0.5 * (1 + math.cos(math.pi * done)))
        for group in optimiser.param_groups:
            group["lr"] = rate
        batch = collate([example(r, train, a.crop) for _ in range(a.batch)])
        with torch.autocast("cpu", torch.bfloat16, enabled=a.bf16):
            loss = objective(net, batch)
        optimiser.zero_grad(set_to_none=True)
        loss.backward()
        norm = torch.nn.utils.clip_grad_norm_(net.parameters(), 1.0)
        if torch.isfinite(norm):
            optimiser.step()
            mean.update_parameters(net)
        run.step += 1
        run.spent = spent
        value = float(loss.detach())
        running = value if running is None else 0.99 * running + 0.01 * value
        if run.step % 100 == 0:
            print(f"step {run.step} loss {running:.4f} rate {rate:.2e} {spent / run.step:.3f} s/step", flush=True)
        if run.step % a.every == 0:
            run.record(held, running)
            recorded = run.step
    if running is not None and run.step > recorded:
        run.spent = spent  # the schedule's end, so that starting again trains no further
        run.record(held, running)


if __name__ == "__main__":
    main()

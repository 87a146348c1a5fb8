"""Trains the network. Resumable: start it again with the same folder and it goes on.

    python train.py --shots ../../shared/data/shots --out runs/first --hours 2
"""

from __future__ import annotations

import argparse
import json
import math
import os
import random
import time
from pathlib import Path

import torch
from data import OFFSETS, Guides, Shot, cropped, oriented, prepare, read_split
from loss import asymmetric, smape
from model import LAMBDA_MAX, Architecture, Hush
from torch import Tensor


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
    lam = batch["lam"]
    out = net(batch, lam)
    gain = batch["gain"].view(-1, 1, 1, 1)
    reference, noisy = batch["reference"] * gain, batch["noisy"] * gain
    weight = (2.0 / (1.0 + lam.sqrt())).view(-1, 1, 1, 1)
    total = (asymmetric(out["image"] * gain, reference, noisy, lam) * weight).mean()
    base = batch["reference"] / batch["albedo"][:, 0].clamp_min(0.05) * gain
    for level, share in (("half", 0.1), ("quarter", 0.05)):
        base = torch.nn.functional.avg_pool2d(base, 2)
        total = total + share * smape(out[level] * gain, base).mean()
    clean = torch.nn.functional.avg_pool2d(reference, 2)
    return total + 0.1 * smape(torch.nn.functional.avg_pool2d(out["image"] * gain, 2), clean).mean()


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
    mean = torch.optim.swa_utils.AveragedModel(net, multi_avg_fn=torch.optim.swa_utils.get_ema_multi_avg_fn(0.999))
    optimiser = torch.optim.AdamW(net.parameters(), lr=a.rate, betas=(0.9, 0.99), weight_decay=1e-4)
    step, spent = 0, 0.0
    checkpoint = a.out / "checkpoint.pt"
    if checkpoint.exists():
        state = torch.load(checkpoint, weights_only=True)
        net.load_state_dict(state["net"])
        mean.load_state_dict(state["mean"])
        optimiser.load_state_dict(state["optimiser"])
        step, spent = state["step"], state["spent"]
    r = random.Random(step + 17)
    log = (a.out / "log.jsonl").open("a")
    begun, running = time.monotonic() - spent, None
    while True:
        spent = time.monotonic() - begun
        done = spent / (a.hours * 3600)
        if done >= 1.0:
            break
        rate = a.rate * min(1.0, (step + 1) / 200) * max(0.005, 0.5 * (1 + math.cos(math.pi * done)))
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
        step += 1
        value = float(loss.detach())
        running = value if running is None else 0.99 * running + 0.01 * value
        last = time.monotonic() - begun >= a.hours * 3600
        if step % 100 == 0:
            print(f"step {step} loss {running:.4f} rate {rate:.2e} {spent / step:.3f} s/step", flush=True)
        if step % a.every == 0 or last:
            smoothed = mean.module
            row = {"step": step, "spent": spent, "loss": running, "window2": validate(smoothed, held, OFFSETS), "window0": validate(smoothed, held, ())}
            print(json.dumps(row), flush=True)
            log.write(json.dumps(row) + "\n")
            log.flush()
            state = {"net": net.state_dict(), "mean": mean.state_dict(), "optimiser": optimiser.state_dict(), "step": step, "spent": spent}
            torch.save(state, checkpoint.with_suffix(".tmp"))
            os.replace(checkpoint.with_suffix(".tmp"), checkpoint)


if __name__ == "__main__":
    main()

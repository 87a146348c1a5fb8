"""Trains the network. Resumable: start it again with the same folder and it goes on.

python -m training.network.train --shots runs/shots --out runs/first --hours 2 --fused
"""

from __future__ import annotations

import argparse
import ctypes
import json
import math
import os
import random
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

import torch
import torch.nn.functional as F
from torch import Tensor
from torch.optim.swa_utils import AveragedModel, get_ema_multi_avg_fn

from training.data.inputs import Guides, frames, prepare, view
from training.data.shots import OFFSETS, Shot, is_held, oriented, read_shot, shot_paths
from training.network import fused
from training.network.loss import asymmetric, flicker, smape
from training.network.model import LAMBDA_MAX, Architecture, Hush, warped
from training.network.muon import Both

Batch = dict[str, Tensor]
TEMPORAL = 0.75
PAIRED = 0.2  # of the batches are of two frames in a row on purpose, others by chance
ALONE = 0.35  # of the batches are of window 0, at a third of the price
M_TRIM_THRESHOLD, M_TOP_PAD, M_MMAP_THRESHOLD = -1, -2, -3  # of malloc.h


def augmented(r: random.Random, shot: Shot) -> Shot:
    """The shot mirrored, its channels in another order, tinted."""
    shot = oriented(shot, r.random() < 0.5, r.random() < 0.5, r.random() < 0.5)
    order = r.sample(range(3), 3)
    tint = torch.tensor([math.exp(r.gauss(0, 0.25)) for _ in range(3)]).view(3, 1, 1)
    shot.colour = shot.colour[:, order] * tint
    shot.references = {k: x[order] * tint for k, x in shot.references.items()}
    shot.albedo = shot.albedo[:, order]
    return shot


def neighbours(r: random.Random, shot: Shot) -> tuple[int, ...]:
    """Most often ±1 and ±2; sometimes four from up to ±3, where the shot has them."""
    near = shot.window(shot.centre)
    return OFFSETS if len(near) == len(OFFSETS) or r.random() < 0.85 else tuple(r.sample(near, len(OFFSETS)))


def example(r: random.Random, shot: Shot, alone: bool) -> tuple[Tensor, list[Batch], Tensor]:
    """One shot, augmented, guides and neighbours dropped at random: the frames' inputs, a view of each frame that has a reference,
    the later one first, and λ. `alone`: no neighbours at all, and the inputs of the viewed frames only."""
    shot = augmented(r, shot)
    of = frames(shot, Guides(r.random() >= 0.05, r.random() >= 0.06, r.random() >= 0.06))
    offsets, drop = () if alone else neighbours(r, shot), r.random()
    keep = 0.0 if drop < 0.12 else 0.5 if drop < 0.3 else 1.0
    gone = torch.tensor([float(r.random() < keep) for _ in offsets]).view(-1, 1, 1, 1)
    centres = sorted(shot.references, reverse=True)
    views = []
    for i, centre in enumerate(centres):
        # The frame before sees the same frames as far as it reaches, and mirrors the rest.
        reach = [k if 0 <= centre + k < len(shot.depth) else -k for k in offsets]
        seen = view(shot, of, centre, reach)
        seen["extras"][:, :6] *= gone
        for name in ("valid", "colour", "albedo"):
            seen[name] = torch.cat((seen[name][:1], seen[name][1:] * gone))
        seen["frames"] = torch.tensor([i] if alone else [centre, *(centre + k for k in reach)])
        views.append(seen)
    if len(views) > 1:
        position, trust, _ = shot.path(shot.centre, -1)
        views[0] |= {"before": position.nan_to_num(0.0), "followed": trust[None].float()}
    return of.inputs[centres] if alone else of.inputs, views, torch.tensor(1.0 if r.random() < 0.65 else LAMBDA_MAX ** r.random())


def collate(parts: list[Batch]) -> Batch:
    return {k: torch.stack([p[k] for p in parts]) for k in parts[0]}


def batch_of(r: random.Random, shots: list[Shot], outputs: int) -> tuple[Tensor, list[Batch], Tensor]:
    """Shots of the same kind, one or two references each, `outputs` denoised frames in all."""
    kinds = [len(s.references) for s in shots]
    kind = max(kinds) if r.random() < PAIRED else r.choice(kinds)
    alike = [s for s in shots if len(s.references) == kind]
    alone = r.random() < ALONE
    inputs, views, lam = zip(*(example(r, r.choice(alike), alone) for _ in range(max(1, outputs // kind))), strict=True)
    return torch.stack(inputs), [collate(list(v)) for v in zip(*views, strict=True)], torch.stack(lam)


def still_loss(out: Batch, view: Batch, lam: Tensor) -> Tensor:
    """The loss of one frame, on images scaled so that the reference's mean is 0.4.

    The asymmetric loss of the final image, weighted 2 / (1 + √λ) so that no λ outweighs the others; 0.1 and 0.05 of the SMAPE of
    the demodulated half and quarter levels; 0.1 of the SMAPE of the final image at half resolution, against blotches. Shots of many
    samples, whose errors are small, count more.
    """
    gain = view["gain"].view(-1, 1, 1, 1)
    reference, noisy = view["reference"] * gain, view["noisy"] * gain
    effort = view["effort"].view(-1, 1, 1, 1)
    weight = (2.0 / (1.0 + lam.sqrt())).view(-1, 1, 1, 1)
    total = (asymmetric(out["image"] * gain, reference, noisy, lam) * weight * effort).mean()
    base = view["reference"] / view["albedo"][:, 0].clamp_min(0.05) * gain
    for level, share in (("half", 0.1), ("quarter", 0.05)):
        base = F.avg_pool2d(base, 2)
        total = total + share * (smape(out[level] * gain, base) * effort).mean()
    return total + 0.1 * (smape(F.avg_pool2d(out["image"] * gain, 2), F.avg_pool2d(reference, 2)) * effort).mean()


def temporal_loss(out: list[Batch], views: list[Batch], lam: Tensor) -> Tensor:
    """`loss.flicker` of two frames in a row, 1 / λ of it: what noise is left to be seen flickers too."""
    gain = views[0]["gain"].view(-1, 1, 1, 1)
    now, before = ((o["image"] * gain, v["reference"] * gain) for o, v in zip(out, views, strict=True))
    changes = flicker(*now, warped(before[0] - before[1], views[0]["before"]), views[0]["followed"])
    return (changes / lam.view(-1, 1, 1, 1)).mean()


def objective(net: Hush, inputs: Tensor, views: list[Batch], lam: Tensor, temporal: float) -> Tensor:
    """The loss of a batch of shots: the mean of its frames', and `temporal` times the temporal loss where there are two."""
    features = net.encode(inputs)
    rows = torch.arange(len(inputs))[:, None]
    out = [net.denoise(features[rows, v["frames"]], v, lam) for v in views]
    total = sum(still_loss(o, v, lam) for o, v in zip(out, views, strict=True)) / len(views)
    return total + temporal * temporal_loss(out, views, lam) if len(views) > 1 else total


@torch.no_grad()
def validate_blocks(net: Hush, shots: list[Shot], offsets: tuple[int, ...], blocks: tuple[int, ...]) -> list[float]:
    """Mean SMAPE over the shots' middle frames at λ 1, the reference scaled to mean 0.4, of the means over blocks of pixels of each
    size: the references' own noise counts less in larger ones."""
    totals = [0.0] * len(blocks)
    for shot in shots:
        batch = collate([prepare(shot, offsets)])
        image = net(batch, torch.ones(1))["image"]
        gain = batch["gain"].view(-1, 1, 1, 1)
        for k, block in enumerate(blocks):
            totals[k] += float(smape(*(F.avg_pool2d(x * gain, block) for x in (image, batch["reference"]))).mean())
    return [total / len(shots) for total in totals]


def validate(net: Hush, shots: list[Shot], offsets: tuple[int, ...]) -> float:
    """As `validate_blocks`, of the pixels themselves."""
    return validate_blocks(net, shots, offsets, (1,))[0]


@torch.no_grad()
def validate_flicker(net: Hush, shots: list[Shot], lam: float = 1.0) -> float:
    """Mean flicker over the shots that have references of two frames; NaN where none has."""
    paired = [s for s in shots if len(s.references) > 1]
    total = 0.0
    for shot in paired:
        of = frames(shot)
        out, views = [], []
        for centre in (shot.centre, shot.centre - 1):
            v = view(shot, of, centre, OFFSETS)
            order = [centre, *(centre + k for k in OFFSETS)]
            views.append(collate([v]))
            out.append(net(views[-1] | {"inputs": of.inputs[order][None]}, torch.tensor([lam])))
        position, trust, _ = shot.path(shot.centre, -1)
        views[0] |= {"before": position.nan_to_num(0.0)[None], "followed": trust[None, None].float()}
        total += float(temporal_loss(out, views, torch.tensor([1.0])))
    return total / len(paired) if paired else math.nan


@dataclass
class Run:
    """The state of a training run; `checkpoint.pt` in its folder holds all of it but the shots."""

    folder: Path
    sources: list[Path]
    net: Hush
    mean: AveragedModel
    optimiser: Both
    step: int = 0
    spent: float = 0.0
    shots: dict[int, Shot] = field(default_factory=dict)
    held: dict[int, Shot] = field(default_factory=dict)

    def find_shots(self) -> None:
        """Reads the shots that came since the last time."""
        for path in shot_paths(self.sources):
            into = self.held if is_held(path) else self.shots
            if int(path.stem) not in into:
                into[int(path.stem)] = read_shot(path)

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

    def record(self, loss: float) -> None:
        """Validates the averaged weights, adds a line to log.jsonl and writes the checkpoint."""
        net, held = self.mean.module, list(self.held.values())
        (window2, blocks2), (window0, blocks0) = (validate_blocks(net, held, offsets, (1, 4)) for offsets in (OFFSETS, ()))
        scores = {"window2": window2, "window0": window0, "flicker": validate_flicker(net, held)}
        scores |= {"blocks2": blocks2, "blocks0": blocks0}
        counts = {"shots": len(self.shots), "held": len(held)}
        line = json.dumps({"step": self.step, "spent": self.spent, "loss": loss, **scores, **counts})
        print(line, flush=True)
        with (self.folder / "log.jsonl").open("a") as log:
            log.write(line + "\n")
        parts = {"net": self.net.state_dict(), "mean": self.mean.state_dict(), "optimiser": self.optimiser.state_dict()}
        aside = self.folder / "checkpoint.tmp"
        torch.save({**parts, "step": self.step, "spent": self.spent, "seeds": sorted(self.shots)}, aside)
        os.replace(aside, self.folder / "checkpoint.pt")


def averaged_of(state: dict[str, Batch]) -> Batch:
    """The averaged weights that a checkpoint holds, by the network's names."""
    return {k.removeprefix("module."): v for k, v in state["mean"].items() if k.startswith("module.")}


def mean_of(weights: list[Batch]) -> Batch:
    """The mean of several networks' weights."""
    return {name: torch.stack([one[name].float() for one in weights]).mean(0) for name in weights[0]}


def averaged(checkpoint: Path) -> Batch:
    """A checkpoint's averaged weights, by the network's names."""
    return averaged_of(torch.load(checkpoint, weights_only=True, map_location="cpu"))


def begin_from(net: Hush, mean: Batch) -> None:
    """Takes over averaged weights. What an older architecture lacks keeps its random start; a head's new taps start at a logit of 0."""
    state = net.state_dict()
    for at, value in mean.items():
        if at not in state or state[at].shape[1:] != value.shape[1:]:
            continue
        state[at].zero_()
        state[at][: len(value)] = value
    net.load_state_dict(state)


def keep_memory() -> None:
    """Keeps freed memory in the process: every step needs the same again, and the kernel's page faults cost a fifth of it (glibc)."""
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt:
        for parameter, value in ((M_MMAP_THRESHOLD, 32 << 20), (M_TRIM_THRESHOLD, 2**31 - 1), (M_TOP_PAD, 256 << 20)):
            mallopt(parameter, value)


def main() -> None:
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("--shots", type=Path, nargs="+", required=True, help="folders of shots; new ones are read at every checkpoint")
    p.add_argument("--out", type=Path, required=True)
    p.add_argument("--start", type=Path, help="a checkpoint whose averaged weights a new run starts from")
    p.add_argument("--hours", type=float, default=2.0, help="wall-clock hours of the whole schedule, resumed runs included")
    p.add_argument("--steps", type=int, default=10**9, help="end the run there; the schedule stays")
    p.add_argument("--batch", type=int, default=4, help="denoised frames a step")
    p.add_argument("--rate", type=float, default=1e-3)
    p.add_argument("--temporal", type=float, default=TEMPORAL, help="share of the temporal loss")
    p.add_argument("--seed", type=int, default=17, help="of the order of the examples: runs that differ in it can be averaged")
    p.add_argument("--threads", type=int, default=1)
    p.add_argument("--bf16", action="store_true", help="convolutions in bfloat16 (fast on CPUs with AVX512-BF16)")
    p.add_argument("--fused", action="store_true", help="apply the kernels in C++ (needs g++): twice as fast")
    p.add_argument("--every", type=int, default=1000, help="steps between checkpoints and validations")
    a = p.parse_args()
    torch.set_num_threads(a.threads)
    keep_memory()
    a.out.mkdir(parents=True, exist_ok=True)
    torch.manual_seed(1)
    net = Hush(Architecture()).to(memory_format=torch.channels_last)
    if a.start:
        begin_from(net, averaged(a.start))
    mean = AveragedModel(net, multi_avg_fn=get_ema_multi_avg_fn(0.999))
    if a.fused:
        net.average = mean.module.average = fused.average
    optimiser = Both(net, a.rate)
    run = Run(a.out, a.shots, net, mean, optimiser)
    run.resume()
    run.find_shots()
    recorded = run.step
    r = random.Random(run.step + a.seed)
    prepared = ThreadPoolExecutor(1)
    ahead = lambda: prepared.submit(batch_of, r, list(run.shots.values()), a.batch)
    begun, running, coming = time.monotonic() - run.spent, None, ahead()
    while (spent := time.monotonic() - begun) < a.hours * 3600 and run.step < a.steps:
        done = spent / (a.hours * 3600)
        rate = a.rate * min(1.0, (run.step + 1) / 200) * max(0.005, 0.5 * (1 + math.cos(math.pi * done)))
        optimiser.set_rate(rate)
        batch, coming = coming.result(), ahead()
        with torch.autocast("cpu", torch.bfloat16, enabled=a.bf16):
            loss = objective(net, *batch, a.temporal)
        optimiser.zero_grad()
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
            run.record(running)
            run.find_shots()
            recorded = run.step
    if running is not None and run.step > recorded:
        run.spent = spent  # the schedule's end, so that starting again trains no further
        run.record(running)
    prepared.shutdown()


if __name__ == "__main__":
    main()

"""Trains the network, on a GPU or a CPU. Resumable: start it again with the same folder and it goes on.

    python -m training.network.train --shots runs/shots --out runs/first --seconds 7200 --fused
    python -m training.network.train --shots runs/shots --out runs/second --start runs/first/checkpoint.pt --device cuda --batch 64 \
        --rate 2e-3 --seconds 540 --every 60
"""

from __future__ import annotations

import argparse
import ctypes
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import torch
from torch import Tensor, nn

from training.data.batches import Batch, Batches, Recipe
from training.data.resident import Resident
from training.network import fused
from training.network.clock import Clock, rate_share
from training.network.model import Architecture, Hush
from training.network.muon import Both
from training.network.objective import SHARES, Shares, objective
from training.network.references import ReferenceDenoiser
from training.network.run import Run, bound_gradients, checkpoint
from training.network.weights_file import Trained, begin_from, changed

M_TRIM_THRESHOLD, M_TOP_PAD, M_MMAP_THRESHOLD = -1, -2, -3  # of malloc.h
AVERAGE = 0.999  # decay of the averaged weights by step


def keep_memory() -> None:
    """Keeps freed memory in the process: every step needs the same again, and the kernel's page faults cost a fifth of it (glibc)."""
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt:
        for parameter, value in ((M_MMAP_THRESHOLD, 32 << 20), (M_TRIM_THRESHOLD, 2**31 - 1), (M_TOP_PAD, 256 << 20)):
            mallopt(parameter, value)


def drop_coarse(net: Hush, share: float) -> None:
    """Leaves the features at eighth resolution out of a share of the examples while training; the eighth's kernels keep them."""
    count = net.arch.eighth

    def drop(_: nn.Module, inputs: tuple[Tensor, ...]) -> tuple[Tensor, ...]:
        (joined,) = inputs
        keep = (torch.rand(len(joined), 1, 1, 1, device=joined.device) >= share).to(joined.dtype)
        return (torch.cat((joined[:, :count] * keep, joined[:, count:]), 1),)

    net.from_eighth.register_forward_pre_hook(drop)


def beginning(a: argparse.Namespace, state: dict[str, object] | None) -> tuple[Hush, Clock]:
    """The network to train: a checkpoint's, else one that begins from `--start`, else from random weights; and the run's time."""
    if state:
        return Hush(Architecture(**state["architecture"])), Clock(a.seconds, state["spent"], state["done"])
    if not a.start:
        return Hush(changed(Architecture(), a.architecture)), Clock(a.seconds)
    trained = Trained.read(a.start).without(a.without)
    net = Hush(changed(trained.architecture, a.architecture))
    begin_from(net, trained.weights)
    return net, Clock(a.seconds)


def arguments() -> argparse.Namespace:
    names = lambda text: [name for name in text.split(",") if name]
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("--shots", type=Path, nargs="+", required=True, help="folders of shots; new ones are read at every checkpoint")
    p.add_argument(
        "--denoise-references", type=Path, metavar="WEIGHTS", help="weights that denoise the training shots' references of few samples"
    )
    p.add_argument("--out", type=Path, required=True)
    p.add_argument("--device", default="cpu", choices=("cpu", "cuda", "mps"))
    p.add_argument("--start", type=Path, help="a weights file, or a checkpoint's averaged weights, that a new run starts from")
    p.add_argument("--without", type=names, default=[], help="residual blocks of --start to leave out: eighth.0,half_out.1")
    p.add_argument("--architecture", type=names, default=[], help="numbers that a new run changes: blocks_quarter=3,blocks_out=2")
    p.add_argument("--seconds", type=float, default=7200.0, help="wall-clock time of the whole run, resumed ones and reading included")
    p.add_argument("--steps", type=int, default=10**9, help="end the run there; the schedule stays")
    p.add_argument("--every", type=float, default=600.0, help="seconds between checkpoints, each with its scores")
    p.add_argument("--sample", type=int, default=40, help="validation shots, and as many training shots, that are scored at a checkpoint")
    p.add_argument("--batch", type=int, default=4, help="denoised frames a step")
    p.add_argument("--rate", type=float, default=1e-3)
    p.add_argument("--seed", type=int, default=17, help="of the order of the examples: runs that differ in it can be averaged")
    p.add_argument("--threads", type=int, default=1)
    p.add_argument("--bf16", action=argparse.BooleanOptionalAction, help="convolutions in bfloat16 [default: on cuda]")
    p.add_argument("--fused", action=argparse.BooleanOptionalAction, help="apply the kernels in C++ (needs g++) or CUDA [default: on cuda]")
    p.add_argument(
        "--compile", choices=("cudagraphs", "inductor"), help="record steps as CUDA graphs, or have torch.compile write kernels of its own"
    )
    recipe, shares = Recipe(), SHARES
    p.add_argument("--paired", type=float, default=recipe.paired, help="share of the batches of two frames in a row")
    p.add_argument("--alone", type=float, default=recipe.alone, help="share of the batches without neighbours")
    p.add_argument("--composed", type=float, default=recipe.composed, help="share of the batches of shots in front of others")
    p.add_argument("--relit", type=float, default=recipe.relit, help="share of the examples with light in two parts that is changed")
    p.add_argument("--crop", type=int, default=recipe.crop, help="side of the squares that larger shots are cut to; a multiple of 16")
    p.add_argument("--lambda-maps", type=float, default=recipe.lambda_maps, help="share of the examples whose λ varies inside the frame")
    p.add_argument("--temporal", type=float, default=shares.temporal, help="share of the temporal loss")
    p.add_argument("--fireflies", type=float, default=shares.fireflies, help="share of the loss that sees fireflies")
    p.add_argument("--decay-coarse", type=float, default=1e-4, help="weight decay of the features at eighth resolution")
    p.add_argument("--drop-coarse", type=float, default=0.0, help="share of the examples that do without those features")
    return p.parse_args()


class Trainer:
    """Steps of a run: batches, gradients, and the averaged weights."""

    def __init__(self, run: Run, recipe: Recipe, shares: Shares, a: argparse.Namespace) -> None:
        self.run, self.shares, self.rate = run, shares, a.rate
        self.bf16 = a.bf16
        self.batches = Batches(run.shots, recipe, a.seed + run.step)
        self.loss: Callable[..., Tensor] = torch.compile(objective, backend=a.compile, dynamic=False) if a.compile else objective
        self.loss_of_late: Tensor | None = None

    def backward(self, batch: Batch) -> Tensor:
        """The gradients of a batch, and its loss, which stays on the device."""
        net = self.run.net
        torch.compiler.cudagraph_mark_step_begin()
        with torch.autocast(batch.inputs.device.type, torch.bfloat16, enabled=self.bf16):
            loss = self.loss(net, batch, self.shares)
        self.run.optimiser.zero_grad()
        loss.backward()
        return loss.detach().clone()

    def warm_up(self) -> None:
        """A batch of every kind, for nothing: what is compiled or searched for at a shape's first use is there when the schedule begins."""
        for batch in self.batches.each_kind():
            try:
                self.backward(batch)
            except RuntimeError as error:
                if self.loss is objective:
                    raise
                print(f"goes on without --compile: {error}", flush=True)
                self.loss = objective
                self.backward(batch)
        self.run.optimiser.zero_grad()
        if self.batches.shots.device.type == "cuda":
            torch.cuda.synchronize()

    def step(self, batch: Batch) -> None:
        run = self.run
        run.optimiser.set_rate(self.rate * rate_share(run.step, run.clock.done))
        loss = self.backward(batch)
        bound_gradients(run.net)
        run.optimiser.step()
        run.average(AVERAGE)
        run.step += 1
        self.loss_of_late = loss if self.loss_of_late is None else torch.lerp(self.loss_of_late, loss, 0.01)

    def drawn(self) -> Iterator[Batch]:
        """Batches without end; on a CPU the next one is made while one is used."""
        if self.batches.shots.device.type != "cpu":
            while True:
                yield self.batches.draw()
        with ThreadPoolExecutor(1) as ahead:
            coming = ahead.submit(self.batches.draw)
            while True:
                batch, coming = coming.result(), ahead.submit(self.batches.draw)
                yield batch


def train(run: Run, trainer: Trainer, a: argparse.Namespace) -> None:
    """Trains until the run's time is over, with a checkpoint every `--every` seconds and one at the end."""

    def record() -> None:
        began = time.monotonic()
        loss = None if trainer.loss_of_late is None else float(trainer.loss_of_late)
        run.record(loss, run.measure(a.sample, a.bf16 and a.device == "cuda"))
        run.clock.reserve = time.monotonic() - began

    record()
    if a.compile or a.device == "cuda":
        trainer.warm_up()
    run.clock.start()
    begun = recorded = run.clock.spent
    first = printed = run.step
    for batch in trainer.drawn():
        if run.clock.done >= 1.0 or run.step >= a.steps:
            break
        trainer.step(batch)
        if run.step == printed + 100:
            printed = run.step
            pace = (run.clock.spent - begun) / (run.step - first)
            print(f"step {run.step} loss {float(trainer.loss_of_late):.4f} done {run.clock.done:.3f} {pace:.3f} s/step", flush=True)
        if run.clock.spent - recorded >= a.every:
            record()
            run.find_shots()
            recorded = run.clock.spent
    if run.step > first:
        record()


def main() -> None:
    a = arguments()
    device = torch.device(a.device, 0) if a.device == "cuda" else torch.device(a.device)
    for option in ("bf16", "fused"):
        if getattr(a, option) is None:
            setattr(a, option, a.device == "cuda")
    torch.set_num_threads(a.threads)
    torch.backends.cuda.matmul.allow_tf32 = torch.backends.cudnn.allow_tf32 = torch.backends.cudnn.benchmark = True
    keep_memory()
    a.out.mkdir(parents=True, exist_ok=True)
    torch.manual_seed(a.seed)
    state = checkpoint(a.out)
    net, clock = beginning(a, state)
    net = net.to(device, memory_format=torch.channels_last)
    mean = Run.averaged(net)
    if a.fused:
        net.average = mean.average = fused.average
    if a.drop_coarse:
        drop_coarse(net, a.drop_coarse)
    denoiser = ReferenceDenoiser(a.denoise_references, a.fused and a.device == "cpu") if a.denoise_references else None
    optimiser = Both(net, a.rate, decay_coarse=a.decay_coarse)
    run = Run(a.out, a.shots, net, mean, optimiser, clock, Resident(device), Resident(device), denoiser)
    if state:
        run.resume(state)
    run.find_shots()
    if not len(run.shots):
        raise SystemExit(f"no training shots in {', '.join(map(str, a.shots))}: NNNNNN.npz with seeds not divisible by 8")
    print(f"{len(run.shots)} shots, {len(run.held)} for validation, read in {clock.spent:.1f} s", flush=True)
    recipe = Recipe(
        outputs=a.batch, crop=a.crop, alone=a.alone, paired=a.paired, composed=a.composed, relit=a.relit,
        lambda_maps=a.lambda_maps, farther=0.0 if a.compile else Recipe.farther, epsilon=net.arch.albedo_epsilon,
    )  # fmt: skip
    shares = Shares(temporal=a.temporal, fireflies=a.fireflies)
    train(run, Trainer(run, recipe, shares, a), a)


if __name__ == "__main__":
    main()

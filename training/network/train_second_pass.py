"""Trains the second pass over time of weights that have the first, on a CPU in minutes: only its own head learns.

    python -m training.network.train_second_pass --weights models/hush.safetensors --shots runs/shots --out second.safetensors --fused

Each shot's frames are denoised once by λ and kept; a head of 132 numbers a step costs next to nothing.
"""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import torch
from torch import Tensor, nn

from training.data.batches import Recipe
from training.data.geometry import warped
from training.data.inputs import frames, of_frames, path, view
from training.data.lambda_maps import LAMBDA_MAX, ORDINARY
from training.data.shots import Shot, is_held, read_shot, shot_paths
from training.network import fused
from training.network.layers import code_of
from training.network.loss import asymmetric, by_pixel, fireflies, flicker, rel_mse, smape
from training.network.model import Hush
from training.network.objective import SHARES, evened
from training.network.second_pass import dialled, difference, weights
from training.network.weights_file import WeightsFile, begin_from

WINDOW = 2
RATE = 1e-2
PAIRED = Recipe().paired


@dataclass
class Example:
    """A frame with its window, after the first pass. Images are scaled so that the reference's mean is 0.4.

    own, noisy, reference (1, 3, H, W); near (1, N, 3, H, W), warped; trusted (1, N, 1, H, W); hidden (N, pair, h, w): what the head takes;
    unlike (1, N, 1, h, w): `difference`; before (1, 2, H, W), followed (1, 1, H, W): of a frame whose frame before is an example too.
    """

    own: Tensor
    near: Tensor
    trusted: Tensor
    hidden: Tensor
    unlike: Tensor
    noisy: Tensor
    reference: Tensor
    effort: float
    lam: Tensor
    before: Tensor | None = None
    followed: Tensor | None = None

    def averaged(self, head: nn.Module) -> tuple[Tensor, Tensor]:
        """The second pass, (1, 3, H, W), and the neighbours' weights."""
        logits = dialled(head(self.hidden.float())[None], code_of(self.lam, self.hidden.shape[-1]))
        by = weights(logits, self.unlike) * self.trusted
        return (self.own + (by * self.near).sum(1)) / (1.0 + by.sum(1)), by


@torch.no_grad()
def examples(net: Hush, shot: Shot, lam: float) -> list[Example]:
    """The shot's frames that have references, the later one first."""
    of, dial = frames(shot, epsilon=net.arch.albedo_epsilon), torch.tensor([lam])
    hidden: list[Tensor] = []
    hook = net.pair_second_head.register_forward_pre_hook(lambda _module, inputs: hidden.append(inputs[0]))
    features = net.encode(of.inputs[None])[0]
    seen, results = [], []
    for centre in range(len(shot)):
        offsets = shot.window(centre, WINDOW)
        batch = {name: value[None] for name, value in view(shot, of, centre, offsets).items() if isinstance(value, Tensor)}
        results.append(net.denoise(of_frames(features, [centre, *(centre + k for k in offsets)])[None], batch, dial)["image"])
        seen.append((offsets, batch))
    hook.remove()
    found = []
    for centre in sorted(shot.references, reverse=True):
        offsets, batch = seen[centre]
        gain = batch["gain"].view(-1, 1, 1, 1)
        positions = torch.cat([path(shot, centre, k)[0].nan_to_num(0.0)[None] for k in offsets])
        near = warped(torch.cat([results[centre + k] for k in offsets]), positions)[None]
        unlike = difference(results[centre], near, batch["exposure"])
        images = (results[centre] * gain, near * gain, batch["valid"][:, 1:])
        own = (hidden[centre].half(), unlike, batch["noisy"] * gain, batch["reference"] * gain)
        found.append(Example(*images, *own, float(batch["effort"]), dial))
    if len(found) > 1:
        position, trust, _ = path(shot, shot.centre, -1)
        found[0].before, found[0].followed = position.nan_to_num(0.0)[None], trust[None, None].float()
    return found


def changes(out: Sequence[Tensor], of: Sequence[Example]) -> Tensor:
    """`loss.flicker` of two frames in a row."""
    return flicker(out[0], of[0].reference, warped(out[1] - of[1].reference, of[0].before), of[0].followed)


def loss(head: nn.Module, of: Sequence[Example]) -> Tensor:
    """As `objective.objective`, of what the second pass decides: the final image and how it changes."""
    out = [example.averaged(head)[0] for example in of]
    total = torch.zeros(())
    for image, example in zip(out, of, strict=True):
        weight = evened(example.lam) * example.effort
        total = total + (asymmetric(image, example.reference, example.noisy, example.lam) * weight).mean() / len(of)
        total = total + SHARES.fireflies * (fireflies(image, example.reference) * weight).mean() / len(of)
    return total + SHARES.temporal * (changes(out, of) / by_pixel(of[0].lam)).mean() if len(of) > 1 else total


def train(head: nn.Module, ordinary: list[list[Example]], others: list[list[Example]], steps: int, generator: torch.Generator) -> None:
    """Steps of one shot each, λ as `lambda_maps.constants` draws it, pairs as `batches.Recipe` does."""
    optimiser = torch.optim.AdamW(head.parameters(), lr=RATE, betas=(0.9, 0.99))
    for step in range(steps):
        for group in optimiser.param_groups:
            group["lr"] = RATE * max(0.02, 0.5 * (1.0 + math.cos(math.pi * step / steps)))
        draw = lambda count: int(torch.randint(count, (), generator=generator))
        share = lambda: float(torch.rand((), generator=generator))
        pool = ordinary if share() < ORDINARY else others
        if share() < PAIRED:
            pool = [of for of in pool if len(of) > 1] or pool
        value = loss(head, pool[draw(len(pool))])
        optimiser.zero_grad()
        value.backward()
        optimiser.step()


@torch.no_grad()
def scores(head: nn.Module, shots: Sequence[Sequence[Example]]) -> dict[str, float]:
    """Of the second pass over the first, geometric means over the shots: SMAPE, relMSE, flicker, and `noise`, how far the image is from the
    reference in itself; and the neighbours' mean weight together."""
    ratios: dict[str, list[float]] = {}
    each = {"smape": smape, "relmse": rel_mse, "noise": lambda image, reference: (image - reference).abs()}
    for of in shots:
        done = [example.averaged(head) for example in of]
        out, own = [image for image, _ in done], [example.own for example in of]
        for name, measure in each.items():
            found, first = (float(measure(image[0], of[0].reference).mean()) for image in (out, own))
            ratios.setdefault(name, []).append(math.log(found / first))
        ratios.setdefault("weight", []).append(math.log(float(done[0][1].sum(1).mean()) + 1e-12))
        if len(of) > 1:
            ratios.setdefault("flicker", []).append(math.log(float(changes(out, of).mean() / changes(own, of).mean())))
    return {name: round(math.exp(sum(values) / len(values)), 4) for name, values in ratios.items()}


def main() -> None:
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("--weights", type=Path, required=True, help="a weights file; its first pass stays as it is")
    p.add_argument("--out", type=Path, required=True, help="the weights file with a second pass")
    p.add_argument("--shots", type=Path, nargs="+", required=True, help="folders of shots; scores are of their validation split")
    p.add_argument("--steps", type=int, default=2500)
    p.add_argument("--seed", type=int, default=17)
    p.add_argument("--threads", type=int, default=1)
    p.add_argument("--fused", action="store_true", help="apply the kernels in C++ (needs g++)")
    a = p.parse_args()
    torch.set_num_threads(a.threads)
    generator = torch.Generator().manual_seed(a.seed)
    file = WeightsFile.read(a.weights)
    net = Hush(replace(file.architecture(), second_pass=1))
    begin_from(net, file.weights())
    net.eval().requires_grad_(False)
    if a.fused:
        net.average = fused.average
    paths = shot_paths(a.shots)
    draw = lambda: float(LAMBDA_MAX ** torch.rand((), generator=generator))
    learnt = [read_shot(path) for path in paths if not is_held(path)]
    ordinary, others = ([examples(net, shot, lam) for shot in learnt for lam in [dial()]] for dial in (lambda: 1.0, draw))
    held = [read_shot(path) for path in paths if is_held(path)]
    validation = {lam: [examples(net, shot, lam) for shot in held] for lam in (1.0, 8.0, LAMBDA_MAX)}
    print(len(learnt), "shots and", len(held), "for validation", flush=True)
    head = net.pair_second_head.requires_grad_(True)
    train(head, ordinary, others, a.steps, generator)
    found = {f"lambda_{lam:g}": scores(head, shots) for lam, shots in validation.items()}
    for name, values in found.items():
        print(name, json.dumps(values), flush=True)
    file.tensors |= {f"pair_second_head.{name}": value.detach().half() for name, value in head.state_dict().items()}
    file.header["hush.architecture"] = json.dumps(net.arch.header(), separators=(",", ":"))
    file.header["hush.second_pass"] = json.dumps({"steps": a.steps, "seeds": [s.seed for s in learnt], "over_the_first": found})
    file.write(a.out)


if __name__ == "__main__":
    main()

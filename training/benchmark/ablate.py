"""Leaves parts of trained weights out, one at a time, and scores what is left on the validation shots.

    python -m training.benchmark.ablate runs/first/checkpoint.pt --shots runs/shots
    python -m training.benchmark.ablate models/hush.safetensors --shots runs/shots

Nothing is trained again, so a part's line says how much the network leans on it, and is the most that training without it could lose.
Prints a table: SMAPE, SMAPE of means over 4×4 pixels and relMSE at ±2 and 0, as shares of the whole network's (geometric means over
the shots).
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from training.benchmark.tables import table
from training.data.inputs import ALL_GUIDES, Guides, prepare
from training.data.shots import OFFSETS, Shot, read_held
from training.network import fused
from training.network.layers import Residual
from training.network.loss import rel_mse, smape
from training.network.model import Hush
from training.network.weights_file import Trained

Batch = dict[str, Tensor]
EXTRA_NAMES = {"albedo difference": (1, 2, 3), "depth difference": (4,), "agreement of the vectors": (5,), "distance in frames": (6,)}


@dataclass(frozen=True)
class Part:
    """A part that can be left out: by changing the network, what it is given, or which guides it sees."""

    name: str
    network: Callable[[Hush], None] = lambda _: None
    batch: Callable[[Batch], None] = lambda _: None
    guides: Guides = ALL_GUIDES


@torch.no_grad()
def silence(layer: nn.Conv2d, rows: Iterable[int], logit: float = -1000.0) -> None:
    """Gives outputs of a head the same logit everywhere, by default one that leaves their taps without weight."""
    for row in rows:
        layer.weight[row] = 0.0
        layer.bias[row] = logit


def sub_pixels(taps: int, each: range) -> list[int]:
    """The outputs of a head of `taps` taps for each of four sub-pixels that are in `each`."""
    return [phase * taps + tap for phase in range(4) for tap in each]


def own_albedo(net: Hush) -> None:
    """Multiplies by the pixel's own albedo instead of the filtered one."""
    a = net.arch
    first, count = a.centre_taps**2 + a.coarse_taps**2, a.albedo_taps**2
    silence(net.head_half, sub_pixels(first + count, range(first, first + count)))
    silence(net.head_half, sub_pixels(first + count, range(first + count // 2, first + count // 2 + 1)), 1000.0)
    silence(net.pair_half_head, sub_pixels(a.neighbour_taps**2 + 1, range(a.neighbour_taps**2, a.neighbour_taps**2 + 1)))
    if a.albedo_levels > 1:
        silence(net.head_albedo_half, range(4 * a.coarse_taps**2))


def coarse_taps(net: Hush, finest: bool) -> None:
    """No taps of the next coarser level: at full resolution only (no pyramid is left), or at the coarser levels."""
    a = net.arch
    centre, coarse = a.centre_taps**2, a.coarse_taps**2
    each = centre + coarse + a.albedo_taps**2
    if finest:
        return silence(net.head_half, sub_pixels(each, range(centre, centre + coarse)))
    silence(net.head_half, range(4 * each + centre, 4 * each + centre + coarse))
    return silence(net.head_quarter, range(centre, centre + coarse))


def neighbour_taps(net: Hush) -> None:
    layers = [net.pair_half_head, net.pair_quarter_head, *([net.pair_eighth_head] if net.arch.levels > 3 else [])]
    layers += [net.pair_albedo_half_head, net.pair_albedo_quarter_head] if net.arch.albedo_levels > 1 else []
    for layer in layers:
        silence(layer, range(layer.out_channels))


@torch.no_grad()
def temporal_extractor(net: Hush) -> None:
    """The body sees the centre frame alone; neighbours' taps stay."""
    net.mix.weight[:, net.arch.features : net.arch.features + net.arch.half] = 0.0


@torch.no_grad()
def variances(net: Hush) -> None:
    """The body is not told how noisy a pixel is."""
    net.mix.weight[:, net.arch.features + net.arch.half :] = 0.0


@torch.no_grad()
def keys(net: Hush) -> None:
    for name, parameter in net.named_parameters():
        if "query" in name:
            parameter.zero_()


@torch.no_grad()
def identity(block: Residual) -> None:
    block.second.weight.zero_()
    block.second.bias.zero_()


@torch.no_grad()
def weakest_hidden(net: Hush, share: float) -> None:
    """Prunes the hidden channels of every residual block that matter least by the size of their weights."""
    for block in (m for m in net.modules() if isinstance(m, Residual)):
        size = block.first.weight.flatten(1).norm(dim=1) * block.second.weight.transpose(0, 1).flatten(1).norm(dim=1)
        gone = size.argsort()[: int(share * len(size))]
        block.second.weight[:, gone] = 0.0


def zero_extras(channels: tuple[int, ...]) -> Callable[[Batch], None]:
    def change(batch: Batch) -> None:
        for channel in channels:
            batch["extras"][:, :, channel] = 0.0

    return change


def parts(net: Hush) -> list[Part]:
    """Everything that is left out in turn."""
    blocks = [name for name, module in net.named_modules() if isinstance(module, Residual)]
    return [
        Part("filtered albedo (the pixel's own instead)", own_albedo),
        Part("coarse taps at full resolution (5×5 pixels are left)", lambda n: coarse_taps(n, finest=True)),
        Part("coarse taps at half and quarter resolution", lambda n: coarse_taps(n, finest=False)),
        Part("neighbours' taps", neighbour_taps),
        Part("temporal extractor", temporal_extractor),
        *([Part("variances", variances)] if net.arch.variance else []),
        Part("keys", keys),
        *(Part(f"extra: {name}", batch=zero_extras(channels)) for name, channels in EXTRA_NAMES.items()),
        Part("guide: albedo", guides=Guides(albedo=False)),
        Part("guide: normal", guides=Guides(normal=False)),
        Part("guide: depth", guides=Guides(depth=False)),
        Part("all guides", guides=Guides(albedo=False, normal=False, depth=False)),
        *(Part(f"block {name}", lambda n, name=name: identity(n.get_submodule(name))) for name in blocks),
        *(Part(f"pruned: {share:.0%} of the blocks' hidden channels", lambda n, s=share: weakest_hidden(n, s)) for share in (0.25, 0.5)),
    ]


@torch.no_grad()
def scores(trained: Trained, part: Part, shots: list[Shot], offsets: tuple[int, ...]) -> Tensor:
    """(shots, 3): SMAPE, that of blocks, relMSE."""
    net = trained.network()
    net.average = fused.average
    part.network(net)
    found = []
    for shot in shots:
        batch = {name: value[None] for name, value in prepare(shot, offsets, part.guides, net.arch.albedo_epsilon).items()}
        part.batch(batch)
        gain = batch["gain"].view(-1, 1, 1, 1)
        image, reference = net(batch, torch.ones(1))["image"] * gain, batch["reference"] * gain
        blocks = (F.avg_pool2d(x, 4) for x in (image, reference))
        found.append([float(x.mean()) for x in (smape(image, reference), smape(*blocks), rel_mse(image, reference))])
    return torch.tensor(found)


def main() -> None:
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("weights", type=Path, help="a weights file or a checkpoint, of any architecture")
    p.add_argument("--shots", type=Path, nargs="+", required=True, help="folders of shots; measures on their validation split")
    p.add_argument("--threads", type=int, default=1)
    a = p.parse_args()
    torch.set_num_threads(a.threads)
    trained, held = Trained.read(a.weights), read_held(a.shots)
    windows = (OFFSETS, ())
    whole = [scores(trained, Part("nothing"), held, offsets) for offsets in windows]
    rows = []
    for part in parts(Hush(trained.architecture)):
        shares = [scores(trained, part, held, offsets) / base for offsets, base in zip(windows, whole, strict=True)]
        rows.append([part.name, *(f"{math.exp(x):.3f}" for share in shares for x in share.log().mean(0).tolist())])
        print(*rows[-1], flush=True)
    print(table(["left out", "±2: SMAPE", "blocks", "relMSE", "0: SMAPE", "blocks", "relMSE"], rows))


if __name__ == "__main__":
    main()

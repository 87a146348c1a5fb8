"""Scores of trained weights on what denoisers fail at: sets of validation shots that were rendered with it on purpose.

    python -m training.benchmark.failures models/hush.safetensors --shots runs/shots
    python -m training.benchmark.failures models/hush.safetensors --shots runs/shots --limits training/benchmark/failures.json

A shot is in every set that one of its features (`meta`, training/shots/cycles/features.py) belongs to. Prints a table: the shots of a set,
SMAPE and relMSE at ±2 and 0 as shares of OIDN's as Cycles runs it, relMSE at ±2 over that at 0, and the worst shot of that; geometric
means over the shots. Where a shot has halves, the references' noise is not in the square of relMSE; it stays in the divisor. With --limits
it fails where a number is above the file's, or where the shots are others; with --write it writes what was measured, and 3 %, into that
file. Needs pyoidn.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

import pyoidn
import torch
from torch import Tensor

from training.benchmark import oidn
from training.benchmark.tables import PEER, table
from training.benchmark.validate_oidn import denoised
from training.data.inputs import prepare
from training.data.shots import OFFSETS, Shot, read_held
from training.network import fused
from training.network.loss import rel_mse, smape
from training.network.model import Hush
from training.network.weights_file import Trained

SETS = {
    "noisy guides": ("bokeh", "hair", "leaves", "motion blur"),
    "neighbours that mislead": ("mirrors", "glass", "water", "flicker", "volume"),
    "fireflies": ("signs",),
}
EVERY = "every shot"
LEAST = 1e-7  # what a relMSE of halves counts as at least: it can be below 0
MARGIN = 1.03  # of a limit above what was measured
COLUMNS = ("±2 SMAPE", "±2 relMSE", "0 SMAPE", "0 relMSE", "±2 relMSE over 0", "the worst")
Row = tuple[float, ...]


def rel_mse_of_halves(image: Tensor, halves: Tensor) -> float:
    """(d − a)(d − b) / (r² + 0.01), r the mean of the halves a and b (2, 3, H, W).

    Not unbiased, as the benchmark's is: r has the noise of both. So a firefly of a half counts little, and noise changes the number where
    it is not small beside r and 0.1.
    """
    first, second = halves
    return float(((image - first) * (image - second) / (halves.mean(0) ** 2 + 1e-2)).mean())


def errors(shot: Shot, image: Tensor) -> tuple[float, float]:
    """SMAPE and relMSE of an image (3, H, W) of the middle frame, the reference scaled to mean 0.4."""
    reference = shot.reference.clamp_min(0)
    gain = 0.4 / reference.mean().clamp_min(1e-6)
    halves = shot.halves.get(shot.centre)
    squared = float(rel_mse(image * gain, reference * gain).mean())
    if halves is not None:
        squared = max(LEAST, rel_mse_of_halves(image * gain, halves.clamp_min(0) * gain))
    return float(smape(image * gain, reference * gain).mean()), squared


@torch.no_grad()
def by_hush(net: Hush, shot: Shot, offsets: Sequence[int]) -> Tensor:
    batch = {name: value[None] for name, value in prepare(shot, offsets, epsilon=net.arch.albedo_epsilon).items()}
    return net(batch, torch.ones(1))["image"][0]


def row_of(net: Hush, shot: Shot, device: pyoidn.Device) -> Row:
    """The numbers of a shot: as COLUMNS, but for the last."""
    base = errors(shot, denoised(device, shot, (PEER,))[PEER])
    near, alone = (errors(shot, by_hush(net, shot, offsets)) for offsets in (OFFSETS, ()))
    return near[0] / base[0], near[1] / base[1], alone[0] / base[0], alone[1] / base[1], near[1] / alone[1]


def members(shots: Sequence[Shot]) -> dict[str, list[int]]:
    """The shots of each set, by their places."""
    found = {
        name: [k for k, shot in enumerate(shots) if set(features) & set(shot.meta.get("features", ()))] for name, features in SETS.items()
    }
    return found | {EVERY: list(range(len(shots)))}


def summary(rows: Sequence[Row]) -> Row:
    """A set's numbers: geometric means, and the largest of the last."""
    logs = torch.tensor(rows).log()
    return (*logs.mean(0).exp().tolist(), float(logs[:, -1].max().exp()))


def seeds_of(shots: Sequence[Shot]) -> dict[str, list[int]]:
    """The seeds of each set that has any."""
    return {name: [shots[k].seed for k in places] for name, places in members(shots).items() if places}


def above(found: Mapping[str, Row], limits: Mapping[str, Sequence[float]]) -> list[str]:
    """What is above its limit, in words."""
    pairs = [(name, c, value, limit) for name in found for c, value, limit in zip(COLUMNS, found[name], limits.get(name, ()), strict=False)]
    return [f"{name}: {column} {value:.3f}, at most {limit:.3f}" for name, column, value, limit in pairs if value > limit]


def main() -> None:
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("weights", type=Path, help="a weights file or a checkpoint")
    p.add_argument("--shots", type=Path, nargs="+", required=True, help="folders of shots; seeds divisible by 8 are measured")
    p.add_argument("--limits", type=Path, help="JSON of the most that each number may be")
    p.add_argument("--write", action="store_true", help="write the limits instead of holding to them")
    p.add_argument("--threads", type=int, default=1)
    a = p.parse_args()
    if a.write and not a.limits:
        p.error("--write wants --limits, the file to write")
    torch.set_num_threads(a.threads)
    net = Trained.read(a.weights).network()
    net.average = fused.average
    held = read_held(a.shots)
    limits = json.loads(a.limits.read_text()) if a.limits and not a.write else None
    if limits and limits["seeds"] != seeds_of(held):
        raise SystemExit(f"{a.limits} has the limits of other shots: its seeds are not those in {', '.join(map(str, a.shots))}")
    sets = {name: places for name, places in members(held).items() if places}
    with oidn.device(a.threads) as device:
        rows = [row_of(net, shot, device) for shot in held]
    found = {name: summary([rows[k] for k in places]) for name, places in sets.items()}
    print(table(["", "shots", *COLUMNS], [[name, str(len(sets[name])), *(f"{x:.2f}" for x in row)] for name, row in found.items()]))
    if a.write:
        most = {name: [round(x * MARGIN, 3) for x in row] for name, row in found.items()}
        a.limits.write_text(json.dumps({"seeds": seeds_of(held), "limits": most}, indent=1) + "\n")
    elif limits and (worse := above(found, limits["limits"])):
        sys.exit("\n".join(worse))


if __name__ == "__main__":
    main()

"""Writes what holds the Rust network and this one together: a small random model, inputs and every stage's output.

python -m training.network.golden tests/data
"""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from pathlib import Path

import torch
import torch.nn.functional as F
from safetensors.torch import save_file
from torch import Tensor

from training.data.inputs import prepare
from training.data.shots import Shot
from training.network.model import Architecture, Hush
from training.network.weights_file import begin_from

SMALL = Architecture(
    features=16, half=32, quarter=48, eighth=16, blocks_encoder=2, blocks_half=1, blocks_quarter=1, blocks_eighth=2, blocks_out=2,
    pair=16, lambda_hidden=4,
    centre_taps=5, neighbour_taps=3, coarse_taps=3, albedo_taps=3, albedo_levels=3, variance=1,
)  # fmt: skip
LEVELS = {"half": 2, "quarter": 4, "eighth": 8}
CASES: tuple[tuple[str, int, int, tuple[int, ...], float], ...] = (
    ("window2", 32, 48, (-1, 1, -2, 2), 1.0),
    ("odd", 19, 45, (-1, 1, -2, 2), 8.0),
    ("window0", 24, 40, (), 3.0),
    ("uneven", 16, 72, (1, 2), 64.0),
    ("window3", 16, 32, (-1, 1, -2, 2, -3, 3), 2.0),
)


def padded(image: Tensor, rows: int, columns: int) -> Tensor:
    """Repeats the last row and column up to a size."""
    h, w = image.shape[-2:]
    flat = image.reshape(1, -1, h, w)
    return F.pad(flat, (0, columns - w, 0, rows - h), mode="replicate").reshape(*image.shape[:-2], rows, columns)


def random_model(generator: torch.Generator) -> Hush:
    """The small network with random weights."""
    net = Hush(SMALL)
    spread = lambda v: 0.7 / max(1, v[0].numel()) ** 0.5 if v.dim() > 1 else 0.1
    net.load_state_dict({k: torch.randn(v.shape, generator=generator) * spread(v) for k, v in net.state_dict().items()})
    return net.eval()


def older(net: Hush) -> Hush:
    """The same weights with the albedo filtered at full resolution only and without variances, as older weights are."""
    plain = Hush(replace(net.arch, albedo_levels=1, variance=0))
    begin_from(plain, {k: v[:, : plain.mix.in_channels] if k == "mix.weight" else v for k, v in net.state_dict().items()})
    return plain.eval()


def random_shot(count: int, rows: int, columns: int, generator: torch.Generator) -> tuple[Shot, Tensor]:
    """`count` frames of noise over smooth shapes, with bad pixels; returns the padded shot and which pixels are valid."""
    rand = lambda *s: torch.rand(*s, generator=generator)
    smooth = lambda c: F.interpolate(rand(count, c, 3, 4), size=(rows, columns), mode="bilinear", align_corners=True)
    colour = smooth(3) * 2.0 * (0.3 + rand(count, 3, rows, columns)) * torch.exp2(rand(count, 1, 1, 1) * 4 - 2)
    shot = Shot(0, 1, colour, smooth(3), smooth(3) * 2 - 1, smooth(1) * 9 - 2, (smooth(4) - 0.5) * 9, {})
    valid = torch.ones(count, 1, rows, columns)
    valid[:, :, rows // 2, columns // 3] = 0
    valid[1, :, 0, 0] = 0
    shot.colour = shot.colour * valid
    up = lambda n: -(-n // 8) * 8
    pad = lambda x: padded(x, up(rows), up(columns))
    whole = Shot(0, 1, pad(shot.colour), pad(shot.albedo), pad(shot.normal), pad(shot.depth), pad(shot.vector), {})
    return whole, F.pad(valid, (0, up(columns) - columns, 0, up(rows) - rows))


def forward(net: Hush, batch: dict[str, Tensor], lam: Tensor) -> tuple[dict[str, Tensor], dict[str, Tensor]]:
    """The network's outputs, and the features it passes through on the way."""
    stages: dict[str, Tensor] = {}
    modules = {"features": net.encoder, "half_features": net.half_out, "quarter_features": net.quarter_out, "eighth_features": net.eighth}

    def keep(name: str) -> torch.utils.hooks.RemovableHandle:
        return modules[name].register_forward_hook(lambda _module, _inputs, output: stages.__setitem__(name, output[0]))

    hooks = [keep(name) for name in modules]
    result = net(batch, lam)
    for hook in hooks:
        hook.remove()
    return result, stages


def case(
    net: Hush, rows: int, columns: int, offsets: tuple[int, ...], lam: float, generator: torch.Generator, mapped: bool = False
) -> dict[str, Tensor]:
    """One case: the passes as a file would hold them (bad pixels are NaN) and what comes out at every stage. `mapped`: λ is a map."""
    shot, valid = random_shot(2 * max(2, *map(abs, offsets), 0) + 1, rows, columns, generator)
    batch = {k: v[None] for k, v in prepare(shot, offsets, valid=valid).items()}
    chosen = {}
    whole = torch.tensor([lam])
    if mapped:
        chosen["lambda_map"] = torch.exp2(torch.rand(rows, columns, generator=generator) * 6)
        whole = padded(chosen["lambda_map"][None], *shot.depth.shape[-2:])[None]
    result, stages = forward(net, batch, whole)
    crop = lambda x, scale=1: x[..., : -(-rows // scale), : -(-columns // scale)].contiguous()
    nan = torch.where(valid > 0, 0.0, float("nan"))
    return {
        "colour": crop(shot.colour + nan), "albedo": crop(shot.albedo), "normal": crop(shot.normal), "depth": crop(shot.depth),
        "vector": crop(shot.vector), "lambda": torch.tensor([lam]), "offsets": torch.tensor(offsets or [0]),
        "image": crop(result["image"][0]), **stages, **{name: crop(result[name][0], scale) for name, scale in LEVELS.items()},
        "centre": torch.tensor([shot.centre]), **chosen,
    }  # fmt: skip


@torch.no_grad()
def main() -> None:
    out = Path(sys.argv[1])
    generator = torch.Generator().manual_seed(7)
    net = random_model(generator)
    header = {"hush.architecture": json.dumps(SMALL.header(), separators=(",", ":")), "hush.training": "random"}
    save_file(net.state_dict(), out / "golden_model.safetensors", metadata=header)
    cases: dict[str, Tensor] = {}
    for name, *settings in CASES:
        cases |= {f"{name}.{k}": v.float().contiguous() for k, v in case(net, *settings, generator).items()}
    plain = case(older(net), 16, 40, (-1, 1), 4.0, generator)
    mapped = case(net, 21, 37, (-1, 1), 1.0, generator, mapped=True)
    for name, found in {"older": plain, "lambda_map": mapped}.items():
        cases |= {f"{name}.{k}": v.float().contiguous() for k, v in found.items()}
    save_file(cases, out / "golden_cases.safetensors")


if __name__ == "__main__":
    main()

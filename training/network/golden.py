"""Writes what holds the Rust network and this one together: a small random model, inputs and every stage's output.

python -m training.network.golden tests/data
"""

from __future__ import annotations

import argparse
import json
from dataclasses import replace
from pathlib import Path

import torch
import torch.nn.functional as F
from safetensors.torch import save_file
from torch import Tensor

from training.data.geometry import warped
from training.data.inputs import frames, of_frames, path, prepare, view
from training.data.shots import Shot
from training.network.model import Architecture, Hush
from training.network.second_pass import second_pass
from training.network.weights_file import begin_from

SMALL = Architecture(
    features=16, half=32, quarter=48, eighth=16, blocks_encoder=2, blocks_half=1, blocks_quarter=1, blocks_eighth=2, blocks_out=2,
    pair=16, lambda_hidden=4,
    centre_taps=5, neighbour_taps=3, coarse_taps=3, albedo_taps=3, albedo_levels=3, variance=1, second_pass=1,
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
    """The same weights with the albedo filtered at full resolution only, without variances and second pass, as older weights are."""
    plain = Hush(replace(net.arch, albedo_levels=1, variance=0, second_pass=0))
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


def passes_of(shot: Shot, rows: int, columns: int, valid: Tensor) -> dict[str, Tensor]:
    """The passes as a file would hold them, bad pixels NaN."""
    nan = torch.where(valid > 0, 0.0, float("nan"))
    shown = {"colour": shot.colour + nan, "albedo": shot.albedo, "normal": shot.normal, "depth": shot.depth, "vector": shot.vector}
    return {name: image[..., :rows, :columns].contiguous() for name, image in shown.items()}


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
    return {
        **passes_of(shot, rows, columns, valid), "lambda": torch.tensor([lam]), "offsets": torch.tensor(offsets or [0]),
        "image": crop(result["image"][0]), **stages, **{name: crop(result[name][0], scale) for name, scale in LEVELS.items()},
        "centre": torch.tensor([shot.centre]), **chosen,
    }  # fmt: skip


def second_case(
    net: Hush, rows: int, columns: int, window: int, lam: float, generator: torch.Generator, mapped: bool = False
) -> dict[str, Tensor]:
    """Frames of which each is denoised with those of the window that there are, and the second pass of the middle one."""
    shot, valid = random_shot(2 * window + 1, rows, columns, generator)
    chosen, whole = {}, torch.tensor([lam])
    if mapped:
        chosen["lambda_map"] = torch.exp2(torch.rand(rows, columns, generator=generator) * 6)
        whole = padded(chosen["lambda_map"][None], *valid.shape[-2:])[None]
    # What is alike from frame to frame is what the second pass averages.
    shot.colour = (0.8 * shot.colour[:1] + 0.2 * shot.colour) * padded(valid[..., :rows, :columns], *valid.shape[-2:])
    shot.vector = 0.25 * shot.vector
    of, results, trusted, logits = frames(shot, valid=valid), [], valid, torch.zeros(0)
    for frame in range(len(shot)):
        offsets = shot.window(frame, window)
        batch = {name: value[None] for name, value in view(shot, of, frame, offsets).items()}
        result = net.denoise(net.encode(of_frames(of.inputs, [frame, *(frame + k for k in offsets)])[None]), batch, whole)
        results.append(result["image"])
        if frame == shot.centre:
            trusted, logits = batch["valid"][:, 1:], result["second"]
    offsets = shot.window(shot.centre, window)
    positions = torch.cat([path(shot, shot.centre, k)[0].nan_to_num(0.0)[None] for k in offsets])
    near = warped(torch.cat([results[shot.centre + k] for k in offsets]), positions)
    image = second_pass(results[shot.centre], near[None], trusted, logits, of.exposure[shot.centre][None])
    return passes_of(shot, rows, columns, valid) | chosen | {
        "lambda": torch.tensor([lam]), "window": torch.tensor([window]),
        "first_image": results[shot.centre][0, :, :rows, :columns], "image": image[0, :, :rows, :columns],
    }  # fmt: skip


@torch.no_grad()
def main() -> None:
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("output", type=Path, help="folder for golden_model.safetensors and golden_cases.safetensors")
    out: Path = p.parse_args().output
    generator = torch.Generator().manual_seed(7)
    net = random_model(generator)
    header = {"hush.architecture": json.dumps(SMALL.header(), separators=(",", ":")), "hush.training": "random"}
    save_file(net.state_dict(), out / "golden_model.safetensors", metadata=header)
    cases: dict[str, Tensor] = {}
    for name, *settings in CASES:
        cases |= {f"{name}.{k}": v.float().contiguous() for k, v in case(net, *settings, generator).items()}
    plain = case(older(net), 16, 40, (-1, 1), 4.0, generator)
    mapped = case(net, 21, 37, (-1, 1), 1.0, generator, mapped=True)
    second = {
        "second": second_case(net, 19, 45, 2, 16.0, generator),
        "second_map": second_case(net, 24, 32, 1, 1.0, generator, mapped=True),
    }
    for name, found in ({"older": plain, "lambda_map": mapped} | second).items():
        cases |= {f"{name}.{k}": v.float().contiguous() for k, v in found.items()}
    save_file(cases, out / "golden_cases.safetensors")


if __name__ == "__main__":
    main()

"""Renders random training shots with Cycles: OUT/SEED.npz, seven noisy frames and references for the middle two.

    python -m training.shots.cycles.render runs/shots --first 0 --count 200 --assets runs/assets

Wants bpy 4.5 or 5 from PyPI, numpy and OpenEXR. The assets are the CC0 HDRIs, models and normal maps of the npm package
@pmndrs/assets, base64 in .js files: `training.shots.cycles.fetch_assets` fetches and decodes them. Without them it works too, but
a seed then gives another shot. Seeds divisible by 8 are the validation split. What is already there is skipped.
"""

from __future__ import annotations

import argparse
import random
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import bpy
import numpy as np
import OpenEXR

from training.shots.cycles import scenes
from training.shots.cycles.assets import Assets, found
from training.shots.shot_file import Passes, dull, save

FRAMES = 7
LAYERS = {"color": ("Combined", "RGB"), "albedo": ("Denoising Albedo", "RGB"), "normal": ("Denoising Normal", "XYZ")} | {
    "depth": ("Denoising Depth", "Z"),
    "vector": ("Vector", "XYZW"),
}


def read(path: Path) -> Passes:
    """The passes of a multilayer EXR, (height, width, channels)."""
    channels = {}
    for part in OpenEXR.File(str(path), separate_channels=True).parts:
        for name, channel in part.channels.items():
            channels[name.split(".", 1)[1]] = channel.pixels
    return {name: np.stack([channels[f"{layer}.{c}"] for c in parts], -1) for name, (layer, parts) in LAYERS.items()}


def render(scratch: Path, frame: int, samples: int, seed: int, adaptive: float = 0.0, least: int = 0, limit: float = 0.0) -> Passes:
    """One frame; `adaptive` is the noise threshold (0: off), `least` its minimum of samples, `limit` in seconds (0: none)."""
    scene = bpy.context.scene
    cycles = scene.cycles
    scene.frame_set(frame)
    cycles.samples, cycles.seed, cycles.time_limit = samples, seed, limit
    cycles.use_adaptive_sampling = adaptive > 0
    if adaptive > 0:
        cycles.adaptive_threshold, cycles.adaptive_min_samples = adaptive, least
    scene.update_tag()  # a new seed alone does not reach persistent data
    bpy.context.view_layer.update()
    scene.render.filepath = str(scratch)
    bpy.ops.render.render(write_still=True)
    return read(scratch)


@dataclass(frozen=True)
class Reference:
    """How long a reference is rendered: samples a pixel at most, noise threshold of adaptive sampling, seconds at most."""

    samples: int = 224
    threshold: float = 0.016
    seconds: float = 40.0


def shot(seed: int, size: int, threads: int, clean: Reference, scratch: Path, assets: Assets, target: Path) -> str:
    """Builds, renders and saves one shot; a line about it."""
    began = time.perf_counter()
    r: random.Random
    r, kind, motion = scenes.build(seed, assets)
    scene = bpy.context.scene
    scene.render.resolution_x = scene.render.resolution_y = size
    scene.render.resolution_percentage = 100
    if threads:
        scene.render.threads_mode, scene.render.threads = "FIXED", threads
    samples = round(2 ** r.uniform(0.5, 5.7))
    adaptive = 0.05 if r.random() < 0.2 else 0.0
    if why := dull(render(scratch, scenes.MIDDLE, 4, 999)):
        return f"{seed} skipped: {why}"
    noisy = [render(scratch, scenes.MIDDLE + k, samples, r.randrange(1 << 30), adaptive) for k in range(-(FRAMES // 2), FRAMES // 2 + 1)]
    halfway = time.perf_counter()
    reference, before = (
        render(scratch, scenes.MIDDLE + k, clean.samples, r.randrange(1 << 30), clean.threshold, 48, clean.seconds) for k in (0, -1)
    )
    done = time.perf_counter()
    meta = {"seed": seed, "kind": kind, "motion": motion, "spp": samples, "adaptive": adaptive}
    save(target, noisy, reference, meta, before)
    return f"{seed} {kind} {motion}: {samples} spp, noisy {halfway - began:.1f} s, references {done - halfway:.1f} s"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("output", type=Path, help="folder for the shots")
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--count", type=int, default=1, help="how many seeds")
    parser.add_argument("--every", type=int, default=1, help="of those only the multiples of this; 8: only validation shots")
    parser.add_argument("--samples", type=int, default=Reference.samples, help="of a reference, at most")
    parser.add_argument("--threshold", type=float, default=Reference.threshold, help="noise at which a reference's pixel is done")
    parser.add_argument("--seconds", type=float, default=Reference.seconds, help="for a reference, at most")
    parser.add_argument("--size", type=int, default=128, help="width and height in pixels")
    parser.add_argument("--assets", type=Path, default=Path("runs/assets"), help="folder of training.shots.cycles.fetch_assets")
    parser.add_argument("--threads", type=int, default=0, help="threads for Cycles; 0: all")
    chosen = parser.parse_args()
    assets = found(chosen.assets)
    if not assets.hdris:
        print(f"no assets in {chosen.assets}: the shots will have neither HDRIs, models nor normal maps", file=sys.stderr)
    clean = Reference(chosen.samples, chosen.threshold, chosen.seconds)
    chosen.output.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as scratch:
        for seed in range(chosen.first, chosen.first + chosen.count):
            target = chosen.output / f"{seed:06d}.npz"
            if seed % chosen.every == 0 and not target.exists():
                print(shot(seed, chosen.size, chosen.threads, clean, Path(scratch) / "frame.exr", assets, target), flush=True)


if __name__ == "__main__":
    main()

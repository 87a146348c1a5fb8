"""One training shot: its noisy takes and its references, rendered and saved (bpy 5.0 and 5.2)."""

from __future__ import annotations

import math
import random
import time
from dataclasses import dataclass
from pathlib import Path

import bpy
import numpy as np
import OpenEXR

from training.shots.cycles import device, large_frames, scenes
from training.shots.cycles.assets import found
from training.shots.cycles.features import VECTOR_LAYER
from training.shots.cycles.lights import PART, split
from training.shots.cycles.settings import Settings
from training.shots.shot_file import Passes, dull, save

FRAMES = 7
LAYERS = {"color": ("Combined", "RGB"), "albedo": ("Denoising Albedo", "RGB"), "normal": ("Denoising Normal", "XYZ")} | {
    "depth": ("Denoising Depth", "Z"),
    "vector": ("Vector", "XYZW"),
}
SPP = (0.5, 5.7)  # log2 of a take's samples
# As many samples as the takes has each half of a reference at least: what is made of it is to be better than what is made of them.
TIMES = 4


@dataclass(frozen=True)
class Sampling:
    """Of one render: samples a pixel, noise threshold of adaptive sampling (0: off), its minimum of samples, seconds at most (0: any)."""

    samples: int
    threshold: float = 0.0
    least: int = 0
    seconds: float = 0.0


def read(path: Path) -> Passes:
    """The passes of a multilayer EXR, (height, width, channels); those of the main view layer, vectors of the layer for vectors if it
    is there."""
    channels: dict[str, dict[str, np.ndarray]] = {}
    for layers in OpenEXR.File(str(path), separate_channels=True).parts:
        for name, channel in layers.channels.items():
            layer, inner = name.split(".", 1)
            channels.setdefault(layer, {})[inner] = channel.pixels
    vectors = channels.pop(VECTOR_LAYER, {})
    (main,) = channels.values()
    main |= {name: pixels for name, pixels in vectors.items() if name.startswith("Vector.")}
    passes = {name: np.stack([main[f"{layer}.{c}"] for c in parts], -1) for name, (layer, parts) in LAYERS.items()}
    of_part = [f"Combined_{PART}.{c}" for c in "RGB"]
    return passes | ({"part": np.stack([main[name] for name in of_part], -1)} if of_part[0] in main else {})


def render(scratch: Path, frame: int, sampling: Sampling, seed: int, vectors: bool = True) -> Passes:
    """One frame; without `vectors` a view layer that is there for them is left out."""
    scene = bpy.context.scene
    cycles = scene.cycles
    if scene.frame_current != frame:
        scene.frame_set(frame)
    if VECTOR_LAYER in scene.view_layers:
        scene.view_layers[VECTOR_LAYER].use = vectors
    cycles.samples, cycles.seed, cycles.time_limit = sampling.samples, seed, sampling.seconds
    cycles.use_adaptive_sampling = sampling.threshold > 0
    if sampling.threshold > 0:
        cycles.adaptive_threshold, cycles.adaptive_min_samples = sampling.threshold, sampling.least
    scene.update_tag()  # a new seed alone does not reach persistent data
    bpy.context.view_layer.update()
    scene.render.filepath = str(scratch)
    bpy.ops.render.render(write_still=True)
    return read(scratch)


def samplings(r: random.Random, takes: int) -> list[Sampling]:
    """A number of samples for each take, one from each part of the range, in random order; a fifth are adaptive."""
    low, high = SPP
    parts = r.sample(range(takes), takes)
    counts = [round(2 ** (low + (high - low) * (part + r.random()) / takes)) for part in parts]
    return [Sampling(count, 0.05 if r.random() < 0.2 else 0.0) for count in counts]


def takes_of(r: random.Random, scratch: Path, wanted: list[Sampling]) -> list[list[Passes]]:
    """The noisy frames, take by take; frame by frame they are rendered, as moving on costs more than a few samples."""
    frames = range(scenes.MIDDLE - FRAMES // 2, scenes.MIDDLE + FRAMES // 2 + 1)
    rows = [[render(scratch, frame, sampling, r.randrange(1 << 30)) for sampling in wanted] for frame in frames]
    return [list(take) for take in zip(*rows, strict=True)]


def of_seed(seed: int, what: str) -> random.Random:
    """A generator for one thing, as further draws from a shot's own would change the shots there are."""
    return random.Random(f"{seed} {what}")


def shot(seed: int, settings: Settings, scratch: Path) -> str:
    """Builds, renders and saves one shot; a line about it."""
    began = time.perf_counter()
    frame = large_frames.frame_of(of_seed(seed, "frame"), settings.size, settings.largest)
    # A pixel of movement is more of them in a larger frame, though a thing is larger still.
    r, about = scenes.build(seed, found(settings.assets), round(math.sqrt(settings.size * frame)))
    scene = bpy.context.scene
    device.choose(scene, settings.device)
    scene.render.resolution_x = scene.render.resolution_y = frame
    scene.render.resolution_percentage = 100
    large_frames.choose(of_seed(seed, "part"), scene, settings.size)
    split(of_seed(seed, "light"), scene)
    if settings.threads:
        scene.render.threads_mode, scene.render.threads = "FIXED", settings.threads
    quality = settings.quality
    wanted = samplings(r, quality.takes)
    if why := dull(render(scratch, scenes.MIDDLE, Sampling(4), 999)):
        return f"{seed} skipped: {why}"
    takes = takes_of(r, scratch, wanted)
    halfway = time.perf_counter()
    samples = max(quality.samples, TIMES * max(s.samples for s in wanted))
    clean = Sampling(samples, quality.threshold, min(48, samples), quality.seconds)
    references = [[render(scratch, scenes.MIDDLE + k, clean, r.randrange(1 << 30), vectors=False) for _ in range(2)] for k in (0, -1)]
    done = time.perf_counter()
    meta = {"seed": seed, **about, "spp": [s.samples for s in wanted], "adaptive": [s.threshold for s in wanted]}
    meta |= {"size": settings.size, "frame": frame}
    meta |= {"blender": bpy.app.version_string, "device": settings.device, "reference": [samples, quality.threshold]}
    save(settings.output / f"{seed:06d}.npz", takes, references, meta)
    what = " ".join((about["kind"], about["motion"], *about["features"]))
    return f"{seed} {what}: {meta['spp']} spp, noisy {halfway - began:.1f} s, references {done - halfway:.1f} s"

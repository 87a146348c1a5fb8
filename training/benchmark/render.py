"""Renders the benchmark's shots from nothing into a cache: CACHE/SHOT/{4spp,32spp,pass1,pass2…}/frame_0001.exr …

    python -m training.benchmark.render --cache runs/benchmark

Animated shots of 8 frames at 320×180, made for measuring and never trained on: nothing of them comes from the training shots'
generator. The noisy frames are what Blender writes for an artist with Denoising Data and Vector on; the references have
another seed and far more samples, in passes with seeds of their own: training.benchmark.run takes their mean, and tells from their
difference how noisy it still is. Frames that are there are skipped, so it can be stopped and started again. Wants bpy 5.0.1, numpy,
OpenEXR.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import bpy

from training.benchmark.frames import SPP
from training.benchmark.scenes import fog, fur, garden, glass, interior, walker
from training.benchmark.scenes.kit import FIRST, LAST
from training.shots.cycles import device
from training.shots.processes import run_all

SCENES = {"interior": interior, "garden": garden, "glass": glass, "walker": walker, "fog": fog, "fur": fur}
WIDTH, HEIGHT = 320, 180
# Of a pass: samples at most, noise threshold at which a pixel has enough.
REFERENCE = (384, 0.012)


@dataclass(frozen=True)
class Settings:
    """Where the frames go, and on what they are rendered."""

    cache: Path
    threads: int
    device: str


@dataclass
class Built:
    """The shot that a process has in Blender."""

    shot: str = ""


BUILT = Built()


def kind(text: str) -> str:
    """A number of samples, or reference."""
    if text != "reference" and not (text.isdecimal() and int(text) > 0):
        raise argparse.ArgumentTypeError(f"{text!r} is neither a number of samples nor reference")
    return text


def folders(kinds: list[str], passes: int) -> list[str]:
    """The folders of the kinds of frames: numbers of samples, and the reference's passes."""
    return [f"{kind}spp" for kind in kinds if kind.isdecimal()] + [f"pass{k + 1}" for k in range(passes) if "reference" in kinds]


def build(shot: str) -> bpy.types.Scene:
    """The shot in an empty file, with what noisy frames and references share: clamping too, or their means would differ."""
    bpy.ops.wm.read_homefile(use_empty=True)
    scene = bpy.context.scene
    SCENES[shot].build()
    render, cycles = scene.render, scene.cycles
    render.engine = "CYCLES"
    render.resolution_x, render.resolution_y, render.resolution_percentage = WIDTH, HEIGHT, 100
    render.use_motion_blur = False
    render.use_persistent_data = True
    cycles.use_denoising = False
    cycles.max_bounces, cycles.diffuse_bounces, cycles.glossy_bounces, cycles.transmission_bounces = 8, 2, 3, 8
    cycles.sample_clamp_indirect = 10.0
    cycles.caustics_reflective = cycles.caustics_refractive = False
    cycles.use_light_tree = False  # dearer a sample, and there are few lamps
    cycles.use_animated_seed = True  # or every frame carries the same noise
    settings = render.image_settings
    settings.media_type = "MULTI_LAYER_IMAGE"  # first: it resets the rest
    settings.file_format, settings.color_depth, settings.exr_codec = "OPEN_EXR_MULTILAYER", "16", "ZIP"
    scene.frame_start, scene.frame_end = FIRST, LAST
    return scene


def prepare(scene: bpy.types.Scene, folder: str) -> None:
    """Samples, seed and passes of the frames of a folder."""
    cycles, layer = scene.cycles, scene.view_layers[0]
    noisy = folder.endswith("spp")
    if noisy:
        samples = int(folder.removesuffix("spp"))
        cycles.samples, cycles.seed, cycles.use_adaptive_sampling = samples, samples, False
    else:
        cycles.samples, cycles.adaptive_threshold = REFERENCE
        cycles.seed, cycles.use_adaptive_sampling, cycles.adaptive_min_samples = 70002 + 1000 * int(folder.removeprefix("pass")), True, 64
    layer.cycles.denoising_store_passes = noisy
    layer.use_pass_vector = noisy
    layer.use_pass_z = False


def render(scene: bpy.types.Scene, frame: int, target: Path) -> float:
    """One frame, written aside and moved into place; seconds it took."""
    began = time.perf_counter()
    scene.frame_set(frame)
    scene.update_tag()  # a new seed alone does not reach persistent data
    target.parent.mkdir(parents=True, exist_ok=True)
    aside = target.with_name(f".{os.getpid()}-{target.name}")
    scene.render.filepath = str(aside)
    bpy.ops.render.render(write_still=True)
    aside.replace(target)
    return time.perf_counter() - began


def target_of(cache: Path, job: str) -> Path:
    shot, folder, frame = job.split()
    return cache / shot / folder / f"frame_{int(frame):04d}.exr"


def rendered(settings: Settings, job: str) -> str:
    """A job, such as `glass pass1 3`, in the shot that the process has, or else the one it builds; a line about it."""
    shot, folder, frame = job.split()
    target = target_of(settings.cache, job)
    if target.exists():
        return ""
    if shot != BUILT.shot:
        build(shot)
        BUILT.shot = shot
    scene = bpy.context.scene
    device.choose(scene, settings.device)
    if settings.threads:
        scene.render.threads_mode, scene.render.threads = "FIXED", settings.threads
    prepare(scene, folder)
    return f"{shot} {folder} frame {frame}: {render(scene, int(frame), target):.1f} s"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cache", type=Path, required=True, help="folder for the shots")
    parser.add_argument("--shots", nargs="+", choices=SCENES, default=list(SCENES))
    parser.add_argument("--spp", nargs="+", type=kind, default=[*map(str, SPP), "reference"], help="samples of noisy frames, or reference")
    parser.add_argument("--passes", type=int, default=4, help="of the references")
    parser.add_argument("--frames", type=int, nargs="+", default=list(range(FIRST, LAST + 1)))
    parser.add_argument("--threads", type=int, default=0, help="threads for Cycles, of each process; 0: all")
    parser.add_argument("--processes", type=int, default=1, help="that render at once")
    parser.add_argument("--device", choices=device.DEVICES, default="cpu", help="that Cycles renders on")
    chosen = parser.parse_args()
    settings = Settings(chosen.cache.resolve(), chosen.threads, chosen.device)
    wanted = folders(chosen.spp, chosen.passes)
    jobs = [f"{shot} {folder} {frame}" for shot in chosen.shots for folder in wanted for frame in chosen.frames]
    left = [job for job in jobs if not target_of(settings.cache, job).exists()]
    lost = run_all(partial(rendered, settings), left, chosen.processes)
    if lost:
        sys.exit(f"not rendered: {', '.join(lost)}; run it again for these")


if __name__ == "__main__":
    main()

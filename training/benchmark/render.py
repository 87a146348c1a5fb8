"""Renders the benchmark's shots from nothing into a cache: CACHE/SHOT/{4spp,32spp,pass1,pass2…}/frame_0001.exr …

    python -m training.benchmark.render --cache runs/benchmark

Four animated shots of 8 frames at 320×180, made for measuring and never trained on: nothing of them comes from the training
shots' generator. The noisy frames are what Blender writes for an artist with Denoising Data and Vector on; the references have
another seed and far more samples, in passes with seeds of their own: training.benchmark.run takes their mean, and tells from their
difference how noisy it still is. Frames that are there are skipped, so it can be stopped and started again. Wants bpy 5.0.1, numpy,
OpenEXR.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path

import bpy

from training.benchmark.frames import SHOTS, SPP
from training.benchmark.scenes import garden, glass, interior, walker
from training.benchmark.scenes.kit import FIRST, LAST

SCENES = {"interior": interior, "garden": garden, "glass": glass, "walker": walker}
KINDS = (*map(str, SPP), "reference")
WIDTH, HEIGHT = 320, 180
# Of a pass: samples at most, noise threshold at which a pixel has enough.
REFERENCE = (384, 0.012)


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
    cycles.device = "CPU"
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


def render(scene: bpy.types.Scene, frame: int, target: Path, scratch: Path) -> float:
    """One frame, written aside and moved into place; seconds it took."""
    began = time.perf_counter()
    scene.frame_set(frame)
    scene.update_tag()  # a new seed alone does not reach persistent data
    aside = scratch / target.name
    scene.render.filepath = str(aside)
    bpy.ops.render.render(write_still=True)
    target.parent.mkdir(parents=True, exist_ok=True)
    aside.replace(target)
    return time.perf_counter() - began


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cache", type=Path, required=True, help="folder for the shots")
    parser.add_argument("--shots", nargs="+", choices=SHOTS, default=list(SHOTS))
    parser.add_argument("--spp", nargs="+", choices=KINDS, default=list(KINDS), help="samples of noisy frames, or reference")
    parser.add_argument("--passes", type=int, default=4, help="of the references")
    parser.add_argument("--frames", type=int, nargs="+", default=list(range(FIRST, LAST + 1)))
    parser.add_argument("--threads", type=int, default=0, help="threads for Cycles; 0: all")
    chosen = parser.parse_args()
    cache = chosen.cache.resolve()
    cache.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=cache, prefix=".rendering-") as scratch:
        for shot in chosen.shots:
            scene = None
            for folder in folders(chosen.spp, chosen.passes):
                wanted = {frame: cache / shot / folder / f"frame_{frame:04d}.exr" for frame in chosen.frames}
                for frame, target in wanted.items():
                    if target.exists():
                        continue
                    scene = scene or build(shot)
                    if chosen.threads:
                        scene.render.threads_mode, scene.render.threads = "FIXED", chosen.threads
                    prepare(scene, folder)
                    seconds = render(scene, frame, target, Path(scratch))
                    print(f"{shot} {folder} frame {frame}: {seconds:.1f} s", flush=True)


if __name__ == "__main__":
    main()

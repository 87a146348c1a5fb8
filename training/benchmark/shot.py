"""One frame of the benchmark's shots, rendered with Blender 5.0.1."""

from __future__ import annotations

import os
import time
from dataclasses import dataclass
from pathlib import Path

import bpy

from training.benchmark.scenes import fog, fur, garden, glass, interior, walker
from training.benchmark.scenes.kit import FIRST, LAST
from training.benchmark.settings import Settings
from training.shots.cycles import device, large_frames

SCENES = {"interior": interior, "garden": garden, "glass": glass, "walker": walker, "fog": fog, "fur": fur}
WIDTH, HEIGHT = 320, 180
# Of a pass: samples at most, noise threshold at which a pixel has enough.
REFERENCE = (384, 0.012)


@dataclass
class Built:
    """The shot that a process has in Blender."""

    shot: str = ""


BUILT = Built()


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


def enlarge(scene: bpy.types.Scene, scale: int) -> None:
    """Makes the frame `scale` times as wide and high; of it the WIDTH × HEIGHT pixels in the middle are rendered."""
    render = scene.render
    render.resolution_x, render.resolution_y = WIDTH * scale, HEIGHT * scale
    if scale > 1:
        large_frames.border(render, (WIDTH * (scale - 1) // 2, HEIGHT * (scale - 1) // 2), (WIDTH, HEIGHT))


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


def rendered(shot: str, folder: str, frame: int, target: Path, settings: Settings) -> float:
    """A frame of the shot that the process has, or else the one it builds; seconds it took."""
    if shot != BUILT.shot:
        build(shot)
        BUILT.shot = shot
    scene = bpy.context.scene
    device.choose(scene, settings.device)
    if settings.threads:
        scene.render.threads_mode, scene.render.threads = "FIXED", settings.threads
    enlarge(scene, settings.scale)
    prepare(scene, folder)
    return render(scene, frame, target)

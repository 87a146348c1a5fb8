"""Renders the sample shot and its references from nothing: Blender as a Python module, Cycles on the CPU.

    python -m venv bpy-venv && bpy-venv/bin/pip install bpy==5.0.1 OpenEXR==3.5.3     # needs Python 3.11
    bpy-venv/bin/python samples/render_shot.py shot                     # samples/shot/frame_0001.exr …, two minutes
    bpy-venv/bin/python samples/render_shot.py reference                # samples/reference/frame_0001.exr …, three hours of CPU time
    bpy-venv/bin/python samples/render_shot.py mask --frames 4          # samples/mask/mask_0004.exr: which pixels are Suzanne

Blender keeps Vector, Denoising Normal and Denoising Depth at 32 bit even in half-float files; here they are rounded after
rendering to steps that carry no noise (see STEPS), still 32 bit, so that ZIP halves the files.
On a bare Debian machine bpy also wants: libxrender1 libxxf86vm1 libxfixes3 libxi6 libxkbcommon0 libsm6 libice6 libgl1 libegl1.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import bpy
import numpy as np
import OpenEXR
import still_life

HERE = Path(__file__).resolve().parent
MASK = "Mask"
# Steps the 32-bit passes are rounded to: pixels, parts of the unit normal, units of ten centimetres.
STEPS = {"Vector": 1 / 256, "Denoising Normal": 1 / 1024, "Denoising Depth": 1 / 512}


def common(scene: bpy.types.Scene, threads: int, percentage: int) -> None:
    """What the noisy shot and the references share; clamping must be the same or their means differ."""
    render, cycles = scene.render, scene.cycles
    render.engine = "CYCLES"
    render.resolution_x, render.resolution_y, render.resolution_percentage = 480, 270, percentage
    render.threads_mode, render.threads = "FIXED", threads
    render.use_motion_blur = False
    render.use_persistent_data = True
    cycles.device = "CPU"
    cycles.use_denoising = False
    cycles.max_bounces, cycles.diffuse_bounces, cycles.glossy_bounces, cycles.transmission_bounces = 8, 3, 3, 8
    cycles.sample_clamp_indirect = 10.0
    cycles.caustics_reflective = cycles.caustics_refractive = False
    cycles.use_animated_seed = True  # or every frame carries the same noise


def noisy(scene: bpy.types.Scene, samples: int) -> None:
    cycles, layer = scene.cycles, scene.view_layers[0]
    cycles.samples, cycles.seed, cycles.use_adaptive_sampling = samples, 1, False
    layer.cycles.denoising_store_passes = True
    layer.use_pass_vector = True
    layer.use_pass_z = False


def reference(scene: bpy.types.Scene, samples: int) -> None:
    cycles, layer = scene.cycles, scene.view_layers[0]
    cycles.samples, cycles.seed = samples, 70001
    cycles.use_light_tree = False  # a fifth cheaper a sample, though each is a little noisier
    cycles.use_adaptive_sampling, cycles.adaptive_threshold, cycles.adaptive_min_samples = True, 0.003, 256
    layer.cycles.denoising_store_passes = False
    layer.use_pass_vector = False
    layer.use_pass_z = False


def mask(scene: bpy.types.Scene, samples: int) -> None:
    """A shader AOV that is 1 on Suzanne, as an artist makes a mask for λ."""
    layer = scene.view_layers[0]
    scene.cycles.samples, scene.cycles.use_adaptive_sampling = samples, False
    aov = layer.aovs.add()
    aov.name, aov.type = MASK, "VALUE"
    for slot in bpy.data.objects["suzanne"].material_slots:
        node = slot.material.node_tree.nodes.new("ShaderNodeOutputAOV")
        node.aov_name = MASK
        node.inputs["Value"].default_value = 1.0


def written(scene: bpy.types.Scene, codec: str) -> None:
    """Multilayer EXR as Blender 5 writes it: one part a pass. The media type comes first: it resets the rest."""
    settings = scene.render.image_settings
    settings.media_type = "MULTI_LAYER_IMAGE"
    settings.file_format = "OPEN_EXR_MULTILAYER"
    settings.color_depth = "16"
    settings.exr_codec = codec


def rounded(path: Path) -> None:
    """Rewrites a rendered file with its 32-bit passes rounded to STEPS; layout, metadata and the other passes stay."""
    file = OpenEXR.File(str(path), separate_channels=True)
    parts = []
    for part in file.parts:
        step = next((s for name, s in STEPS.items() if part.name().endswith("." + name)), None)
        channels = {}
        for name, channel in part.channels.items():
            pixels = channel.pixels
            if step is not None:
                pixels = (np.round(pixels / step) * step).astype(np.float32)
            channels[name] = OpenEXR.Channel(name, np.ascontiguousarray(pixels))
        header = {key: value for key, value in part.header.items() if key not in ("channels", "chunkCount")}
        parts.append(OpenEXR.Part(header, channels, part.name()))
    aside = path.with_suffix(".part")
    OpenEXR.File(parts).write(str(aside))
    aside.replace(path)


def masked(path: Path, target: Path) -> None:
    """Keeps the mask of a rendered file alone, in halves."""
    parts = OpenEXR.File(str(path), separate_channels=True).parts
    (pixels,) = [channel.pixels for part in parts for name, channel in part.channels.items() if f".{MASK}." in f".{name}."]
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File([OpenEXR.Part(header, {"Y": pixels.clip(0, 1).astype(np.float16)}, MASK)]).write(str(target))
    path.unlink()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("what", choices=["shot", "reference", "mask"])
    parser.add_argument("--samples", type=int, help="samples a pixel (12 for the shot and the mask, at most 2000 for the references)")
    parser.add_argument("--output", type=Path, help="folder (samples/shot or samples/reference)")
    parser.add_argument("--frames", type=int, nargs="*", default=list(range(still_life.FIRST, still_life.LAST + 1)))
    parser.add_argument("--percentage", type=int, default=100, help="of 480×270")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--codec", default="ZIP", choices=["NONE", "ZIP", "ZIPS", "PIZ", "RLE"])
    chosen = parser.parse_args()
    scene = still_life.build()
    common(scene, chosen.threads, chosen.percentage)
    if chosen.what == "shot":
        noisy(scene, chosen.samples or 12)
    elif chosen.what == "mask":
        mask(scene, chosen.samples or 12)
    else:
        reference(scene, chosen.samples or 2000)
    written(scene, chosen.codec)
    folder = (chosen.output or HERE / chosen.what).resolve()
    for frame in chosen.frames:
        began = time.perf_counter()
        scene.frame_set(frame)
        scene.update_tag()
        path = folder / f"frame_{frame:04d}.exr"
        scene.render.filepath = str(path)
        bpy.ops.render.render(write_still=True)
        if chosen.what == "shot":
            rounded(path)
        elif chosen.what == "mask":
            masked(path, path := folder / f"mask_{frame:04d}.exr")
        print(f"{path.name}: {time.perf_counter() - began:.1f} s, {path.stat().st_size / 1e6:.2f} MB", flush=True)


if __name__ == "__main__":
    main()

"""What the compositor makes of a frame, for Blenders with the extension and without."""

from __future__ import annotations

from pathlib import Path

import bpy
import kit
import numpy as np

CHANNELS = "RGBA"


def incoming() -> np.ndarray:
    """What comes into the node of `scene_with_node`: other values at every pixel, some of them fireflies, and transparent ones. RGBA."""
    rows, columns = np.mgrid[:54, :96]
    plane = 20 + columns / 100 + rows / 1000
    image = np.stack([plane, plane / 2, plane / 4, (columns % 7) / 6], -1).astype(np.float32)
    image[5, 5], image[6, 6] = (1e30, 1e30, 1e30, 1), (0, 0, 0, 0)
    return image


def render(scene: bpy.types.Scene, frame: int, folder: Path) -> np.ndarray:
    """Renders a frame, as F12 does, and returns what the compositor made of it, RGBA."""
    render, settings = scene.render, scene.render.image_settings
    kept = (
        (render, "filepath", render.filepath),
        (scene, "frame_start", scene.frame_start),
        (scene, "frame_end", scene.frame_end),
        *((settings, name, getattr(settings, name)) for name in ("media_type", "file_format", "color_depth") if hasattr(settings, name)),
    )
    if hasattr(settings, "media_type"):
        settings.media_type = "IMAGE"
    settings.file_format, settings.color_mode, settings.color_depth = "OPEN_EXR", "RGBA", "32"
    scene.frame_set(frame)
    if scene == bpy.context.scene:
        render.filepath = str(folder / f"result_{frame}")
        bpy.ops.render.render(write_still=True)
    else:
        # Of other scenes Blender renders single frames with the images of their last frame.
        render.filepath = str(folder / "result_#")
        scene.frame_start = scene.frame_end = frame
        bpy.ops.render.render(animation=True, scene=scene.name)
    for owner, name, value in kept:
        setattr(owner, name, value)
    planes = kit.channels(folder / f"result_{frame}.exr")
    return np.stack([planes[name] for name in CHANNELS], -1)

"""For cases about the node and the status: denoised frames that can be told apart, and what the compositor makes of them."""

from __future__ import annotations

import hashlib
import importlib
import json
from pathlib import Path
from types import ModuleType

import bpy
import kit
import numpy as np

BLENDER_5 = bpy.app.version >= (5, 0)


def module(name: str) -> ModuleType:
    """A module of the extension."""
    return importlib.import_module(f"{kit.MODULE}.{name}")


def picture(frame: int, base: float = 10.0) -> np.ndarray:
    """What the made-up denoised frame shows: another number at every pixel and frame."""
    rows, columns = np.mgrid[:54, :96]
    plane = (base + frame + columns / 100 + rows / 1000).astype(np.float32)
    return np.stack([plane, plane / 2, plane / 4], -1)


def make_denoised(shot: Path, frames: range | list[int], base: float = 10.0, folder: str = "denoised") -> Path:
    """Writes `picture(frame)` as the Combined pass of copies of a shot's files, beside them."""
    output = shot / folder
    output.mkdir(exist_ok=True)
    for frame in frames:
        path = output / f"frame_{frame:04d}.exr"
        path.write_bytes((shot / path.name).read_bytes())
        image = picture(frame, base)

        def change(name: str, pixels: np.ndarray, image: np.ndarray = image) -> np.ndarray:
            if ".Combined." not in name:
                return pixels
            channel = "RGB".find(name[-1])
            return image[..., channel].astype(pixels.dtype) if channel >= 0 else np.ones_like(pixels)

        kit.rewrite(path, change)
    return output


def scene_with_node(shot: Path) -> tuple[bpy.types.Scene, bpy.types.Node]:
    """The test scene with Render Layers, Temporal Denoise and output; its frames are read from `shot`."""
    scene = kit.build_scene()
    scene.hush.input_folder = str(shot)
    assert bpy.ops.hush.add_node() == {"FINISHED"}
    (node,) = module("node").nodes(scene)
    return scene, node


def composite(scene: bpy.types.Scene, frame: int, folder: Path, view: str = "") -> np.ndarray:
    """Renders a frame and returns what the compositor made of it, RGB."""
    render = scene.render
    settings = render.image_settings
    if hasattr(settings, "media_type"):
        settings.media_type = "IMAGE"
    settings.file_format, settings.color_mode, settings.color_depth = "OPEN_EXR", "RGBA", "32"
    if render.use_multiview:
        settings.views_format = "INDIVIDUAL"
    before = render.filepath
    scene.frame_set(frame)
    if scene == bpy.context.scene:
        render.filepath = str(folder / f"result_{frame}")
        bpy.ops.render.render(write_still=True)
    else:
        # Of other scenes Blender renders single frames with the images of their last frame.
        render.filepath = str(folder / "result_#")
        scene.frame_start = scene.frame_end = frame
        bpy.ops.render.render(animation=True, scene=scene.name)
    render.filepath = before
    planes = kit.channels(folder / f"result_{frame}{view}.exr")
    return np.stack([planes[c] for c in "RGB"], -1)


def noisy(shot: Path, frame: int) -> np.ndarray:
    """What Cycles rendered."""
    return kit.layer(shot / f"frame_{frame:04d}.exr", "Combined")


def write_manifest(shot: Path, frames: list[int], folder: str = "denoised", neighbours: int = 0, **settings: object) -> None:
    """Writes the manifest that a run over these frames with these settings would leave."""
    made = {
        "lambda": 1.0,
        "window": 2,
        "layer": None,
        "view": None,
        "vector_layer": None,
        "guides": {"albedo": True, "normal": True, "depth": True, "vector": True},
        "aovs": [],
        "keep_noisy": False,
        "model": {"name": "embedded", "hash": "0"},
    } | settings
    key = hashlib.md5(json.dumps(made).encode()).hexdigest()

    def stamp(frame: int) -> dict[str, int]:
        stat = (shot / f"frame_{frame:04d}.exr").stat()
        return {"size": stat.st_size, "modified": stat.st_mtime_ns // 1_000_000}

    path = shot / folder / "hush-manifest.json"
    old = json.loads(path.read_text()) if path.exists() else {"version": 1, "settings": {}, "frames": {}}
    old["settings"][key] = made
    for frame in frames:
        around = [n for n in range(frame - neighbours, frame + neighbours + 1) if n != frame and n in kit.FRAMES]
        old["frames"][f"frame_{frame:04d}.exr"] = {
            "frame": frame,
            "source": str(shot / f"frame_{frame:04d}.exr"),
            "stamp": stamp(frame),
            "status": "denoised",
            "settings": key,
            "hush": "0.1.0",
            "neighbours": [{"offset": n - frame, "frame": n, "used": True, "stamp": stamp(n)} for n in around],
            "seconds": 0.1,
        }
    path.write_text(json.dumps(old))

"""A small animation from nothing, without a window: built, prepared, rendered, denoised and composited.

    python3.11 -m venv bpy-venv && bpy-venv/bin/pip install bpy==5.0.1 . && bpy-venv/bin/python samples/headless.py --frames 12
    blender -b -P samples/headless.py -- --frames 12 --size 640x360 --samples 16

The first builds the Python module, which wants Rust; a wheel in place of the dot does not (docs/install.md). The extension is taken as it
is installed in Blender, else from this repository. The last call is all that an existing script needs; run again it goes on where it was
stopped.
"""

from __future__ import annotations

import argparse
import atexit
import importlib.util
import math
import sys
from pathlib import Path

import bpy

ROOT = Path(__file__).resolve().parents[1]


def size(text: str) -> tuple[int, int]:
    """A size such as 320x180."""
    try:
        width, height = (int(number) for number in text.lower().split("x"))
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is no size such as 320x180") from None
    if not (4 <= width <= 16384 and 4 <= height <= 16384):
        raise argparse.ArgumentTypeError("sizes go from 4x4 to 16384x16384")
    return width, height


def at_least_one(text: str) -> int:
    """A whole number above 0."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number above 0")
    return int(text)


def arguments() -> argparse.Namespace:
    """What stands behind `--` in Blender, or behind the script's name in Python."""
    given = sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else [] if bpy.app.binary_path else sys.argv[1:]
    parser = argparse.ArgumentParser(prog="headless.py", description="Renders, denoises and composites a small animation.")
    parser.add_argument("--frames", type=at_least_one, default=8, help="length (8)")
    parser.add_argument("--size", type=size, default=(320, 180), help="in pixels (320x180)")
    parser.add_argument("--samples", type=at_least_one, default=16, help="a pixel (16)")
    parser.add_argument("--lambda", dest="lam", type=float, default=1.0, help="noise to keep, 1 to 64 (1)")
    parser.add_argument("--motion-blur", action="store_true", help="blur what moves")
    parser.add_argument("--output", type=Path, default=Path("headless"), help="folder (headless)")
    return parser.parse_args(given)


def load_hush() -> None:
    """Sees to it that `bpy.ops.hush` is there."""
    import addon_utils

    installed = next((module.__name__ for module in addon_utils.modules() if module.__name__.endswith(".hush")), None)
    if hasattr(bpy.types.Scene, "hush"):
        return
    if installed is not None and addon_utils.enable(installed):
        return
    if importlib.util.find_spec("hush") is None:
        sys.exit("headless.py: Python module hush not found. Install it or, in Blender, the extension: docs/install.md")
    sys.path.insert(0, str(ROOT))
    import blender_addon

    blender_addon.register()
    # Blender 4.5 hangs at its end while classes are registered; of installed extensions it sees to that itself.
    atexit.register(blender_addon.unregister)


def material(name: str, colour: tuple[float, float, float], *, metallic: float = 0.0, roughness: float = 0.5) -> bpy.types.Material:
    """A plain surface."""
    made = bpy.data.materials.new(name)
    if made.node_tree is None:
        made.use_nodes = True
    surface = made.node_tree.nodes["Principled BSDF"]
    surface.inputs["Base Color"].default_value = (*colour, 1.0)
    surface.inputs["Metallic"].default_value = metallic
    surface.inputs["Roughness"].default_value = roughness
    return made


def build(frames: int) -> bpy.types.Scene:
    """A ball that rolls around a turning ring of bricks, under one lamp."""
    bpy.ops.wm.read_homefile(use_empty=True)
    scene = bpy.context.scene
    bpy.ops.mesh.primitive_plane_add(size=30)
    bpy.context.object.data.materials.append(material("Floor", (0.35, 0.3, 0.27)))
    bpy.ops.object.empty_add()
    ring = bpy.context.object
    clay = [material(f"Clay {n}", colour) for n, colour in enumerate(((0.6, 0.18, 0.1), (0.75, 0.5, 0.2), (0.2, 0.35, 0.4)))]
    for number in range(12):
        angle = number / 12 * math.tau
        bpy.ops.mesh.primitive_cube_add(size=0.7, location=(2 * math.cos(angle), 2 * math.sin(angle), 0.35 + 0.2 * (number % 3)))
        brick = bpy.context.object
        brick.rotation_euler.z = angle
        brick.data.materials.append(clay[number % 3])
        brick.parent = ring
    bpy.ops.mesh.primitive_uv_sphere_add(radius=0.6, segments=48, ring_count=24)
    ball = bpy.context.object
    bpy.ops.object.shade_smooth()
    ball.data.materials.append(material("Brass", (0.85, 0.6, 0.25), metallic=1.0, roughness=0.25))
    bpy.ops.object.light_add(type="AREA", location=(3, -4, 5), rotation=(0.7, 0.2, 0.4))
    bpy.context.object.data.energy, bpy.context.object.data.size = 500, 1.5
    bpy.ops.object.camera_add(location=(0, -8, 4.5), rotation=(math.radians(62), 0, 0))
    scene.camera = bpy.context.object
    scene.frame_start, scene.frame_end = 1, frames
    # Beyond the ends too: the motion vectors of the first and last frame look there.
    for frame in range(-1, frames + 3):
        turn = 0.06 * frame
        ring.rotation_euler.z = turn
        ball.location = (3.4 * math.cos(-2 - turn), 3.4 * math.sin(-2 - turn), 0.6)
        scene.camera.location.x = 0.08 * frame
        ring.keyframe_insert("rotation_euler", frame=frame)
        ball.keyframe_insert("location", frame=frame)
        scene.camera.keyframe_insert("location", frame=frame)
    return scene


def main() -> None:
    """Makes the animation; ends with an error where a step fails."""
    chosen = arguments()
    load_hush()
    scene = build(chosen.frames)
    scene.render.engine = "CYCLES"
    scene.render.resolution_x, scene.render.resolution_y = chosen.size
    scene.render.use_motion_blur = chosen.motion_blur
    scene.render.filepath = str(chosen.output.resolve() / "noisy" / "frame_####")
    scene.cycles.samples = chosen.samples
    scene.cycles.use_adaptive_sampling = False
    scene.hush.lam = chosen.lam
    scene.hush.output_folder = str(chosen.output.resolve() / "denoised")
    scene.hush.composite_folder = str(chosen.output.resolve() / "composited")
    scene.hush.composite_format = "PNG"
    bpy.ops.hush.add_node()

    bpy.ops.hush.whole_shot()
    print(f"The frames are in {chosen.output}/noisy, /denoised and /composited", flush=True)


if __name__ == "__main__":
    try:
        main()
    except RuntimeError as error:
        sys.exit(f"headless.py: {error}")

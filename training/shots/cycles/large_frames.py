"""Shots that are squares of larger frames: what artists render has far more pixels to a thing than a frame of 128."""

from __future__ import annotations

import math
import random
from collections.abc import Sequence

import bpy
from bpy_extras.object_utils import world_to_camera_view
from mathutils import Vector

WHOLE = 0.25  # share of the shots that are their whole frame
AIMED = 0.75  # share of the others whose middle is near that of a thing
SPREAD = 0.3  # deviation from there, in sides of the square


def frame_of(r: random.Random, size: int, largest: float) -> int:
    """The side in pixels of the frame that a shot of `size` is a part of: up to `largest` times that, evenly by the logarithm."""
    return size if largest <= 1 or r.random() < WHOLE else round(size * math.exp(r.uniform(0, math.log(largest))))


def middles(scene: bpy.types.Scene) -> list[tuple[float, float]]:
    """Where the middles of the things that the camera sees are in the frame, 0…1 from the lower left."""
    found = []
    for thing in scene.objects:
        if thing.type == "MESH":
            middle = thing.matrix_world @ (sum((Vector(corner) for corner in thing.bound_box), Vector()) / 8)
            x, y, depth = world_to_camera_view(scene, scene.camera, middle)
            if depth > 0 and 0 < x < 1 and 0 < y < 1:
                found.append((x, y))
    return found


def border(render: bpy.types.RenderSettings, start: Sequence[int], size: Sequence[int]) -> None:
    """Renders only so many pixels of the frame, from those on, by column and row, rows up."""
    (left, low), (width, height) = start, size
    render.use_border = render.use_crop_to_border = True
    # Blender rounds: a tenth of a pixel keeps off the half, and off the whole number.
    render.border_min_x, render.border_max_x = ((at + 0.1) / render.resolution_x for at in (left, left + width))
    render.border_min_y, render.border_max_y = ((at + 0.1) / render.resolution_y for at in (low, low + height))


def choose(r: random.Random, scene: bpy.types.Scene, size: int) -> None:
    """Renders only a square of `size` pixels of the scene's frame."""
    render = scene.render
    side = render.resolution_x
    if side <= size:
        return
    bpy.context.view_layer.update()
    seen = middles(scene)
    aim = r.choice(seen) if seen and r.random() < AIMED else None
    starts = []
    for axis in range(2):
        at = aim[axis] * side + r.gauss(0, SPREAD) * size - size / 2 if aim else r.uniform(0, side - size)
        starts.append(min(max(round(at), 0), side - size))
    border(render, starts, (size, size))

"""Movement in the training shots."""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Sequence
from typing import Any

import bpy
from mathutils import Euler, Vector

MIDDLE = 6  # the frame that shows the pose as built
KEYED = range(1, 12)


def keyed(thing: Any, path: str, value: Callable[[int], Any]) -> None:  # noqa: ANN401 (anything that Blender animates)
    """A key on every frame."""
    for frame in KEYED:
        setattr(thing, path, value(frame))
        thing.keyframe_insert(path, frame=frame)


def animate(thing: bpy.types.Object, travel: Sequence[float], spin: Sequence[float]) -> None:
    """Constant velocity over all frames; `travel` in units a frame, `spin` in radians a frame."""
    turns = thing.type == "CAMERA"  # those are in quaternions
    where = thing.location.copy()
    pose = (thing.rotation_quaternion if turns else thing.rotation_euler).copy()
    for frame in (KEYED[0], KEYED[-1]):
        k = frame - MIDDLE
        thing.location = where + Vector(travel) * k
        if turns:
            thing.rotation_quaternion = Euler([a * k for a in spin]).to_quaternion() @ pose
        else:
            thing.rotation_euler = [a + b * k for a, b in zip(pose, spin, strict=True)]
        thing.keyframe_insert("location", frame=frame)
        thing.keyframe_insert("rotation_quaternion" if turns else "rotation_euler", frame=frame)


def move_camera(r: random.Random, eye: bpy.types.Object, way: Vector, step: float) -> str:
    """Animates the camera; `step` is the travel that makes about one pixel a frame. Returns the kind of motion."""
    speed = math.exp(r.uniform(-1, 2.0)) * step
    kind = r.choices(["static", "truck", "dolly", "pan", "mix"], [0.15, 0.3, 0.15, 0.15, 0.25])[0]
    travel, spin = Vector((0, 0, 0)), [0.0, 0.0, 0.0]
    if kind in ("truck", "mix"):
        travel += eye.rotation_quaternion @ Vector((r.gauss(0, 1), r.gauss(0, 0.5), 0)) * speed
    if kind in ("dolly", "mix"):
        travel += eye.rotation_quaternion @ Vector((0, 0, r.choice([-1, 1]))) * speed * 2
    if kind in ("pan", "mix"):
        spin[2] = r.gauss(0, 1) * speed / way.length
    if kind != "static":
        animate(eye, travel, spin)
    return kind


def flicker(r: random.Random, light: bpy.types.Light, depth: float) -> None:
    """Another brightness on every frame, at most `depth` of it less."""
    energy = light.energy
    keyed(light, "energy", lambda frame: energy * (1 - depth * r.random()))

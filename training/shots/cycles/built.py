"""A training shot whose camera stands, for what is then added to it."""

from __future__ import annotations

import random
from dataclasses import dataclass

import bpy
from mathutils import Vector

from training.shots.cycles.assets import Assets


@dataclass
class Built:
    """A shot so far: its generator, kind, size in units, things and lamps; how far from the camera its target is, and the travel there
    that makes a pixel a frame."""

    r: random.Random
    scene: bpy.types.Scene
    kind: str
    size: float
    assets: Assets
    things: list[bpy.types.Object]
    lights: list[bpy.types.Object]
    distance: float
    step: float

    def place(self, low: float, high: float) -> Vector:
        """Somewhere in the picture, between these shares of the target's distance, not below the ground."""
        eye = self.scene.camera
        reach = 0.75 * 18 / eye.data.lens
        way = Vector((self.r.uniform(-reach, reach), self.r.uniform(-reach, reach), -1)) * self.distance * self.r.uniform(low, high)
        where = eye.location + eye.rotation_quaternion @ way
        where.z = max(where.z, 0.02 * self.size)
        return where

    def seen(self) -> list[bpy.types.Object]:
        """The meshes among the things whose middle is in the picture; all meshes where none is."""
        eye = self.scene.camera
        reach = 18 / eye.data.lens
        meshes = [thing for thing in self.things if thing.type == "MESH" and len(thing.data.polygons) > 0]
        inside = lambda p: p.z < 0 and max(abs(p.x), abs(p.y)) < -p.z * reach
        turned = eye.rotation_quaternion.inverted()
        return [thing for thing in meshes if inside(turned @ (thing.location - eye.location))] or meshes

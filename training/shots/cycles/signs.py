"""Things that glow: letters, tubes, bulbs, and those before a lit wall."""

from __future__ import annotations

import math
import random
from collections.abc import Callable

import bpy
from mathutils import Vector

from training.shots.cycles.built import Built
from training.shots.cycles.lights import area_lamp
from training.shots.cycles.materials import colour, texture_colour
from training.shots.cycles.meshes import lettering
from training.shots.cycles.motion import keyed


def glowing(r: random.Random, strength: float) -> bpy.types.Material:
    made = bpy.data.materials.new("glow")
    made.use_nodes = True
    inputs = made.node_tree.nodes["Principled BSDF"].inputs
    inputs["Base Color"].default_value = (0, 0, 0, 1)
    inputs["Emission Color"].default_value = colour(r, 0.8, 1.0, r.random() * 0.9)
    inputs["Emission Strength"].default_value = strength
    return made


def bulbs(shot: Built, count: int, strength: tuple[float, float], depth: tuple[float, float]) -> None:
    """Small glowing balls in the picture; strength as its logarithm's range, depth in shares of the target's distance."""
    r = shot.r
    for _ in range(count):
        radius = shot.distance * math.exp(r.uniform(-5.5, -4.2))
        bpy.ops.mesh.primitive_uv_sphere_add(segments=16, ring_count=8, radius=radius, location=shot.place(*depth))
        bpy.context.object.data.materials.append(glowing(r, math.exp(r.uniform(*strength))))


def dimmed(r: random.Random, full: float) -> Callable[[int], float]:
    """Another strength for every frame."""
    return lambda _: full * r.uniform(0.3, 1)


def signs(shot: Built) -> None:
    """Glowing letters, neon tubes and small bright lamps; a third of them flicker."""
    r = shot.r
    for _ in range(r.randint(1, 3)):
        if r.random() < 0.6:
            lettering(r)
            sign = bpy.context.object
        else:
            curve = bpy.data.curves.new("tube", "CURVE")
            curve.dimensions, curve.bevel_depth = "3D", r.uniform(0.02, 0.05)
            spline = curve.splines.new("BEZIER")
            spline.bezier_points.add(r.randint(2, 5))
            for point in spline.bezier_points:
                point.co = (r.uniform(-1, 1), r.uniform(-0.1, 0.1), r.uniform(-0.7, 0.7))
                point.handle_left_type = point.handle_right_type = "AUTO"
            sign = bpy.data.objects.new("tube", curve)
            shot.scene.collection.objects.link(sign)
        sign.scale = [shot.distance * r.uniform(0.06, 0.16)] * 3
        sign.location = shot.place(0.6, 1.2)
        facing = (shot.scene.camera.location - sign.location).to_track_quat("-Y", "Z").to_euler().z
        sign.rotation_euler = (math.pi / 2 if sign.type == "FONT" else 0, 0, facing + r.gauss(0, 0.5))
        glow = glowing(r, math.exp(r.uniform(0.5, 3.5)))
        sign.data.materials.append(glow)
        if r.random() < 0.33:
            strength = glow.node_tree.nodes["Principled BSDF"].inputs["Emission Strength"]
            full = strength.default_value
            keyed(strength, "default_value", dimmed(r, full))
    bulbs(shot, r.randint(2, 9), (3, 6.5), (0.5, 1.3))


def seen_lamp(shot: Built, strength: float, depth: tuple[float, float]) -> None:
    """A lamp that the camera sees, as bright as a surface of that strength."""
    r = shot.r
    lamp = bpy.data.lights.new("seen", "POINT")
    lamp.shadow_soft_size = shot.distance * math.exp(r.uniform(-5.5, -3.5))
    lamp.energy = 4 * math.pi**2 * lamp.shadow_soft_size**2 * strength
    lamp.color = colour(r, 0.8, 1.0, r.random() * 0.5)[:3]
    light = bpy.data.objects.new("seen", lamp)
    light.location, light.visible_camera = shot.place(*depth), True
    shot.scene.collection.objects.link(light)


def lit_wall(shot: Built) -> None:
    """A pale wall under a lamp, behind bulbs and lamps that are seen: bright edges on both sides, of light and of albedo."""
    r, eye = shot.r, shot.scene.camera
    ahead = eye.rotation_quaternion @ Vector((0, 0, -1))
    share = 0.9 if shot.kind == "room" else r.uniform(1.0, 1.5)
    middle = eye.location + ahead * shot.distance * share
    bpy.ops.mesh.primitive_plane_add(size=shot.distance * share * 36 / eye.data.lens * r.uniform(0.7, 2), location=middle)
    wall = bpy.context.object
    wall.rotation_euler = (-ahead + Vector([r.gauss(0, 0.15) for _ in range(3)])).to_track_quat("Z", "Y").to_euler()
    pale = bpy.data.materials.new("wall")
    pale.use_nodes = True
    inputs = pale.node_tree.nodes["Principled BSDF"].inputs
    inputs["Base Color"].default_value = colour(r, 0.6, 0.95, r.random() * 0.3)
    if r.random() < 0.4:
        pale.node_tree.links.new(texture_colour(r, pale.node_tree, 2.0, shot.assets), inputs["Base Color"])
    wall.data.materials.append(pale)
    energy, size = shot.distance**2 * r.uniform(10, 60), shot.distance * math.exp(r.uniform(-2.5, -0.7))
    before = middle + (Vector([r.gauss(0, 0.4) for _ in range(3)]) - ahead * 0.5) * shot.distance
    area_lamp(shot.scene, energy, size, before, middle)
    depth = (0.4, share - 0.1)
    bulbs(shot, r.randint(0, 7), (0, 5), depth)
    for _ in range(r.randint(2, 6)):
        seen_lamp(shot, math.exp(r.uniform(0, 4)), depth)

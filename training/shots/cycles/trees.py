"""Trees whose twigs and leaves, a few pixels long, stand before the sky; the camera is turned up to them."""

from __future__ import annotations

import math
import random

import bpy
from mathutils import Euler, Quaternion, Vector

from training.shots.cycles.built import Built
from training.shots.cycles.materials import colour, material
from training.shots.cycles.meshes import creased_leaves
from training.shots.cycles.motion import animate

FORKS = 4  # from the trunk to the twigs
Limb = tuple[Vector, Vector, float]  # from, to, radius


def turn_up(r: random.Random, eye: bpy.types.Object) -> None:
    """Turns the camera to the sky above what it looks at."""
    ahead = eye.rotation_quaternion @ Vector((0, 0, -1))
    rise = r.uniform(0.0, 0.45)
    level = Vector((ahead.x, ahead.y, 0)).normalized() * math.cos(rise)
    eye.rotation_quaternion = (level + Vector((0, 0, math.sin(rise)))).to_track_quat("-Z", "Y")


def grown(r: random.Random, start: Vector, way: Vector, radius: float, forks: int) -> list[Limb]:
    """A limb and all that grow out of it; the last ones are twigs."""
    end = start + way
    limbs = [(start, end, radius)]
    if forks == 0:
        return limbs
    for _ in range(r.randint(2, 4)):
        turn = Euler([r.gauss(0, 0.55) for _ in range(3)]).to_quaternion()
        limbs += grown(r, start + way * r.uniform(0.6, 1), turn @ way * r.uniform(0.6, 0.85), radius * 0.55, forks - 1)
    return limbs


def wood(limbs: list[Limb]) -> bpy.types.Object:
    """The limbs as rods that taper."""
    curve = bpy.data.curves.new("wood", "CURVE")
    curve.dimensions, curve.bevel_depth, curve.bevel_resolution = "3D", 1.0, 1
    for start, end, radius in limbs:
        spline = curve.splines.new("POLY")
        spline.points.add(1)
        for point, at, wide in zip(spline.points, (start, end), (radius, radius * 0.6), strict=True):
            point.co, point.radius = (*at, 1), wide
    return bpy.data.objects.new("wood", curve)


def leaf_material(r: random.Random) -> bpy.types.Material:
    """Lit through, and another colour from leaf to leaf."""
    made = bpy.data.materials.new("tree leaf")
    made.use_nodes = True
    tree = made.node_tree
    ramp = tree.nodes.new("ShaderNodeValToRGB")
    tint = r.random()
    for element in ramp.color_ramp.elements:
        element.color = colour(r, 0.05, 0.7) if tint < 0.3 else (r.uniform(0.02, 0.3), r.uniform(0.08, 0.5), r.uniform(0.01, 0.1), 1)
    tree.links.new(tree.nodes.new("ShaderNodeNewGeometry").outputs["Random Per Island"], ramp.inputs["Fac"])
    shader, through, both = (
        tree.nodes["Principled BSDF"],
        tree.nodes.new("ShaderNodeBsdfTranslucent"),
        tree.nodes.new("ShaderNodeMixShader"),
    )
    shader.inputs["Roughness"].default_value = r.uniform(0.3, 0.8)
    both.inputs[0].default_value = r.uniform(0, 0.5)
    for number, source in enumerate((shader, through), 1):
        tree.links.new(ramp.outputs["Color"], source.inputs[0])
        tree.links.new(source.outputs[0], both.inputs[number])
    tree.links.new(both.outputs[0], tree.nodes["Material Output"].inputs["Surface"])
    return made


def crown(r: random.Random, twigs: list[Limb], length: float, count: int) -> bpy.types.Object:
    """Leaves along the twigs, four corners each with a crease."""
    wide, crease = length * r.uniform(0.15, 0.35), length * r.uniform(0, 0.15)

    def place() -> tuple[Vector, Quaternion]:
        start, end, _radius = r.choice(twigs)
        turn = Quaternion([r.gauss(0, 1) for _ in range(4)]).normalized()
        return start.lerp(end, r.random()), turn

    leaves = creased_leaves("crown", (wide, length, crease), (place() for _ in range(count)))
    leaves.data.materials.append(leaf_material(r))
    return leaves


def tree(shot: Built) -> None:
    """One tree with its crown in the picture; some are bare, most sway."""
    r, eye = shot.r, shot.scene.camera
    far, reach = shot.distance * r.uniform(0.6, 1.5), 0.6 * 18 / eye.data.lens
    middle = eye.location + eye.rotation_quaternion @ Vector((r.uniform(-reach, reach), r.uniform(-reach, reach), -1)) * far
    height = far * 36 / eye.data.lens * r.uniform(0.7, 1.5)
    limbs = grown(r, Vector((0, 0, 0)), Vector((r.gauss(0, 0.03), r.gauss(0, 0.03), 0.3)) * height, height * 0.025, FORKS)
    twigs = [limb for limb in limbs if limb[2] < height * 0.025 * 0.55 ** (FORKS - 1.5)]
    base = Vector((middle.x, middle.y, middle.z - height * 0.55))
    limbs.append((Vector((0, 0, min(0, -base.z))), Vector((0, 0, 0)), height * 0.03))
    trunk = wood(limbs)
    trunk.data.materials.append(material(r, 3.0, shot.assets, emits=False))
    parts = [trunk]
    if r.random() < 0.85:
        pixel = shot.step * far / shot.distance
        parts.append(crown(r, twigs, pixel * math.exp(r.uniform(0.2, 2.4)), r.randint(1500, 7000)))
    spin = [r.gauss(0, 0.006) for _ in range(3)] if r.random() < 0.6 else None
    for part in parts:
        part.location = base
        shot.scene.collection.objects.link(part)
        if spin:
            animate(part, [0, 0, 0], spin)


def trees(shot: Built) -> None:
    """Two to four trees, a sky that is not black, and often a sun."""
    r, scene = shot.r, shot.scene
    turn_up(r, scene.camera)
    for _ in range(r.randint(2, 4)):
        tree(shot)
    strength = scene.world.node_tree.nodes["Background"].inputs["Strength"]
    strength.default_value = max(strength.default_value, r.uniform(0.4, 1.5))
    if r.random() < 0.6:
        lamp = bpy.data.lights.new("sun", "SUN")
        lamp.energy, lamp.angle = r.uniform(1, 6), math.exp(r.uniform(-5, -1.5))
        sun = bpy.data.objects.new("sun", lamp)
        sun.rotation_euler = (r.uniform(0.2, 1.2), 0, r.uniform(0, 6.28))
        scene.collection.objects.link(sun)

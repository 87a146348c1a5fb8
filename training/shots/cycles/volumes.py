"""Volumes for the training shots: haze, fog, smoke, fire, tinted bodies."""

from __future__ import annotations

import math
import random
from collections.abc import Callable

import bpy
from mathutils import Vector

from training.shots.cycles.materials import colour
from training.shots.cycles.motion import keyed


def volume_material(kind: str) -> tuple[bpy.types.NodeTree, bpy.types.Node, bpy.types.Material]:
    """A material without a surface whose volume is a node of this kind."""
    material = bpy.data.materials.new("volume")
    material.use_nodes = True
    tree = material.node_tree
    tree.nodes.remove(tree.nodes["Principled BSDF"])
    shader = tree.nodes.new(f"ShaderNodeVolume{kind}")
    tree.links.new(shader.outputs[0], tree.nodes["Material Output"].inputs["Volume"])
    return tree, shader, material


def filled(size: float, density: float, anisotropy: float, tint: tuple[float, ...] = (1, 1, 1, 1)) -> None:
    """Even fog in all of the scene."""
    bpy.ops.mesh.primitive_cube_add(size=1, location=(0, 0, size * 0.5))
    volume = bpy.context.object
    volume.scale = (size * 2.3, size * 2.3, size * 1.1)
    _, scatter, material = volume_material("Scatter")
    scatter.inputs["Density"].default_value = density
    scatter.inputs["Anisotropy"].default_value = anisotropy
    scatter.inputs["Color"].default_value = tint
    volume.data.materials.append(material)


def haze(r: random.Random, size: float) -> None:
    """Thin fog in all of the scene, now and then."""
    if r.random() < 0.06:
        filled(size, math.exp(r.uniform(-4, -2)), 0.0)


def smoke(r: random.Random, size: float, where: Vector) -> None:
    """A ball of noise that drifts and swells with time; one in four glows."""
    bpy.ops.mesh.primitive_ico_sphere_add(subdivisions=3, radius=1)
    cloud = bpy.context.object
    cloud.scale = [size * r.uniform(0.2, 0.5) for _ in range(3)]
    cloud.location = where
    tree, shader, material = volume_material("Principled")
    shader.inputs["Color"].default_value = colour(r, 0.3, 1.0, r.random() * 0.4)
    shader.inputs["Anisotropy"].default_value = r.uniform(-0.3, 0.7)
    source = tree.nodes.new("ShaderNodeTexCoord")
    noise = tree.nodes.new("ShaderNodeTexNoise")
    noise.noise_dimensions = "4D"
    noise.inputs["Scale"].default_value = r.uniform(1.5, 5)
    noise.inputs["Detail"].default_value = r.uniform(1, 5)
    tree.links.new(source.outputs["Object"], noise.inputs["Vector"])
    start, speed = r.uniform(0, 20), r.uniform(0, 0.06)
    keyed(noise.inputs["W"], "default_value", lambda frame: start + speed * frame)
    # Denser in the middle, nothing at the rim.
    middle = tree.nodes.new("ShaderNodeVectorMath")
    middle.operation = "LENGTH"
    tree.links.new(source.outputs["Object"], middle.inputs[0])
    body = tree.nodes.new("ShaderNodeMath")
    body.operation = "SUBTRACT"
    tree.links.new(noise.outputs[0], body.inputs[0])
    rim = tree.nodes.new("ShaderNodeMath")
    rim.operation = "MULTIPLY_ADD"
    rim.inputs[1].default_value, rim.inputs[2].default_value = 0.55, r.uniform(0.05, 0.3)
    tree.links.new(middle.outputs["Value"], rim.inputs[0])
    tree.links.new(rim.outputs[0], body.inputs[1])
    dense = tree.nodes.new("ShaderNodeMath")
    dense.operation, dense.use_clamp = "MULTIPLY", False
    dense.inputs[1].default_value = math.exp(r.uniform(2.0, 4.5)) / size
    tree.links.new(body.outputs[0], dense.inputs[0])
    above = tree.nodes.new("ShaderNodeMath")
    above.operation = "MAXIMUM"
    tree.links.new(dense.outputs[0], above.inputs[0])
    tree.links.new(above.outputs[0], shader.inputs["Density"])
    if r.random() < 0.25:
        shader.inputs["Emission Color"].default_value = (1.0, r.uniform(0.2, 0.6), r.uniform(0.02, 0.3), 1)
        tree.links.new(above.outputs[0], shader.inputs["Emission Strength"])
    cloud.data.materials.append(material)


def tinted(r: random.Random, bodies: list[bpy.types.Object]) -> None:
    """Some bodies become clear bodies that take colour with thickness: jelly, coloured glass, resin."""
    for body in r.sample(bodies, min(len(bodies), r.randint(1, 4))):
        material = bpy.data.materials.new("tinted")
        material.use_nodes = True
        tree = material.node_tree
        shader = tree.nodes["Principled BSDF"]
        shader.inputs["Transmission Weight"].default_value = 1.0
        shader.inputs["Roughness"].default_value = r.choice([0, 0.02, 0.1, 0.3])
        shader.inputs["IOR"].default_value = r.uniform(1.05, 1.6)
        absorption = tree.nodes.new("ShaderNodeVolumeAbsorption")
        absorption.inputs["Color"].default_value = colour(r, 0.5, 1.0, r.uniform(0.3, 0.95))
        absorption.inputs["Density"].default_value = math.exp(r.uniform(-0.5, 2.0)) / max(0.1, max(body.dimensions))
        tree.links.new(absorption.outputs[0], tree.nodes["Material Output"].inputs["Volume"])
        body.data.materials.clear()
        body.data.materials.append(material)


def add(r: random.Random, bodies: list[bpy.types.Object], size: float, place: Callable[[float, float], Vector]) -> None:
    """Fog, smoke or tinted bodies; `place` gives a point in the picture between two distances."""
    which = r.choice(["fog", "smoke", "smoke", "tinted"])
    if which == "fog":
        filled(size, math.exp(r.uniform(-3.2, -1.2)) / size, r.uniform(0.0, 0.7), colour(r, 0.7, 1.0, r.random() * 0.25))
    elif which == "smoke":
        for _ in range(r.randint(1, 2)):
            smoke(r, size, place(0.7, 1.2))
    else:
        tinted(r, bodies)

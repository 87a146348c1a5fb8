"""Random light for the training shots: the world, lamps, haze."""

from __future__ import annotations

import math
import random

import bpy
from mathutils import Vector

from training.shots.cycles.assets import Assets
from training.shots.cycles.materials import colour

PART = "part"  # the light group


def environment(r: random.Random, scene: bpy.types.Scene, kind: str, assets: Assets) -> tuple[float, float]:
    """The world: dark, plain or an HDRI. Returns the scene's size in units and the strength of its background."""
    world = bpy.data.worlds.new("w")
    scene.world = world
    world.use_nodes = True
    tree = world.node_tree
    background = tree.nodes["Background"]
    strength = background.inputs["Strength"]
    size = r.uniform(2.2, 4.5)
    choice = r.random()
    if kind == "room" and r.random() < 0.75:
        strength.default_value = 0 if r.random() < 0.5 else r.uniform(0.3, 3)
    elif choice < 0.6 and assets.hdris:
        texture = tree.nodes.new("ShaderNodeTexEnvironment")
        texture.image = bpy.data.images.load(r.choice(assets.hdris))
        tree.links.new(texture.outputs[0], background.inputs[0])
        source = tree.nodes.new("ShaderNodeTexCoord")
        mapping = tree.nodes.new("ShaderNodeMapping")
        mapping.inputs["Rotation"].default_value[2] = r.uniform(0, 6.28)
        tree.links.new(source.outputs["Generated"], mapping.inputs[0])
        tree.links.new(mapping.outputs[0], texture.inputs[0])
        strength.default_value = math.exp(r.uniform(-1.2, 0.7))
    else:
        background.inputs["Color"].default_value = colour(r, 0.05, 1, r.random() * 0.5)
        strength.default_value = r.choice([0, 0.1, 0.4, 1])
    return size, strength.default_value


def area_lamp(scene: bpy.types.Scene, energy: float, size: float, place: Vector, aim: Vector) -> None:
    """A square lamp that looks at a point."""
    light = bpy.data.lights.new("area", "AREA")
    light.energy, light.size = energy, size
    thing = bpy.data.objects.new("area", light)
    thing.location = place
    thing.rotation_euler = (aim - place).to_track_quat("-Z", "Y").to_euler()
    scene.collection.objects.link(thing)


def lamp(r: random.Random, scene: bpy.types.Scene, kind: str, size: float) -> bpy.types.Object:
    """One lamp that looks roughly at the middle of the scene."""
    sort = r.choice(["AREA", "AREA", "POINT", "SPOT", "SUN"])  # in a room the sun needs an opening, and three of five have one
    light = bpy.data.lights.new("l", sort)
    light.color = colour(r, 0.6, 1, r.random() * 0.6)[:3]
    thing = bpy.data.objects.new("l", light)
    scene.collection.objects.link(thing)
    angle = r.uniform(0, 6.28)
    height = size * (r.uniform(0.5, 1.05) if kind == "room" else r.uniform(0.6, 2))
    radius = size * r.uniform(0.2, 1.1)
    thing.location = (math.cos(angle) * radius, math.sin(angle) * radius, height)
    thing.rotation_mode = "XYZ"
    aim = Vector((r.gauss(0, 0.4), r.gauss(0, 0.4), 0.3)) * size
    thing.rotation_euler = (aim - thing.location).to_track_quat("-Z", "Y").to_euler()
    energy = size * size * math.exp(r.uniform(-0.5, 1.2))
    if sort == "SUN":
        light.energy = r.uniform(0.5, 4)
        light.angle = math.exp(r.uniform(-5, -1.5))
    elif sort == "AREA":
        light.energy = energy * 9
        light.size = size * math.exp(r.uniform(-3, -0.3))
    elif sort == "POINT":
        light.energy = energy * 9
        light.shadow_soft_size = size * math.exp(r.uniform(-5, -1.5))
    else:
        light.energy = energy * 25
        light.spot_size = r.uniform(0.4, 1.5)
        light.spot_blend = r.random()
        light.shadow_soft_size = size * math.exp(r.uniform(-5, -2))
    return thing


def split(r: random.Random, scene: bpy.types.Scene) -> None:
    """Puts some of the lamps and the world, where there are two of them at least, into a light group, that gets a pass of its own.

    What emits light and is no lamp belongs to the other part.
    """
    sources: list[bpy.types.Object | bpy.types.World] = [thing for thing in scene.objects if thing.type == "LIGHT"]
    if scene.world.node_tree.nodes["Background"].inputs["Strength"].default_value > 0:
        sources.append(scene.world)
    if len(sources) < 2:
        return
    scene.view_layers[0].lightgroups.add(name=PART)
    for source in r.sample(sources, r.randint(1, len(sources) - 1)):
        source.lightgroup = PART


def lamps(r: random.Random, scene: bpy.types.Scene, kind: str, size: float, background: float) -> list[bpy.types.Object]:
    """More of them where the world is dark."""
    count = r.choice([0, 1, 1, 2, 3]) if background > 0.3 else r.choice([1, 1, 2, 3, 4])
    return [lamp(r, scene, kind, size) for _ in range(count)]

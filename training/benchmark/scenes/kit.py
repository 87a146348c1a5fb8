"""Helpers of the benchmark shots: keyframes, camera, lamps, flat meshes; shaders and bodies come from the sample shot's modules."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import bpy
from mathutils import Vector

from samples import shading, shapes

FIRST, LAST = 1, 8
# Beyond both ends too: the motion vectors of the first and the last frame look there.
KEYED = range(FIRST - 2, LAST + 3)
Point = Sequence[float]
Colour = tuple[float, float, float]


def progress(frame: int) -> float:
    """0 at the first frame, 1 at the last, straight on beyond."""
    return (frame - FIRST) / (LAST - FIRST)


def between(a: Point, b: Point, t: float) -> tuple[float, ...]:
    return tuple(x + (y - x) * t for x, y in zip(a, b, strict=True))


def animate(thing: bpy.types.Object, path: str, value: Callable[[int], Point]) -> None:
    """A key on every frame, so that no interpolation setting matters."""
    for frame in KEYED:
        setattr(thing, path, value(frame))
        thing.keyframe_insert(path, frame=frame)


def camera(position: Callable[[float], Point], target: Callable[[float], Point], lens: float) -> bpy.types.Camera:
    """The scene's camera; position and target by progress through the shot."""
    made = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    scene = bpy.context.scene
    scene.collection.objects.link(made)
    scene.camera = made
    made.data.lens = lens
    made.data.clip_start = 0.02

    def turned(frame: int) -> Point:
        here, there = Vector(position(progress(frame))), Vector(target(progress(frame)))
        return (there - here).to_track_quat("-Z", "Y").to_euler()

    animate(made, "location", lambda frame: position(progress(frame)))
    animate(made, "rotation_euler", turned)
    return made.data


def lamp(kind: str, position: Point, target: Point, energy: float, colour: Colour = (1, 1, 1), **settings: Any) -> bpy.types.Object:  # noqa: ANN401
    """A lamp that only its light shows."""
    data = bpy.data.lights.new("lamp", kind)
    data.energy, data.color = energy, colour
    for name, value in settings.items():
        setattr(data, name, value)
    made = bpy.data.objects.new("lamp", data)
    made.location = position
    made.rotation_euler = (Vector(target) - Vector(position)).to_track_quat("-Z", "Y").to_euler()
    made.visible_camera = False
    bpy.context.scene.collection.objects.link(made)
    return made


def sky(low: Colour, high: Colour, strength: float, lights: bool = True) -> None:
    """A world that goes from one colour at the horizon to another overhead; without `lights` it is only to be seen."""
    world = bpy.data.worlds.new("sky")
    bpy.context.scene.world = world
    world.use_nodes = True
    tree = world.node_tree
    up = shading.place(tree, "SeparateXYZ", {0: shading.place(tree, "TexCoord").outputs["Generated"]}).outputs["Z"]
    colour = shading.ramp(tree, up, [(0.0, low), (0.6, high)])
    tree.links.new(colour, tree.nodes["Background"].inputs["Color"])
    tree.nodes["Background"].inputs["Strength"].default_value = strength
    if not lights:
        world.cycles.sampling_method = "NONE"
        world.cycles_visibility.diffuse = False


def mesh(name: str, points: Sequence[Point], faces: Sequence[Sequence[int]], material: bpy.types.Material, at: Point = (0, 0, 0)) -> Any:  # noqa: ANN401
    data = bpy.data.meshes.new(name)
    data.from_pydata([tuple(p) for p in points], [], [tuple(f) for f in faces])
    data.materials.append(material)
    return shapes.added(name, data, at)


def grid(name: str, width: float, depth: float, material: bpy.types.Material, at: Point = (0, 0, 0), turn: Point = (0, 0, 0)) -> Any:  # noqa: ANN401
    """A flat rectangle in x and y, with object coordinates in metres."""
    x, y = width / 2, depth / 2
    made = mesh(name, [(-x, -y, 0), (x, -y, 0), (x, y, 0), (-x, y, 0)], [(0, 1, 2, 3)], material, at)
    made.rotation_euler = turn
    return made


def block(name: str, size: Point, at: Point, material: bpy.types.Material, bevel: float = 0.02, turn: float = 0.0) -> bpy.types.Object:
    """A box with rounded edges; `at` is its middle."""
    made = shapes.finished(shapes.box(name, size, at, bevel), material, smooth=False)
    made.rotation_euler.z = turn
    return made


def lathe(name: str, profile: Sequence[tuple[float, float]], at: Point, material: bpy.types.Material, steps: int = 5) -> bpy.types.Object:
    """A turned body of a smooth profile (radius, height)."""
    return shapes.finished(shapes.turned(name, shapes.rounded(profile, steps), at, 64), material)


def speckled(name: str, dark: Colour, light: Colour, scale: float, roughness: float = 0.8, bump: float = 0.2) -> bpy.types.Material:
    """Two colours mixed by noise, with the noise as relief: plaster, cloth, earth, bark."""
    material, tree, shader = shading.principled(name, Roughness=roughness)
    at = shading.coordinates(tree, (1, 1, 1))
    noise = shading.place(tree, "TexNoise", {"Vector": at, "Scale": scale, "Detail": 3.0, "Roughness": 0.65})
    tree.links.new(shading.ramp(tree, noise.outputs["Fac"], [(0.32, dark), (0.68, light)]), shader.inputs["Base Color"])
    if bump:
        shading.bump(tree, shader, noise.outputs["Fac"], bump, 0.02)
    return material


def plain(name: str, colour: Colour, **inputs: Any) -> bpy.types.Material:  # noqa: ANN401
    return shading.principled(name, Base_Color=(*colour, 1.0), **inputs)[0]


def turn_about(angle: float, radius: float, height: float) -> tuple[float, float, float]:
    return (radius * math.cos(angle), radius * math.sin(angle), height)

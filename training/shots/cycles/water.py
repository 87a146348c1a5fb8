"""Water and thick glass for the training shots."""

from __future__ import annotations

import math
import random
from collections.abc import Callable

import bpy
from mathutils import Vector

from training.shots.cycles.materials import colour
from training.shots.cycles.motion import keyed


def clear(r: random.Random, ior: float, roughness: float, tint: tuple[float, ...]) -> bpy.types.Material:
    """A transmitting material, half of the time with colour that grows with thickness."""
    material = bpy.data.materials.new("clear")
    material.use_nodes = True
    tree = material.node_tree
    inputs = tree.nodes["Principled BSDF"].inputs
    inputs["Transmission Weight"].default_value = 1.0
    inputs["IOR"].default_value, inputs["Roughness"].default_value = ior, roughness
    inputs["Base Color"].default_value = tint
    if r.random() < 0.5:
        absorption = tree.nodes.new("ShaderNodeVolumeAbsorption")
        absorption.inputs["Color"].default_value = colour(r, 0.6, 1.0, r.uniform(0.2, 0.8))
        absorption.inputs["Density"].default_value = math.exp(r.uniform(-2, 0.7))
        tree.links.new(absorption.outputs[0], tree.nodes["Material Output"].inputs["Volume"])
    return material


def waves(r: random.Random, size: float) -> None:
    """A moving surface over the ground, the sea's or ripples on a pond; clear, or opaque and glossy."""
    height = size * r.uniform(0.06, 0.25)
    if r.random() < 0.5:
        bpy.ops.mesh.primitive_plane_add(size=1, location=(0, 0, height))
        surface = bpy.context.object
        sea = surface.modifiers.new("sea", "OCEAN")
        sea.geometry_mode, sea.resolution, sea.viewport_resolution = "GENERATE", 11, 11
        sea.spatial_size, sea.random_seed = 30, r.randrange(1000)
        sea.wave_scale, sea.choppiness, sea.wind_velocity = r.uniform(0.4, 1.5), r.uniform(0.3, 1.3), r.uniform(4, 14)
        surface.scale = [size * 4 / 30] * 3
        speed = r.uniform(0.02, 0.12)
        keyed(sea, "time", lambda frame: 3 + speed * frame)
    else:
        bpy.ops.mesh.primitive_grid_add(x_subdivisions=160, y_subdivisions=160, size=size * 4, location=(0, 0, height))
        surface = bpy.context.object
        for _ in range(r.randint(2, 4)):
            ripple = surface.modifiers.new("ripple", "WAVE")
            ripple.start_position_x, ripple.start_position_y = (r.uniform(-1, 1) * size for _ in range(2))
            ripple.time_offset, ripple.lifetime = -200, 0
            ripple.height, ripple.width = size * r.uniform(0.01, 0.04), size * r.uniform(0.15, 0.5)
            ripple.narrowness, ripple.speed = 1.5 / ripple.width, size * r.uniform(0.01, 0.05)
    surface.data.polygons.foreach_set("use_smooth", [True] * len(surface.data.polygons))
    if r.random() < 0.7:
        surface.data.materials.append(clear(r, 1.33, r.choice([0, 0, 0.02, 0.08]), colour(r, 0.7, 1.0, r.random() * 0.5)))
        return
    deep = bpy.data.materials.new("deep water")
    deep.use_nodes = True
    inputs = deep.node_tree.nodes["Principled BSDF"].inputs
    inputs["Base Color"].default_value = colour(r, 0.01, 0.2, r.uniform(0.4, 0.9))
    inputs["Roughness"].default_value, inputs["IOR"].default_value = r.choice([0.0, 0.05, 0.15]), 1.33
    surface.data.materials.append(deep)


def thick_glass(
    r: random.Random, bodies: list[bpy.types.Object], distance: float, place: Callable[[float, float], Vector]
) -> list[bpy.types.Object]:
    """Slabs, balls and hollow things of glass before and among the others, which are seen through them; `place` gives a point in the
    picture between two shares of the target's distance."""
    new = []
    for _ in range(r.randint(3, 6)):
        sort = r.choice(["slab", "ball", "bottle", "thing"])
        scale = distance * r.uniform(0.05, 0.14)
        where = place(0.6, 1.1)
        if sort == "slab":
            bpy.ops.mesh.primitive_cube_add(size=1.6, location=where)
            bpy.context.object.scale = (scale, scale * r.uniform(0.1, 0.5), scale * 1.4)
            bevel = bpy.context.object.modifiers.new("b", "BEVEL")
            bevel.width, bevel.segments = 0.08, 3
        elif sort == "ball":
            bpy.ops.mesh.primitive_uv_sphere_add(segments=64, ring_count=32, radius=scale, location=where)
            bpy.ops.object.shade_smooth()
        elif sort == "bottle":
            bpy.ops.mesh.primitive_cylinder_add(vertices=64, radius=scale * 0.5, depth=scale * 2, location=where)
            bpy.ops.object.shade_smooth()
            bpy.context.object.modifiers.new("s", "SOLIDIFY").thickness = scale * r.uniform(0.05, 0.2)
        else:
            if not bodies:
                continue
            body = r.choice(bodies)
            body.data.materials.clear()
            body.data.materials.append(clear(r, r.uniform(1.3, 1.7), 0.0, colour(r, 0.8, 1.0, r.random() * 0.3)))
            continue
        thing = bpy.context.object
        thing.rotation_euler = (r.gauss(0, 0.15), r.gauss(0, 0.15), r.uniform(0, 6.28))
        thing.data.materials.append(clear(r, r.uniform(1.3, 1.7), r.choice([0, 0, 0, 0.05, 0.2]), colour(r, 0.8, 1.0, r.random() * 0.3)))
        new.append(thing)
    return new

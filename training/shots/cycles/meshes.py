"""Random things to put into a training shot: solids, Suzanne, lettering, strands, foliage, cloth, grids, models."""

from __future__ import annotations

import math
import random
from collections.abc import Iterable
from functools import cache
from pathlib import Path

import bpy
from mathutils import Euler, Matrix, Quaternion, Vector

from training.shots.cycles.assets import Assets

KINDS = ["cube", "sphere", "ico", "cyl", "cone", "torus", "monkey", "text", "glb", "strands", "cube", "sphere", "cloth", "array"]
KINDS += ["foliage", "foliage", "strands"]


def solid(r: random.Random, kind: str) -> None:
    """One of Blender's primitives; it becomes the active object."""
    add = bpy.ops.mesh
    if kind == "sphere":
        add.primitive_uv_sphere_add(segments=48, ring_count=24, radius=0.9)
        bpy.ops.object.shade_smooth()
    elif kind == "ico":
        add.primitive_ico_sphere_add(subdivisions=r.choice([1, 2, 5]), radius=0.9)
    elif kind == "cyl":
        add.primitive_cylinder_add(vertices=r.choice([6, 48]), radius=0.7, depth=r.uniform(0.4, 2))
    elif kind == "cone":
        add.primitive_cone_add(vertices=r.choice([4, 48]), radius1=0.9, depth=1.7)
    elif kind == "torus":
        add.primitive_torus_add(major_segments=64, minor_segments=24, major_radius=0.8, minor_radius=r.uniform(0.05, 0.35))
        bpy.ops.object.shade_smooth()
    elif kind == "monkey":
        add.primitive_monkey_add(size=1.7)
    else:
        add.primitive_cube_add(size=1.5)


def lettering(r: random.Random) -> None:
    bpy.ops.object.text_add()
    text = bpy.context.object.data
    text.body = "".join(r.choice("ABCDEFGRSXZ&%#@8369") for _ in range(r.randint(1, 4)))
    text.extrude = r.uniform(0.05, 0.3)
    text.align_x = text.align_y = "CENTER"
    text.size = 1.6


@cache
def draco() -> bool:
    """Whether this Blender can decode Draco's meshes, as the models are: the 5.2.3 package lacks the library."""
    local = Path(bpy.utils.resource_path("LOCAL"))
    places = [*local.glob("scripts/addons_core/io_scene_gltf2/*draco*"), *local.glob("../lib/*draco_bridge*")]
    return bool(bpy.app.binary_path) or any(place.suffix in (".so", ".dll", ".dylib") for place in places)


def model(r: random.Random, assets: Assets) -> bpy.types.Object:
    """The first mesh of a glTF file, scaled to 1.8 units, without its materials; Suzanne where Blender cannot decode the file."""
    before = set(bpy.data.objects)
    path = r.choice(assets.models)
    if not draco():
        solid(r, "monkey")
        return bpy.context.object
    bpy.ops.import_scene.gltf(filepath=path)
    new = [thing for thing in bpy.data.objects if thing not in before]
    meshes = [thing for thing in new if thing.type == "MESH"]
    for thing in new:
        if thing.type != "MESH":
            bpy.data.objects.remove(thing)
    first = meshes[0]
    first.parent = None
    bpy.context.view_layer.objects.active = first
    size = max(first.dimensions) or 1
    first.scale = [s * 1.8 / size for s in first.scale]
    for thing in meshes[1:]:
        bpy.data.objects.remove(thing)
    first.data.materials.clear()
    return first


def strands(r: random.Random) -> bpy.types.Object:
    """Thin bent rods: hair, grass, wire."""
    curve = bpy.data.curves.new("c", "CURVE")
    curve.dimensions = "3D"
    curve.bevel_depth = r.uniform(0.005, 0.03)
    for _ in range(r.randint(20, 160)):
        spline = curve.splines.new("POLY")
        spline.points.add(5)
        x, y = r.gauss(0, 0.5), r.gauss(0, 0.5)
        dx, dy = r.gauss(0, 0.12), r.gauss(0, 0.12)
        for i, point in enumerate(spline.points):
            point.co = (x + dx * i * i * 0.2, y + dy * i * i * 0.2, i * 0.3 - 0.8, 1)
    thing = bpy.data.objects.new("strands", curve)
    bpy.context.collection.objects.link(thing)
    return thing


def creased_leaves(name: str, size: tuple[float, float, float], places: Iterable[tuple[Vector, Matrix | Quaternion]]) -> bpy.types.Object:
    """Leaves of half a width, a length and a crease, each two triangles, from its stem on, turned; not in a scene yet."""
    width, length, crease = size
    outline = [Vector(p) for p in ((0, 0, 0), (-width, length / 2, crease), (0, length, 0), (width, length / 2, crease))]
    vertices: list[Vector] = []
    faces: list[tuple[int, ...]] = []
    for stem, turn in places:
        first = len(vertices)
        vertices += [stem + turn @ corner for corner in outline]
        faces += [(first, first + 1, first + 2), (first, first + 2, first + 3)]
    leaves = bpy.data.meshes.new(name)
    leaves.from_pydata(vertices, [], faces)
    return bpy.data.objects.new(name, leaves)


def foliage(r: random.Random) -> bpy.types.Object:
    """Leaves, each two triangles with a crease, turned at random in a round or flat crown."""
    count, length, flat = r.randint(150, 900), math.exp(r.uniform(-3.2, -1.2)), r.uniform(0.2, 1.0)
    width, crease = length * r.uniform(0.1, 0.5), length * r.uniform(0.0, 0.2)
    stem = lambda: Vector((r.gauss(0, 0.4), r.gauss(0, 0.4), r.gauss(0, 0.4) * flat))
    turn = lambda: Euler((r.gauss(0, 0.7), r.gauss(0, 0.7), r.uniform(0, 6.28))).to_matrix()
    thing = creased_leaves("leaves", (width, length, crease), ((stem(), turn()) for _ in range(count)))
    bpy.context.collection.objects.link(thing)
    return thing


def cloth(r: random.Random) -> None:
    bpy.ops.mesh.primitive_grid_add(x_subdivisions=60, y_subdivisions=60, size=2)
    bpy.ops.object.shade_smooth()
    folds = bpy.data.textures.new("t", "CLOUDS")
    folds.noise_scale = r.uniform(0.2, 0.8)
    displace = bpy.context.object.modifiers.new("d", "DISPLACE")
    displace.texture = folds
    displace.strength = r.uniform(0.2, 1)


def lattice(r: random.Random) -> None:
    """A sheet of small cubes with gaps."""
    bpy.ops.mesh.primitive_cube_add(size=0.18)
    for axis in range(2):
        array = bpy.context.object.modifiers.new("a", "ARRAY")
        array.count = r.randint(4, 9)
        array.relative_offset_displace = [1.5 if i == axis else 0 for i in range(3)]


def mesh(r: random.Random, assets: Assets) -> bpy.types.Object:
    """A random thing about two units across, without a material."""
    kind = r.choice(KINDS)
    if kind == "glb" and assets.models:
        return model(r, assets)
    if kind == "strands":
        return strands(r)
    if kind == "foliage":
        return foliage(r)
    if kind == "text":
        lettering(r)
    elif kind == "cloth":
        cloth(r)
    elif kind == "array":
        lattice(r)
    else:
        solid(r, kind)
    thing = bpy.context.object
    if kind in ("cube", "cyl", "monkey", "ico") and r.random() < 0.3:
        smooth = thing.modifiers.new("s", "SUBSURF")
        smooth.levels = smooth.render_levels = 2
    if kind in ("ico", "torus", "sphere", "cube") and r.random() < 0.12:
        thing.modifiers.new("w", "WIREFRAME").thickness = r.uniform(0.02, 0.08)
    if kind == "cube" and r.random() < 0.4:
        bevel = thing.modifiers.new("b", "BEVEL")
        bevel.width = 0.06
        bevel.segments = 2
    return thing

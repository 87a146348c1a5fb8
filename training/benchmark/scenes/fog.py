"""Benchmark shot `fog`: an arcade at night in thin fog; a lantern goes by behind the columns, a brazier smokes, the moon throws beams."""

from __future__ import annotations

import math
import random

import bpy

from samples import shading, shapes
from training.benchmark.scenes.kit import animate, between, block, camera, grid, lamp, lathe, plain, progress, sky, speckled

COLUMNS = tuple((x, y) for y in (0.0, 2.6) for x in (-3.3, -1.1, 1.1, 3.3))


def flagstones() -> bpy.types.Material:
    """Wet slabs: each of its own tone, some smoother than others."""
    material, tree, shader = shading.principled("flagstones")
    at = shading.coordinates(tree, (1, 1, 1), 0.12)
    slabs = shading.place(
        tree,
        "TexBrick",
        {"Vector": at, "Color1": (0.13, 0.12, 0.115, 1), "Color2": (0.30, 0.28, 0.25, 1), "Mortar": (0.03, 0.03, 0.03, 1)}
        | {"Scale": 1.0, "Mortar Size": 0.02, "Brick Width": 0.95, "Row Height": 0.6},
        offset=0.4,
    )
    damp = shading.place(tree, "TexNoise", {"Vector": at, "Scale": 1.1, "Detail": 4.0})
    tree.links.new(slabs.outputs["Color"], shader.inputs["Base Color"])
    tree.links.new(
        shading.ramp(tree, damp.outputs["Fac"], [(0.42, shading.grey(0.14)), (0.58, shading.grey(0.7))]), shader.inputs["Roughness"]
    )
    shading.bump(tree, shader, slabs.outputs["Fac"], 0.4, 0.02)
    return material


def volume(name: str) -> tuple[bpy.types.Material, bpy.types.NodeTree, bpy.types.Node]:
    """A material with a scattering volume and no surface."""
    material = bpy.data.materials.new(name)
    material.use_nodes = True
    tree = material.node_tree
    tree.nodes.remove(tree.nodes["Principled BSDF"])
    scatter = shading.place(tree, "VolumeScatter", {"Anisotropy": 0.35})
    tree.links.new(scatter.outputs[0], tree.nodes["Material Output"].inputs["Volume"])
    return material, tree, scatter


def fog() -> None:
    """Even, all around the camera too."""
    material, _, scatter = volume("fog")
    scatter.inputs["Density"].default_value = 0.04
    block("fog", (16, 18, 6), (0, 0, 2.9), material, 0)


def smoke(at: tuple[float, float, float]) -> None:
    """A plume of noise that rises and swells, thinner with height."""
    material, tree, scatter = volume("smoke")
    scatter.inputs["Color"].default_value = (0.85, 0.83, 0.80, 1)
    source = shading.place(tree, "TexCoord").outputs["Object"]
    drift = shading.place(tree, "Mapping", {"Vector": source})
    animate(drift.inputs["Location"], "default_value", lambda frame: (0.02 * frame, 0.0, -0.055 * frame))
    curls = shading.place(tree, "TexNoise", {"Vector": drift.outputs[0], "Scale": 4.2, "Detail": 2.0})
    apart = shading.place(tree, "SeparateXYZ", {0: source})
    up = shading.place(tree, "MapRange", {0: apart.outputs["Z"], 1: -0.9, 2: 0.9, 3: 0.16, 4: 0.42}).outputs[0]
    flat = shading.place(tree, "VectorMath", {0: source, 1: (1.0, 1.0, 0.0)}, operation="MULTIPLY").outputs[0]
    across = shading.place(tree, "VectorMath", {0: flat}, operation="LENGTH").outputs["Value"]
    inside = shading.place(
        tree, "Math", {0: 1.0, 1: shading.place(tree, "Math", {0: across, 1: up}, operation="DIVIDE").outputs[0]}
    ).outputs[0]
    inside.node.operation = "SUBTRACT"
    body = shading.place(tree, "Math", {0: curls.outputs["Fac"], 1: inside}, operation="MULTIPLY_ADD")
    body.inputs[2].default_value = -0.12
    thinner = shading.place(tree, "MapRange", {0: apart.outputs["Z"], 1: -0.9, 2: 0.9, 3: 60.0, 4: 9.0}).outputs[0]
    dense = shading.place(tree, "Math", {0: body.outputs[0], 1: thinner}, operation="MULTIPLY")
    above = shading.place(tree, "Math", {0: dense.outputs[0], 1: 0.0}, operation="MAXIMUM")
    tree.links.new(above.outputs[0], scatter.inputs["Density"])
    block("smoke", (0.9, 0.9, 1.8), (at[0], at[1], at[2] + 0.9), material, 0)


def column(at: tuple[float, float], stone: bpy.types.Material) -> None:
    base = [(0.0, 0.0), (0.36, 0.0), (0.36, 0.12), (0.30, 0.16), (0.31, 0.24), (0.25, 0.3)]
    shaft = [(0.245, 1.2), (0.215, 2.5), (0.25, 2.56), (0.34, 2.8), (0.0, 2.8)]
    lathe("column", [*base, *shaft], (*at, 0.0), stone)
    block("abacus", (0.8, 0.8, 0.16), (*at, 2.86), stone, 0.02)


def only_seen(thing: bpy.types.Object) -> None:
    """Its glow lights nothing: the lamp beside it does, and far less noisily."""
    thing.active_material.cycles.emission_sampling = "NONE"
    thing.visible_diffuse = thing.visible_volume_scatter = False


def lantern(glow: bpy.types.Material, iron: bpy.types.Material) -> None:
    """Carried by nobody: a glass cage with a flame, and the lamp that it is."""
    where = lambda frame: (-1.9 + 2.6 * progress(frame), 1.35, 1.15 + 0.05 * math.sin(1.3 * frame))
    cage = bpy.data.objects.new("lantern", None)
    bpy.context.scene.collection.objects.link(cage)
    animate(cage, "location", where)
    parts = [lathe("flame", [(0.0, -0.06), (0.03, -0.03), (0.024, 0.03), (0.0, 0.09)], (0, 0, 0), glow)]
    only_seen(parts[0])
    parts += [block("plate", (0.2, 0.2, 0.02), (0, 0, z), iron, 0.004) for z in (-0.14, 0.16)]
    parts += [block("bar", (0.014, 0.014, 0.3), (x, y, 0.01), iron, 0) for x in (-0.085, 0.085) for y in (-0.085, 0.085)]
    parts.append(shapes.finished(shapes.ring("ring", 0.05, 0.008, (0, 0, 0.22), (math.pi / 2, 0, 0)), iron))
    light = lamp("POINT", (0, 0, 0.01), (0, 0, -1), 260, (1.0, 0.62, 0.28), shadow_soft_size=0.04)
    for part in (*parts, light):
        part.parent = cage


def build() -> None:
    r = random.Random("fog")
    stone = speckled("stone", (0.24, 0.21, 0.17), (0.44, 0.40, 0.34), 7.0, 0.85, 0.35)
    grid("floor", 18, 20, flagstones())
    for at in COLUMNS:
        column(at, stone)
    for y in (0.0, 2.6):
        block("beam", (10, 0.62, 0.5), (0, y, 3.19), stone, 0.02)
    block("wall", (14, 0.4, 4.2), (0, 5.4, 2.1), speckled("plaster", (0.20, 0.17, 0.14), (0.36, 0.32, 0.27), 3.0, 0.9, 0.3), 0)
    block("door", (1.3, 0.1, 2.3), (-0.55, 5.18, 1.15), speckled("door", (0.05, 0.025, 0.012), (0.13, 0.07, 0.03), 12.0, 0.6), 0.02)
    wood = speckled("crate", (0.16, 0.09, 0.04), (0.32, 0.20, 0.10), 10.0, 0.8)
    for x, y, z, size in ((-2.2, -0.9, 0.3, 0.6), (-2.75, -0.55, 0.25, 0.5), (-2.35, -0.8, 0.8, 0.4)):
        block("crate", (size, size, size), (x, y, z), wood, 0.015, r.uniform(-0.5, 0.5))
    clay = speckled("clay", (0.40, 0.16, 0.07), (0.55, 0.26, 0.13), 12.0, 0.6)
    jar = [(0.0, 0.0), (0.14, 0.0), (0.24, 0.22), (0.22, 0.42), (0.10, 0.55), (0.13, 0.62), (0.10, 0.6), (0.0, 0.5)]
    for x, y, size in ((2.0, -0.95, 1.0), (2.45, -0.6, 0.75)):
        lathe("jar", jar, (x, y, 0), clay).scale = (size,) * 3
    iron = plain("iron", (0.03, 0.03, 0.033), Metallic=1.0, Roughness=0.5)
    glow = plain("flame", (0, 0, 0), Emission_Color=(1.0, 0.55, 0.16, 1.0), Emission_Strength=60.0)
    coals = plain("coals", (0.02, 0.01, 0.01), Emission_Color=(1.0, 0.16, 0.02, 1.0), Emission_Strength=14.0)
    bowl = [(0.0, 0.42), (0.2, 0.48), (0.3, 0.66), (0.28, 0.66), (0.18, 0.52), (0.0, 0.5)]
    lathe("brazier", bowl, (0.25, -0.55, 0), iron)
    for angle in (0.4, 2.5, 4.6):
        leg = block("leg", (0.03, 0.03, 0.52), (0.25 + 0.2 * math.cos(angle), -0.55 + 0.2 * math.sin(angle), 0.25), iron, 0)
        leg.rotation_euler = (0.2 * math.sin(angle), -0.2 * math.cos(angle), 0)
    for _ in range(16):
        where = (0.25 + r.uniform(-0.17, 0.17), -0.55 + r.uniform(-0.17, 0.17), 0.58 + r.uniform(-0.02, 0.03))
        only_seen(shapes.finished(shapes.sphere("coal", r.uniform(0.035, 0.055), where), coals))
    smoke((0.25, -0.55, 0.62))
    fog()
    lantern(glow, iron)
    lamp("SPOT", (7.0, 6.2, 8.0), (-0.8, 0.4, 0.4), 22000, (0.55, 0.70, 1.0), spot_size=0.55, spot_blend=0.4, shadow_soft_size=0.15)
    lamp("POINT", (0.25, -0.55, 0.72), (0, 0, 0), 14, (1.0, 0.25, 0.05), shadow_soft_size=0.12)
    lamp("AREA", (-3.5, -5.0, 4.0), (0, 1, 1), 150, (0.5, 0.62, 0.9), shape="RECTANGLE", size=3.0, size_y=3.0)
    sky((0.02, 0.03, 0.06), (0.004, 0.008, 0.02), 1.0)
    camera(lambda t: between((0.75, -5.6, 1.5), (0.35, -5.5, 1.46), t), lambda t: between((-0.1, 1.0, 1.25), (-0.2, 1.0, 1.25), t), 33)

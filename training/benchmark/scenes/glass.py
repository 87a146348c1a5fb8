"""Benchmark shot `glass`: a close-up of glass, brushed metal and plastic on a dark stone top, out of focus behind."""

from __future__ import annotations

import math

import bpy

from samples import shading, shapes
from training.benchmark.scenes.kit import between, block, camera, grid, lamp, lathe, plain, sky, speckled, turn_about


def brushed(name: str, colour: tuple[float, float, float], rough: float) -> bpy.types.Material:
    """Metal with fine rings, as from a lathe."""
    material, tree, shader = shading.principled(name, Metallic=1.0, Base_Color=(*colour, 1.0))
    rings = shading.place(tree, "TexNoise", {"Vector": shading.coordinates(tree, (0.6, 0.6, 90)), "Scale": 3.0, "Detail": 2.0})
    tree.links.new(
        shading.ramp(tree, rings.outputs["Fac"], [(0.3, shading.grey(rough)), (0.7, shading.grey(2 * rough))]), shader.inputs["Roughness"]
    )
    shading.bump(tree, shader, rings.outputs["Fac"], 0.08, 0.002)
    return material


def stone() -> bpy.types.Material:
    material, tree, shader = shading.principled("stone", Roughness=0.28)
    at = shading.coordinates(tree, (1, 1, 1))
    grains = shading.place(tree, "TexVoronoi", {"Vector": at, "Scale": 26.0})
    value = shading.place(tree, "SeparateXYZ", {0: grains.outputs["Color"]}).outputs[0]
    stops = [(0.0, (0.035, 0.04, 0.045)), (0.5, (0.09, 0.095, 0.10)), (0.75, (0.16, 0.13, 0.11)), (0.92, (0.32, 0.30, 0.28))]
    tree.links.new(shading.ramp(tree, value, stops, "CONSTANT"), shader.inputs["Base Color"])
    return material


def backdrop() -> bpy.types.Material:
    """Hand-made wall tiles, each of its own tone."""
    material, tree, shader = shading.principled("wall tiles", Roughness=0.35)
    brick = shading.place(
        tree,
        "TexBrick",
        {"Vector": shading.coordinates(tree, (1, 1, 1)), "Color1": (0.08, 0.26, 0.27, 1), "Color2": (0.20, 0.45, 0.42, 1)}
        | {"Mortar": (0.55, 0.52, 0.47, 1), "Scale": 1.0, "Mortar Size": 0.012, "Brick Width": 0.5, "Row Height": 0.25},
    )
    tree.links.new(brick.outputs["Color"], shader.inputs["Base Color"])
    return material


def drinking_glass(at: tuple[float, float, float]) -> None:
    bowl = [
        (0.0, 0.0),
        (0.26, 0.0),
        (0.27, 0.015),
        (0.06, 0.04),
        (0.028, 0.1),
        (0.028, 0.38),
        (0.10, 0.46),
        (0.23, 0.62),
        (0.26, 0.82),
        (0.22, 1.02),
    ]
    inside = [(0.207, 1.02), (0.245, 0.82), (0.215, 0.63), (0.09, 0.49), (0.0, 0.47)]
    shapes.finished(
        shapes.turned("wine glass", [*shapes.rounded(bowl, 5), *shapes.rounded(inside, 5)], at, 96), shading.glass("clear", (1.0, 1.0, 1.0))
    )
    wine = [(0.0, 0.476), (0.085, 0.494), (0.208, 0.634), (0.228, 0.72), (0.0, 0.72)]
    red = shading.glass("wine", (0.55, 0.03, 0.05))
    shapes.finished(shapes.turned("wine", wine, at, 96), red)


def bottle(at: tuple[float, float, float]) -> None:
    outside = [
        (0.0, 0.0),
        (0.24, 0.0),
        (0.26, 0.05),
        (0.26, 0.62),
        (0.20, 0.82),
        (0.085, 0.95),
        (0.08, 1.25),
        (0.10, 1.27),
        (0.10, 1.32),
        (0.07, 1.33),
    ]
    inside = [(0.06, 1.3), (0.06, 0.96), (0.17, 0.81), (0.23, 0.61), (0.23, 0.06), (0.0, 0.05)]
    shapes.finished(shapes.turned("bottle", [*outside, *inside], at, 96), shading.glass("green glass", (0.55, 0.85, 0.6)))
    label = lathe("label", [(0.2635, 0.16), (0.2635, 0.52)], at, speckled("label", (0.70, 0.60, 0.42), (0.82, 0.74, 0.58), 30.0, bump=0), 1)
    label.rotation_euler.z = 0.4
    lathe("band", [(0.2645, 0.40), (0.2645, 0.45)], at, plain("band", (0.45, 0.04, 0.03), Roughness=0.5), 1)


def build() -> None:
    grid("top", 9, 6, stone())
    grid("wall", 12, 5, backdrop(), (0, 2.3, 1.6), (math.pi / 2, 0, 0))
    drinking_glass((-0.12, -0.35, 0))
    bottle((-0.80, 0.45, 0))
    pot = [(0.0, 0.0), (0.30, 0.0), (0.34, 0.05), (0.36, 0.28), (0.30, 0.50), (0.19, 0.60), (0.20, 0.63), (0.0, 0.64)]
    lathe("pot", pot, (0.62, 0.12, 0), brushed("steel", (0.72, 0.72, 0.74), 0.14))
    lathe(
        "knob",
        [(0.0, 0.62), (0.03, 0.63), (0.035, 0.68), (0.07, 0.72), (0.05, 0.77), (0.0, 0.78)],
        (0.62, 0.12, 0),
        plain("bakelite", (0.02, 0.02, 0.02), Roughness=0.25),
    )
    handle = shapes.finished(
        shapes.ring("handle", 0.19, 0.028, (1.0, 0.12, 0.33), (math.pi / 2, 0, 0)), plain("bakelite", (0.02, 0.02, 0.02), Roughness=0.25)
    )
    handle.scale = (0.8, 1.0, 1.0)
    cup = [(0.0, 0.0), (0.13, 0.0), (0.16, 0.04), (0.19, 0.3), (0.20, 0.31), (0.185, 0.30), (0.15, 0.06), (0.0, 0.04)]
    lathe("cup", cup, (0.32, -0.72, 0), brushed("copper", (0.86, 0.45, 0.28), 0.2))
    block("salt", (0.2, 0.2, 0.34), (-0.62, -0.55, 0.17), plain("plastic", (0.75, 0.33, 0.03), Roughness=0.42), 0.04, 0.5)
    block("pepper", (0.2, 0.2, 0.30), (-0.86, -0.28, 0.15), plain("plastic", (0.10, 0.20, 0.50), Roughness=0.42), 0.04, 0.1)
    shapes.finished(shapes.sphere("marble", 0.09, (0.0, -0.95, 0.09)), shading.glass("marble", (0.5, 0.75, 1.0)))
    shapes.finished(shapes.sphere("marble", 0.07, (0.72, -0.72, 0.07)), shading.glass("marble", (1.0, 0.75, 0.35)))
    peel = speckled("lemon", (0.72, 0.50, 0.03), (0.82, 0.62, 0.06), 40.0, 0.4)
    lemon = shapes.finished(shapes.sphere("lemon", 0.13, (-0.36, -0.92, 0.125)), peel)
    lemon.scale = (1.25, 1.0, 0.96)
    lemon.rotation_euler.z = 0.6
    lamp("AREA", (-2.6, -1.4, 2.6), (0, 0, 0.4), 130, (1.0, 0.92, 0.82), shape="RECTANGLE", size=1.6, size_y=1.6)
    lamp("AREA", (2.6, -0.6, 1.9), (0, 0, 0.4), 60, (0.80, 0.90, 1.0), shape="RECTANGLE", size=0.8, size_y=2.0)
    lamp("AREA", (0, 1.2, 3.2), (0, 1.0, 0), 60, (1, 1, 1), shape="RECTANGLE", size=3.0, size_y=1.0)
    sky((0.5, 0.55, 0.6), (0.7, 0.75, 0.8), 0.25)
    lens = camera(lambda t: between(turn_about(-1.75, 3.3, 1.25), turn_about(-1.62, 3.3, 1.2), t), lambda t: (0.0, -0.1, 0.46), 50)
    lens.dof.use_dof, lens.dof.focus_distance, lens.dof.aperture_fstop = True, 3.0, 1.4

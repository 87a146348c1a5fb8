"""Benchmark shot `fur`: a plush bear turns and waves on a dressing table, before a mirror and small lamps that are out of focus."""

from __future__ import annotations

import math
import random
from typing import Any

import bpy
import numpy as np
from mathutils import Matrix

from samples import shading, shapes
from training.benchmark.scenes.kit import Colour, Point, animate, between, block, camera, grid, lamp, lathe, plain, progress, sky, speckled

JOINTS = 6  # points of a hair


def pelt(name: str, dark: Colour, light: Colour) -> bpy.types.Material:
    """Hair whose tone differs from one to the next, darker at its root."""
    material, tree, shader = shading.principled(name, Roughness=0.55, Sheen_Weight=0.3)
    info = shading.place(tree, "HairInfo").outputs
    tone = shading.ramp(tree, info["Random"], [(0.0, dark), (1.0, light)])
    root = shading.ramp(tree, info["Intercept"], [(0.0, shading.grey(0.45)), (0.7, shading.grey(1.0))])
    colour = shading.mixed(tree, 1.0, tone, root, "MULTIPLY")
    tree.links.new(colour, shader.inputs["Base Color"])
    through = shading.place(tree, "BsdfTranslucent", {"Color": colour})
    both = shading.place(tree, "MixShader", {0: 0.3, 1: shader.outputs[0], 2: through.outputs[0]})
    tree.links.new(both.outputs[0], tree.nodes["Material Output"].inputs["Surface"])
    return material


def hairs(r: np.random.Generator, radii: Point, count: int, length: float) -> tuple[np.ndarray, np.ndarray]:
    """Hairs on an ellipsoid, combed downwards: positions (count, JOINTS, 3) and radii (count, JOINTS)."""
    size = np.asarray(radii, float)
    way = r.normal(size=(count, 3))
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    outward = way / size
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    lean = 0.55 * np.array([0.0, 0.0, -1.0]) + 0.35 * r.normal(size=(count, 3))
    tall = length * r.uniform(0.65, 1.15, (count, 1, 1))
    t = np.linspace(0, 1, JOINTS)[None, :, None]
    points = (way * size)[:, None] + tall * (t * outward[:, None] + 0.6 * t**2 * lean[:, None])
    thick = 0.0016 * (1 - 0.75 * t[..., 0]) * r.uniform(0.7, 1.2, (count, 1))
    return points, thick


def area(radii: Point) -> float:
    """Of an ellipsoid, about."""
    a, b, c = (size**1.6 for size in radii)
    return 4 * math.pi * ((a * b + a * c + b * c) / 3) ** (1 / 1.6)


def furry(
    r: np.random.Generator, name: str, radii: Point, materials: tuple[bpy.types.Material, bpy.types.Material], length: float
) -> bpy.types.Object:
    """An ellipsoid of the first material with hair of the second, its child."""
    body = shapes.finished(shapes.sphere(name, 1.0, (0, 0, 0)), materials[0])
    body.data.transform(Matrix.Diagonal((*radii, 1.0)))
    points, thick = hairs(r, radii, round(area(radii) * 30000), length)
    data = bpy.data.hair_curves.new(name)
    data.add_curves([JOINTS] * len(points))
    data.attributes["position"].data.foreach_set("vector", points.astype(np.float32).ravel())
    data.attributes.new("radius", "FLOAT", "POINT").data.foreach_set("value", thick.astype(np.float32).ravel())
    data.materials.append(materials[1])
    shapes.added(name + " coat", data).parent = body
    return body


def joined(child: bpy.types.Object, parent: bpy.types.Object, at: Point) -> bpy.types.Object:
    child.parent = parent
    child.location = at
    return child


def bear(at: Point) -> None:
    r = np.random.default_rng(7)
    skin = plain("cloth", (0.16, 0.08, 0.035), Roughness=0.9)
    brown, cream = pelt("brown", (0.20, 0.085, 0.03), (0.46, 0.24, 0.10)), pelt("cream", (0.72, 0.58, 0.40), (0.93, 0.84, 0.68))
    black = plain("button", (0.008, 0.007, 0.007), Roughness=0.08)

    def part(
        name: str, radii: Point, parent: bpy.types.Object, where: Point, coat: bpy.types.Material = brown, length: float = 0.05
    ) -> Any:  # noqa: ANN401
        return joined(furry(r, name, radii, (skin, coat), length), parent, where)

    body = furry(r, "body", (0.20, 0.17, 0.23), (skin, brown), 0.06)
    animate(body, "rotation_euler", lambda f: (0.0, 0.05 * math.sin(0.9 * f), -0.5 + 0.55 * progress(f)))
    animate(body, "location", lambda f: (at[0] + 0.06 * progress(f), at[1], at[2] + 0.05 * abs(math.sin(0.42 * f))))
    part("belly", (0.13, 0.05, 0.15), body, (0, -0.135, -0.02), cream)
    head = part("head", (0.165, 0.15, 0.15), body, (0, -0.02, 0.33))
    animate(head, "rotation_euler", lambda f: (-0.05, 0.16 * math.sin(0.6 * f), 0.3 - 0.5 * progress(f)))
    part("snout", (0.075, 0.06, 0.055), head, (0, -0.135, -0.035), cream, 0.025)
    joined(shapes.finished(shapes.sphere("nose", 0.026, (0, 0, 0)), black), head, (0, -0.215, -0.005)).scale = (1.2, 0.8, 0.8)
    for side in (-1, 1):
        part("ear", (0.06, 0.03, 0.06), head, (side * 0.125, 0.01, 0.125), brown, 0.035)
        joined(shapes.finished(shapes.sphere("eye", 0.022, (0, 0, 0)), black), head, (side * 0.065, -0.158, 0.04))
        part("leg", (0.085, 0.13, 0.08), body, (side * 0.125, -0.14, -0.18))
        part("sole", (0.06, 0.03, 0.06), body, (side * 0.13, -0.25, -0.175), cream, 0.03)
        arm = part("arm", (0.065, 0.065, 0.14), body, (side * 0.215, -0.05, 0.08))
        wave = (lambda f: (0.0, 2.2 + 0.35 * math.sin(1.1 * f), 0.0)) if side > 0 else (lambda f: (0.3, 0.5 + 0.1 * math.sin(0.8 * f), 0.0))
        animate(arm, "rotation_euler", wave)


def mirror(at: Point, turn: float) -> None:
    """An upright oval of silvered glass in a gilt ring."""
    silver = plain("silver", (0.93, 0.93, 0.92), Metallic=1.0, Roughness=0.0)
    gilt = speckled("gilt", (0.40, 0.24, 0.07), (0.62, 0.42, 0.15), 22.0, 0.35)
    gilt.node_tree.nodes["Principled BSDF"].inputs["Metallic"].default_value = 1.0
    disc = lathe("mirror", [(0.0, 0.0), (0.5, 0.0), (0.5, -0.02), (0.0, -0.02)], at, silver, 1)
    ring = shapes.finished(shapes.ring("frame", 0.51, 0.035, at, (0, 0, 0)), gilt)
    for thing in (disc, ring):
        thing.scale = (0.85, 1.15, 1.0)
        thing.rotation_euler = (math.pi / 2 - 0.08, 0, turn)
    block("foot", (0.5, 0.2, 0.05), (at[0], at[1] + 0.05, 0.025), gilt, 0.02, turn)


def build() -> None:
    r = random.Random("fur")
    wood = speckled("walnut", (0.10, 0.045, 0.02), (0.24, 0.12, 0.055), 14.0, 0.25, 0.03)
    block("table", (3.6, 1.7, 0.1), (0, 0.25, -0.05), wood, 0.02)
    grid("cloth", 0.9, 0.62, speckled("lace", (0.55, 0.52, 0.46), (0.78, 0.75, 0.68), 70.0, 0.9), (-0.08, -0.12, 0.003), (0, 0, 0.1))
    grid("wall", 9, 5, shading.wallpaper(), (0, 2.6, 1.2), (math.pi / 2, 0, 0))
    bear((-0.12, -0.05, 0.25))
    mirror((0.56, 0.5, 0.62), -0.66)
    chrome = plain("chrome", (0.85, 0.86, 0.88), Metallic=1.0, Roughness=0.03)
    shapes.finished(shapes.sphere("ball", 0.11, (0.44, -0.28, 0.11)), chrome)
    bottle = [(0.0, 0.0), (0.085, 0.0), (0.095, 0.02), (0.09, 0.15), (0.03, 0.2), (0.03, 0.24), (0.0, 0.24)]
    lathe("scent", bottle, (-0.62, -0.02, 0), shading.glass("scent", (0.95, 0.70, 0.35)), 3)
    lathe("stopper", [(0.0, 0.24), (0.045, 0.25), (0.05, 0.3), (0.0, 0.33)], (-0.62, -0.02, 0), chrome, 3)
    block("box", (0.3, 0.2, 0.12), (-0.72, 0.38, 0.06), speckled("leather", (0.28, 0.03, 0.03), (0.42, 0.07, 0.05), 40.0, 0.4), 0.015, 0.4)
    lathe(
        "lid",
        [(0.0, 0.06), (0.06, 0.06), (0.065, 0.02), (0.06, 0.0), (0.0, 0.0)],
        (-0.36, -0.42, 0),
        plain("jar", (0.85, 0.55, 0.5), Roughness=0.2),
        3,
    )
    for number in range(17):
        x = -1.9 + 0.25 * number
        bulb = plain("bulb", (0, 0, 0), Emission_Color=(1.0, r.uniform(0.45, 0.75), r.uniform(0.12, 0.4), 1.0), Emission_Strength=45.0)
        shapes.finished(
            shapes.sphere("bulb", 0.026, (x, 2.3 + r.uniform(-0.1, 0.1), 0.86 + 0.2 * math.cos(1.7 * x) + r.uniform(-0.04, 0.04))), bulb
        )
    lamp("AREA", (-1.9, -1.6, 2.1), (0, 0, 0.3), 62, (1.0, 0.90, 0.78), shape="RECTANGLE", size=0.9, size_y=0.9)
    lamp("AREA", (2.2, -0.6, 1.5), (0, 0, 0.4), 26, (0.72, 0.84, 1.0), shape="RECTANGLE", size=0.5, size_y=1.4)
    lamp("AREA", (-0.4, 1.9, 2.4), (-0.1, 0, 0.5), 26, (1.0, 0.85, 0.7), shape="RECTANGLE", size=0.6, size_y=0.6)
    sky((0.25, 0.22, 0.2), (0.3, 0.3, 0.34), 0.22)
    lens = camera(lambda t: between((-0.36, -2.35, 0.86), (-0.2, -2.37, 0.84), t), lambda t: (0.14, 0.0, 0.5), 44)
    lens.dof.use_dof, lens.dof.focus_distance, lens.dof.aperture_fstop = True, 2.2, 0.9

"""Benchmark shot `garden`: grass, a tree, a hedge and a stone wall in sunlight; thousands of blades and leaves, a truck to the side."""

from __future__ import annotations

import math
import random

import bpy

from samples import shading, shapes
from training.benchmark.scenes.kit import between, block, camera, grid, lamp, lathe, mesh, plain, sky, speckled


def blades(
    r: random.Random, count: int, reach: float, high: tuple[float, float]
) -> tuple[list[tuple[float, float, float]], list[tuple[int, ...]]]:
    """A tuft: bent, pointed blades around the origin."""
    points: list[tuple[float, float, float]] = []
    faces: list[tuple[int, ...]] = []
    for _ in range(count):
        x, y, turn = r.uniform(-reach, reach), r.uniform(-reach, reach), r.uniform(0, math.tau)
        tall, lean, wide = r.uniform(*high), r.uniform(0.1, 0.6), r.uniform(0.004, 0.008)
        start = len(points)
        for level in range(3):
            t = level / 3
            out, half = lean * tall * t * t, wide * (1 - 0.25 * level)
            for sign in (-1, 1):
                points.append(
                    (
                        x + out * math.cos(turn) - sign * half * math.sin(turn),
                        y + out * math.sin(turn) + sign * half * math.cos(turn),
                        tall * t,
                    )
                )
        points.append((x + lean * tall * math.cos(turn), y + lean * tall * math.sin(turn), tall * (1 - 0.3 * lean)))
        faces += [(start, start + 1, start + 3, start + 2), (start + 2, start + 3, start + 5, start + 4), (start + 4, start + 5, start + 6)]
    return points, faces


def twig(r: random.Random, count: int, reach: float, size: float) -> tuple[list[tuple[float, float, float]], list[tuple[int, ...]]]:
    """Folded leaves scattered in a ball, as a twig carries them."""
    points: list[tuple[float, float, float]] = []
    faces: list[tuple[int, ...]] = []
    for _ in range(count):
        middle = [r.gauss(0, reach / 2) for _ in range(3)]
        yaw, pitch, long = r.uniform(0, math.tau), r.uniform(-0.8, 0.5), size * r.uniform(0.7, 1.2)
        ahead = (math.cos(yaw) * math.cos(pitch), math.sin(yaw) * math.cos(pitch), math.sin(pitch))
        side = (-math.sin(yaw), math.cos(yaw), 0.3)
        at = lambda a, b, middle=middle, ahead=ahead, side=side, long=long: tuple(
            m + long * (a * u + b * v) for m, u, v in zip(middle, ahead, side, strict=True)
        )
        start = len(points)
        points += [at(0, 0), at(0.45, 0.32), at(1.0, 0.0), at(0.45, -0.32), at(0.5, 0.0)]
        faces += [(start, start + 4, start + 2, start + 1), (start, start + 3, start + 2, start + 4)]
    return points, faces


def leafy(name: str, dark: tuple[float, float, float], light: tuple[float, float, float]) -> bpy.types.Material:
    """A green that differs from one instance to the next, lit through."""
    material, tree, shader = shading.principled(name, Roughness=0.55)
    which = shading.place(tree, "ObjectInfo").outputs["Random"]
    colour = shading.ramp(tree, which, [(0.0, dark), (1.0, light)])
    tree.links.new(colour, shader.inputs["Base Color"])
    through = shading.place(tree, "BsdfTranslucent", {"Color": colour})
    both = shading.place(tree, "MixShader", {0: 0.3, 1: shader.outputs[0], 2: through.outputs[0]})
    tree.links.new(both.outputs[0], tree.nodes["Material Output"].inputs["Surface"])
    return material


def scatter(r: random.Random, sources: list[bpy.types.Object], places: list[tuple[float, float, float]], upright: bool) -> None:
    """Instances of the sources, turned and scaled at random; the sources themselves are hidden far below."""
    for source in sources:
        source.location.z = -50
    for place in places:
        made = bpy.data.objects.new("instance", r.choice(sources).data)
        made.location = place
        made.rotation_euler = (0, 0, r.uniform(0, math.tau)) if upright else [r.uniform(0, math.tau) for _ in range(3)]
        made.scale = [r.uniform(0.75, 1.3)] * 3
        bpy.context.scene.collection.objects.link(made)


def masonry() -> bpy.types.Material:
    """Coursed rubble: blocks of their own tones, rough, with pale joints, on a wall in x and z."""
    material, tree, shader = shading.principled("masonry", Roughness=0.9)
    flat = shading.place(tree, "Mapping", {"Vector": shading.coordinates(tree, (1, 1, 1)), "Rotation": (math.pi / 2, 0, 0)}).outputs[0]
    brick = shading.place(
        tree,
        "TexBrick",
        {"Vector": flat, "Color1": (0.20, 0.17, 0.13, 1), "Color2": (0.46, 0.40, 0.32, 1), "Mortar": (0.50, 0.47, 0.42, 1)}
        | {"Scale": 1.0, "Mortar Size": 0.014, "Mortar Smooth": 0.4, "Brick Width": 0.42, "Row Height": 0.19},
        squash=0.6,
        squash_frequency=3,
    )
    rough = shading.place(tree, "TexNoise", {"Vector": flat, "Scale": 14.0, "Detail": 4.0, "Roughness": 0.7})
    worn = shading.ramp(tree, rough.outputs["Fac"], [(0.3, shading.grey(0.5)), (0.7, shading.grey(1.1))])
    tree.links.new(shading.mixed(tree, 1.0, brick.outputs["Color"], worn, "MULTIPLY"), shader.inputs["Base Color"])
    shading.bump(tree, shader, rough.outputs["Fac"], 0.5, 0.03)
    return material


def bark() -> bpy.types.Material:
    material, tree, shader = shading.principled("bark", Roughness=0.95)
    ridges = shading.place(
        tree, "TexNoise", {"Vector": shading.coordinates(tree, (9, 9, 1.6)), "Scale": 1.6, "Detail": 4.0, "Distortion": 0.8}
    )
    tree.links.new(
        shading.ramp(tree, ridges.outputs["Fac"], [(0.35, (0.035, 0.022, 0.014)), (0.62, (0.26, 0.19, 0.13))]), shader.inputs["Base Color"]
    )
    shading.bump(tree, shader, ridges.outputs["Fac"], 0.9, 0.06)
    return material


def planted(r: random.Random) -> None:
    grass = leafy("grass", (0.06, 0.16, 0.02), (0.20, 0.34, 0.06))
    tufts = [mesh("tuft", *blades(r, 42, 0.14, (0.06, 0.19)), grass) for _ in range(4)]
    spots = [(r.uniform(-3.2, 3.4), r.uniform(-2.2, 2.9), 0.0) for _ in range(1500)]
    scatter(r, tufts, [s for s in spots if abs(s[0] - 1.35 - 0.3 * s[1]) > 0.42 and (s[0] + 0.95) ** 2 + (s[1] - 0.8) ** 2 > 0.09], True)
    crown = [mesh("twig", *twig(r, 40, 0.3, 0.11), leafy("tree leaf", (0.05, 0.15, 0.02), (0.17, 0.30, 0.04))) for _ in range(3)]
    boughs = []
    while len(boughs) < 150:
        x, y, z = (r.uniform(-1.5, 1.5), r.uniform(-1.3, 1.3), r.uniform(-0.9, 0.9))
        if x * x / 2.2 + y * y / 1.6 + z * z / 0.8 < 1:
            boughs.append((-0.9 + x, 0.8 + y, 2.7 + z))
    scatter(r, crown, boughs, False)
    hedge = [mesh("hedge twig", *twig(r, 55, 0.2, 0.06), leafy("hedge leaf", (0.02, 0.08, 0.025), (0.07, 0.18, 0.06))) for _ in range(3)]
    scatter(r, hedge, [(r.uniform(1.6, 4.2), r.uniform(2.1, 2.8), r.uniform(0.05, 0.75)) for _ in range(230)], False)
    petals = [plain("petal", colour, Roughness=0.6) for colour in ((0.75, 0.08, 0.05), (0.80, 0.60, 0.06), (0.70, 0.66, 0.70))]
    for _ in range(46):
        x, y = r.uniform(-2.6, 0.4), r.uniform(-1.3, 0.3)
        bloom = [(0.0, 0.0), (0.012, 0.004), (0.035, 0.025), (0.03, 0.027), (0.0, 0.012)]
        lathe("flower", bloom, (x, y, r.uniform(0.14, 0.22)), r.choice(petals), 1)


def build() -> None:
    r = random.Random("garden")
    grid("earth", 30, 30, speckled("earth", (0.06, 0.045, 0.02), (0.13, 0.11, 0.05), 5.0, 0.95, 0))
    slab = speckled("slab", (0.26, 0.24, 0.21), (0.46, 0.43, 0.38), 11.0, 0.85, 0.4)
    for step in range(7):
        y = -2.0 + 0.66 * step
        block("slab", (0.72 + r.uniform(-0.08, 0.08), 0.56, 0.08), (1.35 + 0.3 * y, y, 0.02), slab, 0.03, r.uniform(-0.2, 0.2))
    block("wall", (14, 0.4, 1.5), (0, 3.3, 0.75), masonry(), 0.03)
    block("coping", (14, 0.52, 0.1), (0, 3.3, 1.54), slab, 0.03)
    trunk = [(0.0, 0.0), (0.34, 0.0), (0.22, 0.2), (0.17, 0.7), (0.16, 1.5), (0.13, 2.3), (0.05, 3.0), (0.0, 3.1)]
    lathe("trunk", trunk, (-0.9, 0.8, 0), bark())
    for angle, rise in ((0.3, 0.9), (2.4, 0.7), (4.0, 1.0)):
        bough = lathe("bough", [(0.07, 0.0), (0.05, 0.5), (0.02, 1.1), (0.0, 1.15)], (-0.9, 0.8, 1.9), bark())
        bough.rotation_euler = (0, rise, angle)
    pot = [(0.0, 0.0), (0.17, 0.0), (0.20, 0.2), (0.25, 0.42), (0.22, 0.42), (0.20, 0.36), (0.0, 0.36)]
    lathe("pot", pot, (0.45, 1.5, 0), speckled("terracotta", (0.42, 0.15, 0.07), (0.58, 0.25, 0.12), 14.0))
    shrub = mesh("shrub", *twig(r, 420, 0.28, 0.09), leafy("shrub leaf", (0.05, 0.16, 0.05), (0.1, 0.25, 0.08)), (0.45, 1.5, 0.66))
    shrub.scale.z = 1.15
    planted(r)
    lamp("SUN", (-4, -3, 6), (0, 0, 0), 3.6, (1.0, 0.92, 0.78), angle=0.03)
    sky((0.72, 0.80, 0.92), (0.22, 0.42, 0.85), 0.9)
    camera(lambda t: between((0.1, -3.6, 1.15), (0.5, -3.6, 1.12), t), lambda t: between((-0.1, 0.8, 0.95), (0.2, 0.8, 0.95), t), 30)
    shapes.finished(shapes.sphere("stone ball", 0.22, (2.0, 0.3, 0.22)), slab)

"""Benchmark shot `interior`: a living room lit through its window, most of it by what the walls and the floor throw back."""

from __future__ import annotations

import math
import random

from samples import shading
from training.benchmark.scenes.kit import between, block, camera, grid, lamp, lathe, mesh, plain, sky, speckled

WIDE, DEEP, HIGH = 3.0, 2.5, 2.8  # half the width, half the depth, the height, in metres
WINDOW = ((-0.1, 1.5), (0.95, 2.35))  # in y and z, in the wall at −x


def damask() -> object:
    """Striped paper with a printed figure, for a wall in x and z."""
    material, tree, shader = shading.principled("damask", Roughness=0.8)
    at = shading.coordinates(tree, (1, 1, 1))
    flat = shading.place(tree, "Mapping", {"Vector": at, "Rotation": (math.pi / 2, 0, 0)}).outputs[0]
    stripes = shading.place(tree, "TexWave", {"Vector": at, "Scale": 1.6}, bands_direction="X")
    cells = shading.place(tree, "TexVoronoi", {"Vector": flat, "Scale": 5.0, "Randomness": 0.0}, voronoi_dimensions="2D")
    ground = shading.ramp(tree, stripes.outputs["Fac"], [(0.0, (0.42, 0.47, 0.40)), (0.5, (0.58, 0.60, 0.50))], "CONSTANT")
    figure = shading.ramp(
        tree, cells.outputs["Distance"], [(0.0, (0.55, 0.30, 0.18)), (0.16, (1, 1, 1)), (0.3, (0.8, 0.8, 0.72)), (0.36, (1, 1, 1))]
    )
    tree.links.new(shading.mixed(tree, 1.0, ground, figure, "MULTIPLY"), shader.inputs["Base Color"])
    return material


def rug() -> object:
    material, tree, shader = shading.principled("rug", Roughness=0.95)
    at = shading.coordinates(tree, (1, 1, 1))
    rings = shading.place(tree, "TexWave", {"Vector": at, "Scale": 1.3, "Distortion": 0.6}, wave_type="RINGS", rings_direction="Z")
    stops = [(0.0, (0.30, 0.05, 0.04)), (0.35, (0.60, 0.42, 0.22)), (0.5, (0.05, 0.10, 0.20)), (0.8, (0.55, 0.12, 0.07))]
    threads = shading.place(tree, "TexNoise", {"Vector": shading.coordinates(tree, (9, 70, 1)), "Scale": 1.5})
    worn = shading.ramp(tree, threads.outputs["Fac"], [(0.3, shading.grey(0.55)), (0.7, shading.grey(1.0))])
    tree.links.new(
        shading.mixed(tree, 1.0, shading.ramp(tree, rings.outputs["Fac"], stops, "CONSTANT"), worn, "MULTIPLY"), shader.inputs["Base Color"]
    )
    return material


def painting() -> object:
    material, tree, shader = shading.principled("painting", Roughness=0.5)
    flat = shading.place(tree, "Mapping", {"Vector": shading.coordinates(tree, (1, 1, 1)), "Rotation": (math.pi / 2, 0, 0)}).outputs[0]
    cells = shading.place(tree, "TexVoronoi", {"Vector": flat, "Scale": 7.0}, distance="MANHATTAN")
    stops = [
        (0.0, (0.75, 0.55, 0.12)),
        (0.3, (0.10, 0.28, 0.45)),
        (0.5, (0.68, 0.16, 0.08)),
        (0.7, (0.75, 0.70, 0.58)),
        (0.85, (0.04, 0.06, 0.10)),
    ]
    value = shading.place(tree, "SeparateXYZ", {0: cells.outputs["Color"]}).outputs[0]
    tree.links.new(shading.ramp(tree, value, stops, "CONSTANT"), shader.inputs["Base Color"])
    return material


def room() -> None:
    plaster = speckled("plaster", (0.72, 0.66, 0.56), (0.80, 0.75, 0.66), 6.0, bump=0.15)
    white = plain("paint", (0.82, 0.82, 0.80), Roughness=0.4)
    grid("floor", 2 * WIDE, 2 * DEEP, shading.planks())
    grid("ceiling", 2 * WIDE, 2 * DEEP, plaster, (0, 0, HIGH))
    block("back wall", (2 * WIDE, 0.2, HIGH), (0, DEEP + 0.1, HIGH / 2), damask(), 0)
    block("front wall", (2 * WIDE, 0.2, HIGH), (0, -DEEP - 0.1, HIGH / 2), plaster, 0)
    block("right wall", (0.2, 2 * DEEP, HIGH), (WIDE + 0.1, 0, HIGH / 2), plaster, 0)
    (low, high), (bottom, top) = WINDOW
    x = -WIDE - 0.1
    block("wall under", (0.2, 2 * DEEP, bottom), (x, 0, bottom / 2), plaster, 0)
    block("wall over", (0.2, 2 * DEEP, HIGH - top), (x, 0, (HIGH + top) / 2), plaster, 0)
    block("wall near", (0.2, low + DEEP, top - bottom), (x, (low - DEEP) / 2, (top + bottom) / 2), plaster, 0)
    block("wall far", (0.2, DEEP - high, top - bottom), (x, (DEEP + high) / 2, (top + bottom) / 2), plaster, 0)
    middle = ((low + high) / 2, (bottom + top) / 2)
    for y in (low, middle[0], high):
        block("mullion", (0.06, 0.05, top - bottom), (x, y, middle[1]), white, 0.005)
    for z in (bottom, middle[1] + 0.2, top):
        block("rail", (0.06, high - low, 0.05), (x, middle[0], z), white, 0.005)
    block("sill", (0.34, high - low + 0.2, 0.04), (x + 0.14, middle[0], bottom - 0.02), white, 0.01)
    block("skirting", (2 * WIDE, 0.03, 0.12), (0, DEEP - 0.015, 0.06), white, 0.005)
    block("skirting", (0.03, 2 * DEEP, 0.12), (-WIDE + 0.015, 0, 0.06), white, 0.005)


def sofa() -> None:
    cloth = speckled("cloth", (0.035, 0.11, 0.13), (0.07, 0.19, 0.21), 45.0, 0.9, 0.3)
    block("seat", (1.9, 0.85, 0.34), (-0.35, 1.85, 0.3), cloth, 0.06)
    block("back", (1.9, 0.24, 0.85), (-0.35, 2.3, 0.45), cloth, 0.08)
    for x in (-1.38, 0.68):
        block("arm", (0.22, 0.9, 0.58), (x, 1.87, 0.33), cloth, 0.08)
    for x in (-0.82, 0.12):
        block("cushion", (0.9, 0.72, 0.16), (x, 1.78, 0.54), cloth, 0.06)
    for x, turn, colours in ((-0.98, 0.3, ((0.75, 0.40, 0.06), (0.85, 0.55, 0.12))), (0.30, -0.4, ((0.62, 0.56, 0.44), (0.76, 0.71, 0.6)))):
        pillow = block("pillow", (0.46, 0.15, 0.42), (x, 2.05, 0.82), speckled("pillow", *colours, 60.0, 0.9), 0.07, turn)
        pillow.rotation_euler.x = -0.3


def shelf(r: random.Random) -> None:
    wood = speckled("oak", (0.20, 0.10, 0.04), (0.34, 0.19, 0.08), 9.0, 0.45, 0.05)
    left, right, y = 1.15, 2.75, 2.3
    for x in (left, right):
        block("upright", (0.05, 0.36, 2.1), (x, y, 1.05), wood, 0.005)
    for level in range(6):
        z = 0.06 + 0.4 * level
        block("board", (right - left, 0.36, 0.04), ((left + right) / 2, y, z), wood, 0.005)
        x = left + 0.05
        while level < 5 and x < right - 0.16:
            wide, high = r.uniform(0.03, 0.075), r.uniform(0.2, 0.33)
            colour = r.choice(
                [(0.45, 0.05, 0.04), (0.06, 0.14, 0.30), (0.07, 0.22, 0.11), (0.62, 0.52, 0.34), (0.30, 0.16, 0.07), (0.65, 0.33, 0.05)]
            )
            shade = r.uniform(0.6, 1.2)
            book = plain("book", tuple(shade * c for c in colour), Roughness=0.55)
            block("book", (wide, 0.24, high), (x + wide / 2, y - 0.02, z + 0.02 + high / 2), book, 0.004)
            x += wide + (0.004 if r.random() < 0.88 else r.uniform(0.08, 0.2))


def table() -> None:
    wood = speckled("walnut", (0.10, 0.045, 0.02), (0.22, 0.11, 0.05), 14.0, 0.3, 0.03)
    block("top", (1.15, 0.62, 0.05), (-0.25, 0.62, 0.44), wood, 0.012)
    for x in (-0.75, 0.25):
        for y in (0.38, 0.86):
            block("leg", (0.05, 0.05, 0.42), (x, y, 0.21), wood, 0.006)
    vase = [(0.0, 0.0), (0.07, 0.0), (0.11, 0.09), (0.10, 0.18), (0.045, 0.26), (0.06, 0.31), (0.05, 0.30), (0.03, 0.25)]
    lathe("vase", vase, (-0.55, 0.66, 0.465), shading.porcelain())
    bowl = [(0.0, 0.0), (0.08, 0.0), (0.15, 0.06), (0.19, 0.12), (0.18, 0.12), (0.14, 0.065), (0.0, 0.02)]
    lathe("bowl", bowl, (0.05, 0.55, 0.465), plain("glaze", (0.75, 0.73, 0.68), Roughness=0.25))
    peel = [plain("orange", (0.80, 0.26, 0.02), Roughness=0.4), plain("lime", (0.30, 0.45, 0.04), Roughness=0.35)]
    fruit = [(0.0, 0.0), (0.03, 0.004), (0.055, 0.03), (0.06, 0.056), (0.05, 0.088), (0.02, 0.108), (0.0, 0.11)]
    for number, (x, y, z) in enumerate(((0.0, 0.53, 0.5), (0.1, 0.58, 0.5), (0.07, 0.49, 0.505), (0.05, 0.55, 0.57))):
        lathe("fruit", fruit, (x, y, z), peel[number % 2])
    for number, colour in enumerate(((0.06, 0.16, 0.30), (0.55, 0.10, 0.05))):
        block(
            "magazine",
            (0.24, 0.31, 0.02),
            (-0.25, 0.58, 0.476 + 0.022 * number),
            plain("cover", colour, Roughness=0.3),
            0.002,
            0.2 - 0.5 * number,
        )


def plant(r: random.Random) -> None:
    """Long bent leaves in a pot, in the corner beside the window."""
    pot = [(0.0, 0.0), (0.15, 0.0), (0.17, 0.15), (0.21, 0.34), (0.19, 0.34), (0.17, 0.28), (0.0, 0.28)]
    lathe("pot", pot, (-2.45, 2.0, 0), speckled("terracotta", (0.45, 0.16, 0.07), (0.58, 0.25, 0.12), 12.0))
    points, faces = [], []
    for _ in range(46):
        angle, reach, high = r.uniform(0, math.tau), r.uniform(0.2, 0.55), r.uniform(0.5, 1.15)
        side = (-math.sin(angle), math.cos(angle))
        start = len(points)
        for step in range(7):
            t = step / 6
            out, up, wide = reach * t**1.5, high * (t - 0.45 * t * t) / 0.55, 0.045 * math.sin(math.pi * min(0.12 + t * 0.88, 0.995))
            for sign in (-1, 1):
                points.append((out * math.cos(angle) + sign * wide * side[0], out * math.sin(angle) + sign * wide * side[1], 0.28 + up))
            if step:
                a = start + 2 * step
                faces.append((a - 2, a - 1, a + 1, a))
    mesh("leaves", points, faces, shading.leaf(), (-2.45, 2.0, 0))


def build() -> None:
    r = random.Random("interior")
    room()
    sofa()
    shelf(r)
    table()
    plant(r)
    rug_at = grid("rug", 2.4, 1.7, rug(), (-0.2, 0.55, 0.012))
    rug_at.rotation_euler.z = 0.05
    block("frame", (1.2, 0.05, 0.8), (-0.45, DEEP - 0.03, 1.75), speckled("gilt", (0.25, 0.15, 0.05), (0.4, 0.26, 0.1), 20.0, 0.4), 0.01)
    block("canvas", (1.08, 0.05, 0.68), (-0.45, DEEP - 0.04, 1.75), painting(), 0)
    (low, high), (bottom, top) = WINDOW
    centre = (-WIDE - 0.24, (low + high) / 2, (bottom + top) / 2)
    size = {"shape": "RECTANGLE", "size": top - bottom, "size_y": high - low}
    lamp("AREA", centre, (0, centre[1], centre[2]), 110, (0.86, 0.93, 1.0), **size)
    # A wider window behind the camera.
    lamp("AREA", (-0.4, -DEEP + 0.02, 1.6), (-0.4, 0, 1.6), 55, (0.9, 0.95, 1.0), shape="RECTANGLE", size=2.6, size_y=1.5)
    sky((0.75, 0.85, 1.0), (0.35, 0.55, 1.0), 1.5, lights=False)
    camera(lambda t: between((2.35, -2.2, 1.45), (1.75, -2.2, 1.55), t), lambda t: between((-0.5, 1.6, 1.0), (-0.72, 1.6, 1.02), t), 24)

"""Benchmark shot `walker`: a jointed figure walks over a tiled floor beside its large soft shadow."""

from __future__ import annotations

import math

import bpy

from samples import shading, shapes
from training.benchmark.scenes.kit import animate, between, block, camera, grid, lamp, lathe, plain, progress, sky, speckled

# Where each joint sits in its parent's space, in metres; the figure faces +x, its left is +y.
PELVIS = 0.98


def tiles() -> bpy.types.Material:
    material, tree, shader = shading.principled("tiles", Roughness=0.45)
    at = shading.coordinates(tree, (1, 1, 1), 0.4)
    checks = shading.place(
        tree, "TexChecker", {"Vector": at, "Scale": 2.2, "Color1": (0.62, 0.56, 0.47, 1), "Color2": (0.30, 0.20, 0.15, 1)}
    )
    stone = shading.place(tree, "TexNoise", {"Vector": at, "Scale": 9.0, "Detail": 4.0, "Distortion": 1.2})
    veins = shading.ramp(tree, stone.outputs["Fac"], [(0.3, shading.grey(0.62)), (0.5, shading.grey(1.0)), (0.7, shading.grey(0.75))])
    tree.links.new(shading.mixed(tree, 1.0, checks.outputs["Color"], veins, "MULTIPLY"), shader.inputs["Base Color"])
    return material


def plaid() -> bpy.types.Material:
    """The jumper: rings of colour up the body."""
    material, tree, shader = shading.principled("jumper", Roughness=0.9)
    up = shading.place(tree, "SeparateXYZ", {0: shading.coordinates(tree, (1, 1, 14))}).outputs["Z"]
    step = shading.place(tree, "Math", {0: up}, operation="FRACT").outputs[0]
    stops = [(0.0, (0.55, 0.07, 0.05)), (0.45, (0.75, 0.68, 0.55)), (0.6, (0.06, 0.12, 0.25)), (0.78, (0.75, 0.68, 0.55))]
    knit = shading.place(tree, "TexNoise", {"Vector": shading.coordinates(tree, (70, 70, 110)), "Scale": 1.0, "Detail": 1.0})
    worn = shading.ramp(tree, knit.outputs["Fac"], [(0.3, shading.grey(0.6)), (0.7, shading.grey(1.0))])
    tree.links.new(shading.mixed(tree, 1.0, shading.ramp(tree, step, stops, "CONSTANT"), worn, "MULTIPLY"), shader.inputs["Base Color"])
    return material


def limb(name: str, length: float, thick: tuple[float, float], material: bpy.types.Material) -> bpy.types.Object:
    """Hangs down from its joint, thicker above than below."""
    top, end = thick
    profile = [(0.0, -length - end), (end * 0.8, -length - end * 0.5), (end, -length), ((top + end) / 2, -length / 2)]
    return lathe(name, [*profile, (top, 0.0), (top * 0.8, top * 0.55), (0.0, top)], (0, 0, 0), material)


def joined(child: bpy.types.Object, parent: bpy.types.Object, at: tuple[float, float, float]) -> bpy.types.Object:
    child.parent = parent
    child.location = at
    return child


def swing(thing: bpy.types.Object, angle: float, sway: float, phase: float) -> None:
    """Turns about y with the stride: around `angle`, `sway` either way, in radians."""
    animate(thing, "rotation_euler", lambda frame: (0.0, angle + sway * math.sin(stride(frame) + phase), 0.0))


def stride(frame: int) -> float:
    """Phase of the walk: a third of a cycle in the shot."""
    return 0.4 + 0.36 * math.tau * progress(frame)


def figure() -> None:
    skin = plain("skin", (0.55, 0.30, 0.19), Roughness=0.5)
    jumper = plaid()
    denim = speckled("denim", (0.03, 0.06, 0.14), (0.07, 0.12, 0.24), 60.0, 0.9)
    shoe = plain("shoe", (0.10, 0.035, 0.015), Roughness=0.3)
    hips = lathe("hips", [(0.0, -0.12), (0.13, -0.08), (0.165, 0.02), (0.14, 0.12), (0.0, 0.16)], (0, 0, 0), denim)
    animate(hips, "location", lambda frame: (-0.28 + 0.56 * progress(frame), 0.0, PELVIS + 0.02 * math.cos(2 * stride(frame))))
    animate(hips, "rotation_euler", lambda frame: (0.0, 0.04, 0.10 * math.sin(stride(frame))))
    trunk = [(0.0, 0.0), (0.135, 0.03), (0.145, 0.15), (0.18, 0.36), (0.165, 0.47), (0.07, 0.53), (0.0, 0.54)]
    chest = joined(lathe("chest", trunk, (0, 0, 0), jumper), hips, (0, 0, 0.1))
    animate(chest, "rotation_euler", lambda frame: (0.0, 0.05, -0.2 * math.sin(stride(frame))))
    head = joined(lathe("neck", [(0.0, 0.0), (0.055, 0.0), (0.05, 0.1), (0.0, 0.12)], (0, 0, 0), skin), chest, (0.02, 0, 0.5))
    animate(head, "rotation_euler", lambda frame: (0.0, 0.02, -0.5 + 0.25 * progress(frame)))
    face = joined(shapes.finished(shapes.sphere("face", 0.115, (0, 0, 0)), skin), head, (0.02, 0, 0.19))
    face.scale = (1.0, 0.86, 1.18)
    hair = joined(
        shapes.finished(shapes.sphere("hair", 0.12, (0, 0, 0)), speckled("hair", (0.02, 0.01, 0.006), (0.09, 0.045, 0.02), 50.0)),
        head,
        (-0.012, 0, 0.215),
    )
    hair.scale = (1.0, 0.92, 1.1)
    for y in (-0.04, 0.04):
        joined(
            shapes.finished(shapes.sphere("eye", 0.014, (0, 0, 0)), plain("eye", (0.02, 0.02, 0.02), Roughness=0.1)),
            head,
            (0.128, y, 0.205),
        )
    joined(shapes.finished(shapes.sphere("nose", 0.022, (0, 0, 0)), skin), head, (0.137, 0, 0.175))
    for side, phase in ((1, 0.0), (-1, math.pi)):
        upper = joined(limb("upper arm", 0.28, (0.062, 0.048), jumper), chest, (0, side * 0.205, 0.43))
        swing(upper, 0.0, 0.55, phase)
        fore = joined(limb("forearm", 0.24, (0.046, 0.036), jumper), upper, (0, 0, -0.29))
        swing(fore, -0.55, 0.25, phase)
        joined(shapes.finished(shapes.sphere("hand", 0.05, (0, 0, 0)), skin), fore, (0, 0, -0.3))
        thigh = joined(limb("thigh", 0.42, (0.095, 0.066), denim), hips, (0, side * 0.095, -0.04))
        swing(thigh, -0.1, -0.5, phase)
        shin = joined(limb("shin", 0.38, (0.064, 0.045), denim), thigh, (0, 0, -0.43))
        swing(shin, 0.42, 0.36, phase + 0.9)
        joined(block("shoe", (0.26, 0.1, 0.09), (0, 0, 0), shoe, 0.04), shin, (0.06, 0, -0.44))


def build() -> None:
    grid("floor", 24, 24, tiles())
    wall = speckled("wall", (0.40, 0.43, 0.46), (0.50, 0.52, 0.53), 3.0, bump=0)
    block("wall", (24, 0.2, 5), (0, 3.0, 2.5), wall, 0)
    block("skirting", (24, 0.04, 0.16), (0, 2.88, 0.08), plain("skirting", (0.7, 0.68, 0.63), Roughness=0.5), 0.01)
    crate = speckled("crate", (0.22, 0.12, 0.05), (0.42, 0.26, 0.12), 8.0)
    block("crate", (0.6, 0.6, 0.6), (1.35, 1.7, 0.3), crate, 0.02, 0.3)
    block("crate", (0.4, 0.4, 0.4), (1.25, 1.65, 0.8), crate, 0.02, -0.2)
    block("door", (1.0, 0.06, 2.1), (-1.5, 2.88, 1.05), plain("door", (0.09, 0.22, 0.20), Roughness=0.4), 0.01)
    shapes.finished(
        shapes.sphere("ball", 0.19, (-1.05, 0.75, 0.19)),
        shading.lacquer("ball", ((0.7, 0.5, 0.05), (0.6, 0.06, 0.04), (0.8, 0.78, 0.7)), 4.0),
    )
    figure()
    lamp("AREA", (-3.0, -1.5, 3.0), (0.1, 0.2, 0.7), 360, (1.0, 0.93, 0.82), shape="DISK", size=1.5)
    sky((0.55, 0.65, 0.8), (0.75, 0.85, 1.0), 0.2)
    camera(lambda t: (0.35, -4.6, 1.35), lambda t: between((-0.1, 0, 0.9), (0.22, 0, 0.9), t), 41)

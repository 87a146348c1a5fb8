"""Hair and fur for the training shots: Blender's hair curves on any mesh."""

from __future__ import annotations

import math
import random

import bpy
import numpy as np

from training.shots.cycles.materials import colour

JOINTS = 6  # points of a hair


def roots(r: np.random.Generator, body: bpy.types.Object, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Points on the body's mesh, spread evenly over its area, and the normals there; (count, 3) each."""
    mesh = body.data
    mesh.calc_loop_triangles()
    corners = np.empty(len(mesh.loop_triangles) * 3, np.int32)
    mesh.loop_triangles.foreach_get("vertices", corners)
    places = np.empty(len(mesh.vertices) * 3, np.float32)
    mesh.vertices.foreach_get("co", places)
    a, b, c = np.moveaxis(places.reshape(-1, 3)[corners.reshape(-1, 3)], 1, 0)
    across = np.cross(b - a, c - a)
    twice = np.linalg.norm(across, axis=1)
    chosen = r.choice(len(twice), count, p=twice / twice.sum())
    u, v = r.random((2, count, 1))
    u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
    return a[chosen] + u * (b - a)[chosen] + v * (c - a)[chosen], across[chosen] / twice[chosen, None]


def grown(r: np.random.Generator, at: np.ndarray, outward: np.ndarray, length: float, curl: float) -> np.ndarray:
    """Hairs from their roots, (count, JOINTS, 3), each leaning some way of its own and down."""
    count = len(at)
    lean = curl * r.normal(size=(count, 3)) + np.array([0, 0, -0.5 * r.random()])
    tall = length * r.uniform(0.6, 1.2, (count, 1, 1))
    t = np.linspace(0, 1, JOINTS)[None, :, None]
    return at[:, None] + tall * (t * outward[:, None] + t**2 * lean[:, None])


def curves(name: str, points: np.ndarray, radius: float) -> bpy.types.Object:
    """An object of hairs, thinner towards their tips; the scene has it."""
    data = bpy.data.hair_curves.new(name)
    data.add_curves([points.shape[1]] * len(points))
    data.attributes["position"].data.foreach_set("vector", points.astype(np.float32).ravel())
    thick = np.broadcast_to(radius * np.linspace(1, 0.25, points.shape[1]), points.shape[:2])
    data.attributes.new("radius", "FLOAT", "POINT").data.foreach_set("value", thick.astype(np.float32).ravel())
    thing = bpy.data.objects.new(name, data)
    bpy.context.scene.collection.objects.link(thing)
    return thing


def strand_material(r: random.Random) -> bpy.types.Material:
    """Hair as Cycles has it, or plain strands that let some light through."""
    made = bpy.data.materials.new("hair")
    made.use_nodes = True
    tree = made.node_tree
    output = tree.nodes["Material Output"].inputs["Surface"]
    if r.random() < 0.5:
        tree.nodes.remove(tree.nodes["Principled BSDF"])
        shader = tree.nodes.new("ShaderNodeBsdfHairPrincipled")
        if r.random() < 0.6:
            shader.parametrization = "MELANIN"
            shader.inputs["Melanin"].default_value = r.uniform(0.05, 0.95)
            shader.inputs["Melanin Redness"].default_value = r.random()
            shader.inputs["Random Color"].default_value = r.uniform(0, 0.6)
        else:
            shader.parametrization = "COLOR"
            shader.inputs["Color"].default_value = colour(r, 0.2, 0.9)
        shader.inputs["Roughness"].default_value = r.uniform(0.15, 0.5)
        tree.links.new(shader.outputs[0], output)
        return made
    shader = tree.nodes["Principled BSDF"]
    shader.inputs["Roughness"].default_value = r.uniform(0.3, 0.8)
    ramp = tree.nodes.new("ShaderNodeValToRGB")
    ramp.color_ramp.elements[0].color, ramp.color_ramp.elements[1].color = colour(r, 0.05, 0.6), colour(r, 0.2, 0.9)
    tree.links.new(tree.nodes.new("ShaderNodeHairInfo").outputs[r.choice(["Random", "Intercept"])], ramp.inputs["Fac"])
    tree.links.new(ramp.outputs["Color"], shader.inputs["Base Color"])
    through = tree.nodes.new("ShaderNodeBsdfTranslucent")
    tree.links.new(ramp.outputs["Color"], through.inputs["Color"])
    both = tree.nodes.new("ShaderNodeMixShader")
    both.inputs[0].default_value = r.uniform(0.1, 0.5)
    tree.links.new(shader.outputs[0], both.inputs[1])
    tree.links.new(through.outputs[0], both.inputs[2])
    tree.links.new(both.outputs[0], output)
    return made


def coat(r: random.Random, body: bpy.types.Object) -> None:
    """Fur for a body of about two units across; it moves with it."""
    spread = np.random.default_rng(r.randrange(1 << 30))
    length = math.exp(r.uniform(-2.4, -0.4))
    points = grown(spread, *roots(spread, body, r.randint(3000, 14000)), length, r.uniform(0.1, 0.7))
    fur = curves("fur", points, math.exp(r.uniform(-6.2, -4.6)))
    fur.data.materials.append(strand_material(r))
    fur.parent = body


def meadow(r: random.Random, size: float) -> None:
    """Blades all over the middle of the ground."""
    spread = np.random.default_rng(r.randrange(1 << 30))
    count = r.randint(8000, 25000)
    at = np.concatenate((spread.uniform(-size, size, (count, 2)), np.zeros((count, 1))), 1)
    upward = np.broadcast_to(np.array([0.0, 0.0, 1.0]), at.shape)
    points = grown(spread, at, upward, size * math.exp(r.uniform(-3.2, -1.8)), r.uniform(0.15, 0.5))
    blades = curves("meadow", points, size * math.exp(r.uniform(-6.6, -5.4)))
    blades.data.materials.append(strand_material(r))


def add(r: random.Random, bodies: list[bpy.types.Object], kind: str, size: float) -> None:
    """Fur on some of the bodies, or a meadow outdoors."""
    if not bodies or (kind == "outdoor" and r.random() < 0.5):
        meadow(r, size)
        return
    for body in r.sample(bodies, min(len(bodies), r.randint(1, 3))):
        coat(r, body)

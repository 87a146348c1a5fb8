"""What two in five training shots have on purpose, as random things alone rarely bring it; each by its name."""

from __future__ import annotations

import math
import random
from collections.abc import Callable

import bpy
from mathutils import Vector

from training.shots.cycles import hair, volumes, water
from training.shots.cycles.built import Built
from training.shots.cycles.lights import area_lamp
from training.shots.cycles.materials import colour, material
from training.shots.cycles.motion import animate, flicker
from training.shots.cycles.signs import bulbs, lit_wall, signs
from training.shots.cycles.trees import trees

SHARE = 0.4  # of the shots that have one
SECOND = 0.25  # of those that have another
WEIGHTS = {
    "hair": 2.0,
    "volume": 2.0,
    "water": 1.0,
    "glass": 2.0,
    "mirrors": 2.0,
    "skin": 1.0,
    "leaves": 1.0,
    "signs": 2.0,
    "lit wall": 1.0,
    "trees": 2.0,
    "flicker": 1.0,
    "bokeh": 2.0,
    "film": 1.0,
    "motion blur": 2.0,
}
OUTDOORS = {"film", "trees"}  # seen in part before nothing but the world
VECTOR_LAYER = "Hush Vectors"


def drawn(r: random.Random) -> list[str]:
    """The names of a shot's features: none, one or two."""
    if r.random() >= SHARE:
        return []
    count = 2 if r.random() < SECOND else 1
    found: list[str] = []
    while len(found) < count:
        name = r.choices(list(WEIGHTS), list(WEIGHTS.values()))[0]
        if name not in found:
            found.append(name)
    return found


def mirrors(shot: Built) -> None:
    """Standing panes, boxes and balls that reflect; half of them turn or go by."""
    r, size = shot.r, shot.size
    for _ in range(r.randint(1, 3)):
        sort = r.choice(["pane", "pane", "box", "ball"])
        tall = size * r.uniform(0.15, 0.4)
        where = shot.place(0.9, 1.5)
        where.z = max(where.z, tall * 0.7)
        if sort == "ball":
            bpy.ops.mesh.primitive_uv_sphere_add(segments=48, ring_count=24, radius=tall * 0.6, location=where)
            bpy.ops.object.shade_smooth()
        else:
            bpy.ops.mesh.primitive_cube_add(size=2, location=where)
            bpy.context.object.scale = (tall * r.uniform(0.5, 1), tall * (0.03 if sort == "pane" else r.uniform(0.3, 0.8)), tall)
        mirror = bpy.context.object
        facing = (shot.scene.camera.location - where).to_track_quat("-Y", "Z").to_euler().z
        mirror.rotation_euler = (r.gauss(0, 0.08), r.gauss(0, 0.05), facing + r.gauss(0, 0.5))
        silver = bpy.data.materials.new("mirror")
        silver.use_nodes = True
        inputs = silver.node_tree.nodes["Principled BSDF"].inputs
        inputs["Metallic"].default_value = 1.0
        inputs["Roughness"].default_value = r.choice([0.0, 0.0, 0.0, 0.03, 0.1])
        inputs["Base Color"].default_value = colour(r, 0.75, 0.98, r.random() * 0.25)
        mirror.data.materials.append(silver)
        if r.random() < 0.5:
            animate(mirror, [r.gauss(0, 1) * shot.step * 2 for _ in range(2)] + [0], [0, 0, r.gauss(0, 0.03)])


def skin(shot: Built) -> None:
    """Flesh, wax or marble on some things, with light from behind on some of them."""
    r = shot.r
    bodies = shot.seen()
    for body in r.sample(bodies, min(len(bodies), r.randint(2, 4))):
        made = bpy.data.materials.new("skin")
        made.use_nodes = True
        tree = made.node_tree
        shader = tree.nodes["Principled BSDF"]
        inputs = shader.inputs
        tone = r.uniform(0.15, 0.9)
        tint = (tone, tone * r.uniform(0.5, 0.8), tone * r.uniform(0.3, 0.7), 1) if r.random() < 0.7 else colour(r, 0.4, 0.95)
        inputs["Base Color"].default_value = tint
        inputs["Subsurface Weight"].default_value = r.uniform(0.5, 1.0)
        inputs["Subsurface Radius"].default_value = (1.0, r.uniform(0.2, 0.5), r.uniform(0.08, 0.3))
        inputs["Subsurface Scale"].default_value = math.exp(r.uniform(-3.5, -1.2)) * shot.size / 3
        inputs["Roughness"].default_value = r.uniform(0.25, 0.6)
        pores = tree.nodes.new("ShaderNodeTexNoise")
        pores.inputs["Scale"].default_value = r.uniform(20, 80)
        bump = tree.nodes.new("ShaderNodeBump")
        bump.inputs["Strength"].default_value, bump.inputs["Distance"].default_value = r.uniform(0.05, 0.4), 0.02
        tree.links.new(pores.outputs[0], bump.inputs["Height"])
        tree.links.new(bump.outputs[0], inputs["Normal"])
        body.data.materials.clear()
        body.data.materials.append(made)
    energy, angle = shot.size**2 * r.uniform(5, 30), r.uniform(0, 6.28)
    behind = Vector((math.cos(angle), math.sin(angle), r.uniform(0.4, 0.9))) * shot.size
    area_lamp(shot.scene, energy, shot.size * 0.3, behind, Vector((0, 0, 0.3 * shot.size)))


def leaf_material(r: random.Random) -> bpy.types.Material:
    """A leaf drawn by alpha on a square, with a midrib, lit through."""
    made = bpy.data.materials.new("leaf")
    made.use_nodes = True
    tree = made.node_tree
    math_node = lambda operation, a, b=None: _math(tree, operation, a, b)
    uv = tree.nodes.new("ShaderNodeSeparateXYZ")
    tree.links.new(tree.nodes.new("ShaderNodeUVMap").outputs[0], uv.inputs[0])
    along, across = uv.outputs["X"], math_node("ABSOLUTE", math_node("SUBTRACT", uv.outputs["Y"], 0.5))
    ragged = tree.nodes.new("ShaderNodeTexNoise")
    ragged.inputs["Scale"].default_value = r.uniform(2, 12)
    outline = math_node("MULTIPLY", math_node("SINE", math_node("MULTIPLY", along, math.pi)), r.uniform(0.15, 0.45))
    torn = math_node("MULTIPLY", outline, math_node("ADD", math_node("MULTIPLY", ragged.outputs[0], r.uniform(0, 0.8)), 0.6))
    alpha = math_node("LESS_THAN", across, torn)
    ramp = tree.nodes.new("ShaderNodeValToRGB")
    low, high = ramp.color_ramp.elements
    low.color, high.color, high.position = colour(r, 0.2, 0.9), colour(r, 0.05, 0.6), r.uniform(0.03, 0.2)
    tree.links.new(across, ramp.inputs["Fac"])
    shader = tree.nodes["Principled BSDF"]
    shader.inputs["Roughness"].default_value = r.uniform(0.3, 0.8)
    through = tree.nodes.new("ShaderNodeBsdfTranslucent")
    for socket in (shader.inputs["Base Color"], through.inputs["Color"]):
        tree.links.new(ramp.outputs["Color"], socket)
    both, cut = tree.nodes.new("ShaderNodeMixShader"), tree.nodes.new("ShaderNodeMixShader")
    both.inputs[0].default_value = r.uniform(0.1, 0.5)
    tree.links.new(shader.outputs[0], both.inputs[1])
    tree.links.new(through.outputs[0], both.inputs[2])
    tree.links.new(alpha, cut.inputs[0])
    tree.links.new(tree.nodes.new("ShaderNodeBsdfTransparent").outputs[0], cut.inputs[1])
    tree.links.new(both.outputs[0], cut.inputs[2])
    tree.links.new(cut.outputs[0], tree.nodes["Material Output"].inputs["Surface"])
    return made


def _math(tree: bpy.types.NodeTree, operation: str, *inputs: bpy.types.NodeSocket | float | None) -> bpy.types.NodeSocket:
    node = tree.nodes.new("ShaderNodeMath")
    node.operation = operation
    for socket, value in zip(node.inputs, inputs, strict=False):
        if isinstance(value, bpy.types.NodeSocket):
            tree.links.new(value, socket)
        elif value is not None:
            socket.default_value = value
    return node.outputs[0]


def leaves(shot: Built) -> None:
    """Bushes of squares that alpha makes leaves of; they sway."""
    r = shot.r
    for _ in range(r.randint(1, 4)):
        length = shot.size * math.exp(r.uniform(-3.6, -2.2))
        reach = [shot.size * r.uniform(0.1, 0.3) for _ in range(3)]
        points: list[Vector] = []
        faces: list[tuple[int, ...]] = []
        for _ in range(r.randint(150, 700)):
            middle = Vector([r.gauss(0, 0.5) * extent for extent in reach])
            ahead = Vector((r.gauss(0, 1), r.gauss(0, 1), r.gauss(-0.2, 0.5))).normalized()
            side = ahead.cross(Vector((r.gauss(0, 0.3), r.gauss(0, 0.3), 1))).normalized()
            first = len(points)
            points += [middle + length * (ahead * u + side * v) for u, v in ((0, -0.5), (1, -0.5), (1, 0.5), (0, 0.5))]
            faces.append((first, first + 1, first + 2, first + 3))
        mesh = bpy.data.meshes.new("bush")
        mesh.from_pydata(points, [], faces)
        mesh.uv_layers.new(name="UVMap").data.foreach_set("uv", [0, 0, 1, 0, 1, 1, 0, 1] * len(faces))
        mesh.materials.append(leaf_material(r))
        bush = bpy.data.objects.new("bush", mesh)
        bush.location = shot.place(0.6, 1.3)
        shot.scene.collection.objects.link(bush)
        if r.random() < 0.6:
            animate(bush, [0, 0, 0], [r.gauss(0, 0.01) for _ in range(3)])


def flickering(shot: Built) -> None:
    """The lamps change their brightness from frame to frame."""
    for light in shot.lights:
        flicker(shot.r, light.data, shot.r.uniform(0.1, 0.8))


def bokeh(shot: Built) -> None:
    """A wide aperture, focus on the nearest of the things, and small lights that are out of it."""
    r = shot.r
    eye = shot.scene.camera
    ahead = eye.rotation_quaternion @ Vector((0, 0, -1))
    near = [d for thing in shot.things if (d := (thing.location - eye.location).dot(ahead)) > 0.1 * shot.size]
    lens = eye.data.dof
    lens.use_dof = True
    lens.focus_distance = (min(near) if r.random() < 0.7 else r.choice(near)) if near else shot.size
    # As wide as a share of the scene's size, whatever the lens.
    lens.aperture_fstop = eye.data.lens / 1000 / (shot.size * math.exp(r.uniform(-4.2, -2.3)))
    lens.aperture_blades = r.choice([0, 0, 5, 6, 8])
    lens.aperture_ratio = r.choice([1, 1, 1, 1.6])
    bulbs(shot, r.randint(5, 20), (2.5, 6), (0.5, 2.2))


def film(shot: Built) -> None:
    """Transparent where there is only the world; a room has no such place, but for its opening."""
    shot.scene.render.film_transparent = True


def motion_blur(shot: Built) -> None:
    """The main view layer is blurred, and a second one without blur has the vectors, as the extension sets it up."""
    r, scene = shot.r, shot.scene
    scene.render.use_motion_blur = True
    scene.render.motion_blur_shutter = r.uniform(0.2, 1.0)
    layer = scene.view_layers.new(VECTOR_LAYER)
    layer.use_motion_blur, layer.samples, layer.use_pass_vector = False, 1, True
    for thing in r.sample(shot.things, min(len(shot.things), 3)):
        animate(thing, [r.gauss(0, 1) * shot.step * 9 for _ in range(3)], [r.gauss(0, 0.15) for _ in range(3)])


def textured(shot: Built) -> None:
    """Gives a mirror something to show that goes by: one more thing, textured and moving."""
    r = shot.r
    bpy.ops.mesh.primitive_cube_add(size=1.2, location=shot.place(0.5, 0.9))
    passer = bpy.context.object
    passer.scale = [shot.size * r.uniform(0.15, 0.35)] * 3
    passer.data.materials.append(material(r, 3.0, shot.assets, emits=False))
    animate(passer, [r.gauss(0, 1) * shot.step * 5 for _ in range(2)] + [0], [0, 0, r.gauss(0, 0.05)])


FEATURES: dict[str, tuple[Callable[[Built], object], ...]] = {
    "hair": (lambda shot: hair.add(shot.r, shot.seen(), shot.kind, shot.size),),
    "volume": (lambda shot: volumes.add(shot.r, shot.seen(), shot.size, shot.place),),
    "water": (lambda shot: water.waves(shot.r, shot.size),),
    "glass": (lambda shot: shot.things.extend(water.thick_glass(shot.r, shot.seen(), shot.distance, shot.place)),),
    "mirrors": (mirrors, textured),
    "skin": (skin,),
    "leaves": (leaves,),
    "signs": (signs,),
    "lit wall": (lit_wall,),
    "trees": (trees,),
    "flicker": (flickering,),
    "bokeh": (bokeh,),
    "film": (film,),
    "motion blur": (motion_blur,),
}


def add(shot: Built, names: list[str]) -> None:
    """Adds what the names say to a shot whose camera stands."""
    for name in names:
        for part in FEATURES[name]:
            part(shot)

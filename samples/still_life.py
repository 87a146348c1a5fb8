"""The sample shot's scene: a still life on a table by a window, built from nothing. One unit is ten centimetres."""

from __future__ import annotations

import math
import random
from collections.abc import Sequence

import bpy
import shading
from mathutils import Euler, Vector
from shapes import added, box, finished, islands, ring, rounded, sphere, turned

FIRST, LAST = 1, 8


def moving(thing: bpy.types.Object, travel: Sequence[float] = (0, 0, 0), spin: Sequence[float] = (0, 0, 0), centre: float = 4.5) -> None:
    """Constant speed, `travel` units and `spin` radians (about the object's own axes) a frame; the pose built is that of `centre`."""
    where, pose = Vector(thing.location), thing.rotation_euler.to_quaternion()
    thing.rotation_mode = "QUATERNION"
    for frame in range(FIRST - 1, LAST + 2):
        thing.location = where + Vector(travel) * (frame - centre)
        thing.rotation_quaternion = pose @ Euler([a * (frame - centre) for a in spin]).to_quaternion()
        thing.keyframe_insert("location", frame=frame)
        thing.keyframe_insert("rotation_quaternion", frame=frame)


def room() -> None:
    finished(box("table", (17, 8.2, 0.5), (0, 0.9, -0.25), 0.06), shading.planks(), smooth=False)
    bpy.ops.mesh.primitive_plane_add(size=1, location=(0, 5.4, 2), rotation=(math.pi / 2, 0, 0))
    wall = bpy.context.object
    wall.name, wall.data.name = "wall", "wall"
    for vertex in wall.data.vertices:  # real size in the mesh, so that object coordinates are units
        vertex.co.x, vertex.co.y = vertex.co.x * 24, vertex.co.y * 14
    finished(wall, shading.wallpaper(), smooth=False)
    rail, _, _ = shading.principled("rail", Base_Color=(0.30, 0.25, 0.18, 1), Roughness=0.35)
    finished(box("rail", (24, 0.2, 0.35), (0, 5.3, 0.9)), rail, smooth=False)
    finished(box("dado", (24, 0.1, 4.0), (0, 5.35, -1.1)), rail, smooth=False)


def runner() -> None:
    """The cloth: a strip with soft folds, over the table's front edge."""
    columns, rows, width, length = 120, 200, 3.3, 9.5
    points, faces = [], []
    for j in range(rows):
        v = j / (rows - 1)
        for i in range(columns):
            u = i / (columns - 1) - 0.5
            y = 4.6 - length * v
            fold = 0.035 * math.sin(2.3 * y + 3.0 * u) * math.cos(5 * u) + 0.02 * math.sin(9 * u + 1.7 * y)
            over = max(0.0, -3.2 - y)  # how much hangs down
            height = 0.055 + fold * (1 - 0.4 * v) - max(0.0, over - 0.1)
            points.append((width * u + 0.05 * math.sin(1.1 * y), max(y, -3.3 - 0.03 * over), height))
    for j in range(rows - 1):
        first, next_row = j * columns, (j + 1) * columns
        faces += [(first + i, next_row + i, next_row + i + 1, first + i + 1) for i in range(columns - 1)]
    mesh = bpy.data.meshes.new("runner")
    mesh.from_pydata(points, [], faces)
    flat = mesh.uv_layers.new(name="UVMap")
    for loop in mesh.loops:
        j, i = divmod(loop.vertex_index, columns)
        flat.data[loop.index].uv = (i / (columns - 1) / 3.0, j / (rows - 1))
    cloth = finished(added("runner", mesh), shading.tartan())
    cloth.rotation_euler.z = 0.30
    cloth.location.x = -0.35


def suzanne() -> None:
    stand = finished(
        turned(
            "turntable",
            [(0, 0), (0.85, 0), (0.88, 0.03), (0.88, 0.1), (1.02, 0.13), (1.05, 0.16), (1.05, 0.22), (1.02, 0.25), (0, 0.25)],
            (-0.25, 0.2, 0.08),
        ),
        shading.lacquer("turntable", [(0.40, 0.20, 0.08), (0.10, 0.035, 0.012)], 12),
        smooth=False,
    )
    moving(stand, spin=(0, 0, 0.075))
    bpy.ops.mesh.primitive_monkey_add(size=2.25, location=(-0.25, 0.25, 1.30))
    head = bpy.context.object
    head.name = "suzanne"
    fine = head.modifiers.new("subsurf", "SUBSURF")
    fine.levels = fine.render_levels = 3
    finished(head, shading.porcelain())
    eyes, _, _ = shading.principled("eyes", Base_Color=(0.008, 0.02, 0.12, 1), Roughness=0.1, Coat_Weight=1.0)
    head.data.materials.append(eyes)
    for face in islands(head.data, smaller_than=60):
        head.data.polygons[face].material_index = 1
    head.rotation_euler = (-0.25, 0, 0.22)
    pose = head.rotation_euler.copy()
    for frame in (FIRST - 1, LAST + 1):  # turns with its stand, upright
        head.rotation_euler = (pose.x, pose.y, pose.z + 0.075 * (frame - 4.5))
        head.keyframe_insert("rotation_euler", frame=frame)


def armillary(at: Vector) -> None:
    """Brass rings about a small globe, each turning its own way."""
    metal = shading.brass()
    foot = [
        (0, 0),
        (0.46, 0),
        (0.48, 0.05),
        (0.40, 0.11),
        (0.16, 0.18),
        (0.075, 0.3),
        (0.12, 0.42),
        (0.06, 0.52),
        (0.06, 0.62),
        (0.0, 0.62),
    ]
    finished(turned("foot", rounded(foot), (at.x, at.y, 0.0)), metal)
    middle = at + Vector((0, 0, 1.45))
    for name, radius, tilt, spin in (
        ("meridian", 0.86, (1.45, 0.3, 0.4), (0, 0, 0)),
        ("equator", 0.76, (0.35, 0.2, 0), (0.10, 0.0, 0)),
        ("ecliptic", 0.66, (1.1, -0.6, 0.8), (-0.06, 0.11, 0)),
    ):
        moving(finished(ring(name, radius, 0.035, middle, tilt), metal), spin=spin)
    moving(finished(sphere("globe", 0.4, middle), shading.globe()), spin=(0, 0, -0.16))


def goblet(at: Vector) -> None:
    outside = [
        (0, 0),
        (0.48, 0.0),
        (0.5, 0.025),
        (0.3, 0.07),
        (0.08, 0.14),
        (0.055, 0.4),
        (0.06, 0.78),
        (0.2, 0.9),
        (0.46, 1.12),
        (0.58, 1.5),
        (0.52, 2.0),
    ]
    inside = [(0.5, 2.0), (0.555, 1.5), (0.43, 1.15), (0.19, 0.95), (0, 0.92)]
    clear = shading.glass("glass", (0.97, 0.99, 0.98))
    finished(turned("goblet", rounded(outside) + rounded(inside), at), clear)
    tea = [(0, 0.925), (0.188, 0.955), (0.428, 1.155), (0.535, 1.38), (0.535, 1.40), (0.0, 1.40)]
    finished(turned("drink", tea, at), shading.glass("drink", (0.92, 0.50, 0.12)))


def books() -> None:
    gold, _, _ = shading.principled("gilt", Metallic=1.0, Base_Color=(0.85, 0.62, 0.25, 1), Roughness=0.3)
    pages = shading.paper()
    height = 0.0
    for title, size, colour, turn in (
        ("MONTE CARLO", (2.5, 1.75, 0.42), (0.22, 0.025, 0.02), 0.10),
        ("LIGHT & GRAIN", (2.3, 1.6, 0.34), (0.03, 0.07, 0.16), -0.12),
        ("The Quiet Frame", (2.0, 1.45, 0.30), (0.34, 0.21, 0.06), 0.05),
    ):
        pivot = added(title, None, (-3.15, 1.55, height))
        pivot.rotation_euler.z = turn
        cover = shading.leather(title, colour)
        width, depth, thick = size
        for part, extent, at in (
            ("lower", (width, depth, 0.04), (0, 0, 0.02)),
            ("upper", (width, depth, 0.04), (0, 0, thick - 0.02)),
            ("spine", (width, 0.05, thick), (0, -depth / 2, thick / 2)),
        ):
            finished(box(part, extent, at, 0.015), cover, smooth=False).parent = pivot
        finished(box("pages", (width - 0.1, depth - 0.08, thick - 0.08), (0, 0.0, thick / 2), 0), pages, smooth=False).parent = pivot
        curve = bpy.data.curves.new(title, "FONT")
        curve.body, curve.size, curve.extrude, curve.align_x, curve.align_y = title, thick * 0.62, 0.004, "CENTER", "CENTER"
        letters = added(title + " letters", curve, (0, -depth / 2 - 0.027, thick / 2))
        letters.rotation_euler.x = math.pi / 2
        letters.parent = pivot
        curve.materials.append(gold)
        height += thick


def plant(at: Vector) -> None:
    """A vase with leaves on thin stems; the leaves sway."""
    body = [
        (0, 0),
        (0.36, 0.0),
        (0.40, 0.04),
        (0.52, 0.35),
        (0.46, 0.66),
        (0.24, 0.86),
        (0.22, 0.98),
        (0.29, 1.06),
        (0.25, 1.06),
        (0.19, 0.97),
        (0.2, 0.8),
    ]
    glaze = shading.lacquer("vase", [(0.62, 0.55, 0.42), (0.60, 0.50, 0.36), (0.30, 0.07, 0.03)], 9)
    finished(turned("vase", rounded(body), at), glaze)
    green = shading.leaf()
    r = random.Random(3)
    points, faces = [], []
    for i in range(9):
        t = i / 8
        for side in (-1, 0, 1):
            points.append((side * 0.17 * math.sin(math.pi * (0.06 + 0.94 * t)) ** 0.8, 0.62 * t, 0.05 * side * side - 0.16 * t * t))
    for i in range(8):
        faces += [(3 * i + s, 3 * i + s + 1, 3 * i + s + 4, 3 * i + s + 3) for s in (0, 1)]
    blade = bpy.data.meshes.new("leaf")
    blade.from_pydata(points, [], faces)
    for stem in range(7):
        angle, lean, tall = stem * 2.4 + r.uniform(-0.3, 0.3), r.uniform(0.25, 0.75), r.uniform(0.9, 1.5)
        curve = bpy.data.curves.new("stem", "CURVE")
        curve.dimensions, curve.bevel_depth = "3D", 0.014
        spline = curve.splines.new("POLY")
        spline.points.add(8)
        base = at + Vector((0, 0, 0.9))
        for k, point in enumerate(spline.points):
            t = k / 8
            away = lean * t * t * tall
            point.co = (*(base + Vector((away * math.cos(angle), away * math.sin(angle), tall * t))), 1)
            if k >= 3:
                one = finished(added("leaf", blade, point.co[:3]), green)
                one.rotation_euler = (r.uniform(-0.1, 0.7), r.uniform(-0.4, 0.4), angle - math.pi / 2 + (-1) ** k * r.uniform(0.5, 1.2))
                one.scale = [r.uniform(0.55, 0.95)] * 3
                moving(one, spin=(r.uniform(-0.02, 0.02), r.uniform(-0.02, 0.02), 0))
        curve.materials.append(green)
        bpy.context.scene.collection.objects.link(bpy.data.objects.new("stem", curve))


def lamp(at: Vector) -> None:
    foot = [(0, 0), (0.55, 0), (0.58, 0.06), (0.4, 0.14), (0.34, 0.4), (0.42, 0.8), (0.22, 1.15), (0.08, 1.3), (0.05, 1.9), (0, 1.9)]
    glaze, _, _ = shading.principled("lamp foot", Base_Color=(0.02, 0.10, 0.10, 1), Roughness=0.15, Coat_Weight=1.0)
    finished(turned("lamp foot", rounded(foot), at), glaze)
    shade = [(1.15, 1.75), (1.0, 2.3), (0.78, 3.05), (0.77, 3.05), (0.99, 2.3), (1.14, 1.75)]
    finished(turned("shade", shade, at), shading.linen())
    bulb = bpy.data.lights.new("bulb", "POINT")
    bulb.energy, bulb.color, bulb.shadow_soft_size = 540.0, (1.0, 0.62, 0.30), 0.16
    glow = bpy.data.objects.new("bulb", bulb)
    glow.location = at + Vector((0, 0, 2.3))
    bpy.context.scene.collection.objects.link(glow)


def window() -> None:
    """Cool daylight from the left through the bars of a window."""
    sky = bpy.data.lights.new("sky", "AREA")
    sky.shape, sky.size, sky.size_y = "RECTANGLE", 3.0, 3.6
    sky.energy, sky.color = 2300.0, (0.62, 0.78, 1.0)
    light = bpy.data.objects.new("sky", sky)
    light.location = (-9.0, -3.2, 5.2)
    aim = (Vector((0.2, 0.6, 0.6)) - light.location).to_track_quat("-Z", "Y")
    light.rotation_euler = aim.to_euler()
    bpy.context.scene.collection.objects.link(light)
    frame, _, _ = shading.principled("window frame", Base_Color=(0.5, 0.48, 0.45, 1))
    for name, size, offset in (
        ("bar", (0.28, 6, 0.1), (0, 0, -2.2)),
        ("bar", (6, 0.28, 0.1), (0, 0.4, -2.2)),
    ):
        bar = finished(box(name, size, light.location + aim @ Vector(offset), 0), frame, smooth=False)
        bar.rotation_euler = aim.to_euler()


def camera() -> None:
    """Tracks to the right and closes in, about three pixels a frame on the middle ground."""
    lens = bpy.data.cameras.new("camera")
    lens.lens = 52
    eye = bpy.data.objects.new("camera", lens)
    scene = bpy.context.scene
    scene.collection.objects.link(eye)
    scene.camera = eye
    eye.rotation_mode = "QUATERNION"
    for frame in range(FIRST - 1, LAST + 2):
        k = frame - 4.5
        eye.location = Vector((0.35 + 0.07 * k, -9.3 + 0.05 * k, 3.55 - 0.012 * k))
        eye.rotation_quaternion = (Vector((-0.05 + 0.02 * k, 0.6, 1.14)) - eye.location).to_track_quat("-Z", "Y")
        eye.keyframe_insert("location", frame=frame)
        eye.keyframe_insert("rotation_quaternion", frame=frame)


def build() -> bpy.types.Scene:
    """Empties Blender and builds the scene."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.context.preferences.edit.keyframe_new_interpolation_type = "LINEAR"
    scene = bpy.context.scene
    scene.name = "Still life"
    scene.frame_start, scene.frame_end = FIRST, LAST
    world = bpy.data.worlds.new("room")
    world.use_nodes = True
    world.node_tree.nodes["Background"].inputs["Color"].default_value = (0.35, 0.42, 0.6, 1)
    world.node_tree.nodes["Background"].inputs["Strength"].default_value = 0.045
    scene.world = world
    room()
    runner()
    suzanne()
    armillary(Vector((2.2, 0.75, 0.0)))
    goblet(Vector((-1.75, -0.85, 0.07)))
    books()
    plant(Vector((-3.1, 1.5, 1.06)))
    lamp(Vector((3.7, 2.9, 0.0)))
    window()
    top = [
        (0, 0),
        (0.03, 0.06),
        (0.12, 0.22),
        (0.42, 0.42),
        (0.46, 0.50),
        (0.40, 0.57),
        (0.1, 0.66),
        (0.055, 0.74),
        (0.05, 0.98),
        (0.0, 1.0),
    ]
    spinner = finished(
        turned("top", rounded(top), (1.35, -1.55, 0.0)),
        shading.lacquer("top", [(0.6, 0.05, 0.03), (0.75, 0.62, 0.40), (0.03, 0.16, 0.2)], 4),
    )
    spinner.rotation_euler = (0.10, 0.16, 0)
    moving(spinner, travel=(0.02, -0.012, 0), spin=(0, 0, 0.30))
    ball = finished(sphere("ball", 0.3, (-0.55, -1.75, 0.38)), shading.marble())
    ball.rotation_euler = (0, 0, 0)
    moving(ball, travel=(0.07, 0.0, 0), spin=(0, 0.07 / 0.3, 0))
    camera()
    return scene

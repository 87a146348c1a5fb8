"""Random Cycles shots for training a denoiser: one seed, one shot (bpy 5.0 and 5.2)."""

from __future__ import annotations

import math
import random
from typing import Any

import bmesh
import bpy
from mathutils import Vector

from training.shots.cycles import features
from training.shots.cycles.assets import Assets
from training.shots.cycles.built import Built
from training.shots.cycles.lights import environment, lamps
from training.shots.cycles.materials import material
from training.shots.cycles.meshes import mesh
from training.shots.cycles.motion import MIDDLE, animate, move_camera
from training.shots.cycles.volumes import haze

# Of Blender 5.2, on by default; a user may turn them off.
GUIDE_SWITCHES = ("denoising_pass_follow_reflections", "denoising_pass_use_albedo_roughness_weighting")


def room(r: random.Random, size: float, assets: Assets) -> None:
    """A box around the scene, most often with an opening."""
    bpy.ops.mesh.primitive_cube_add(size=1, location=(0, 0, size * 0.6))
    walls = bpy.context.object
    walls.scale = (size * 2.4, size * 2.4, size * 1.2)
    for _ in range(r.randint(2, 5)):
        walls.data.materials.append(material(r, 1.2, assets, emits=False))
    for face in walls.data.polygons:
        face.material_index = r.randrange(len(walls.data.materials))
    if r.random() < 0.6:
        edit = bmesh.new()
        edit.from_mesh(walls.data)
        edit.faces.ensure_lookup_table()
        side = r.choice([f for f in edit.faces if abs(f.normal.z) < 0.5 or f.normal.z > 0.5])
        bmesh.ops.inset_individual(edit, faces=[side], thickness=r.uniform(0.15, 0.4))
        bmesh.ops.delete(edit, geom=[side], context="FACES_ONLY")
        edit.to_mesh(walls.data)
        edit.free()


def ground(r: random.Random, kind: str, size: float, assets: Assets) -> None:
    bpy.ops.mesh.primitive_grid_add(x_subdivisions=80, y_subdivisions=80, size=size * r.choice([4, 8, 20]))
    thing = bpy.context.object
    thing.data.materials.append(material(r, 0.8, assets, emits=False))
    if kind == "outdoor" or r.random() < 0.2:
        hills = bpy.data.textures.new("t", r.choice(["CLOUDS", "MUSGRAVE", "VORONOI"]))
        hills.noise_scale = r.uniform(0.5, 2)
        displace = thing.modifiers.new("d", "DISPLACE")
        displace.texture = hills
        displace.strength = r.uniform(0.1, 0.8)


def things(r: random.Random, kind: str, size: float, assets: Assets) -> list[bpy.types.Object]:
    """The objects, scattered around the middle."""
    made = []
    for _ in range(r.randint(4, 10) if kind != "clutter" else r.randint(14, 26)):
        thing = mesh(r, assets)
        scale = r.uniform(0.25, 0.8) * (size / 3)
        thing.scale = [c * scale for c in thing.scale]
        angle, radius = r.uniform(0, 6.28), size * 0.75 * math.sqrt(r.random())
        height = scale * r.uniform(0.3, 1.1)
        if kind == "clutter" or r.random() < 0.2:
            height += r.random() * size * 0.5
        thing.location = (math.cos(angle) * radius, math.sin(angle) * radius, height)
        thing.rotation_mode = "XYZ"
        thing.rotation_euler = (r.uniform(-0.4, 0.4), r.uniform(-0.4, 0.4), r.uniform(0, 6.28))
        if hasattr(thing.data, "materials"):
            thing.data.materials.append(material(r, 1.5, assets))
        made.append(thing)
    return made


def camera(r: random.Random, scene: bpy.types.Scene, target: Vector, distance: float) -> tuple[bpy.types.Object, Vector]:
    """A camera that looks at the target, and the way from it to there; a quarter have depth of field."""
    lens = bpy.data.cameras.new("cam")
    eye = bpy.data.objects.new("cam", lens)
    scene.collection.objects.link(eye)
    scene.camera = eye
    lens.lens = r.uniform(24, 80)
    around, up = r.uniform(0, 2 * math.pi), r.uniform(0.08, 1.1)
    ray = Vector((math.cos(around) * math.cos(up), math.sin(around) * math.cos(up), math.sin(up)))
    position = target + ray * distance * lens.lens / 42
    way = target - position
    eye.rotation_mode = "QUATERNION"
    eye.location = position
    eye.rotation_quaternion = way.to_track_quat("-Z", "Y")
    if r.random() < 0.25:
        lens.dof.use_dof = True
        lens.dof.focus_distance = way.length * r.uniform(0.7, 1.3)
        lens.dof.aperture_fstop = math.exp(r.uniform(-1.2, 1.5))
    return eye, way


def settings(r: random.Random, scene: bpy.types.Scene) -> None:
    """Cycles, the passes a denoiser wants, and a plain float EXR."""
    cycles = scene.cycles
    cycles.use_denoising = False
    cycles.max_bounces = r.choice([4, 6, 12])
    cycles.sample_clamp_indirect = r.choice([10, 10, 0])
    cycles.caustics_reflective = cycles.caustics_refractive = r.random() < 0.5
    cycles.blur_glossy = 1.0
    scene.render.film_transparent = False
    layer = scene.view_layers[0]
    layer.cycles.denoising_store_passes = True
    layer.use_pass_vector = True
    layer.use_pass_z = True
    for name in GUIDE_SWITCHES:
        if hasattr(layer.cycles, name):
            setattr(layer.cycles, name, r.random() < 0.8)
    image = scene.render.image_settings
    if hasattr(image, "media_type"):  # Blender 5; it resets the rest, so it comes first
        image.media_type = "MULTI_LAYER_IMAGE"
    image.file_format = "OPEN_EXR_MULTILAYER"
    image.color_depth = "32"
    image.exr_codec = "NONE"
    scene.render.use_persistent_data = True


def build(seed: int, assets: Assets, pixels: int = 128) -> tuple[random.Random, dict[str, Any]]:
    """Empties Blender and builds the seed's shot for a frame that is so wide. Returns the generator for further draws, and what the
    shot is: `kind` of scene, camera's `motion`, `features`, `film_transparent`."""
    r = random.Random(seed)
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.context.preferences.edit.keyframe_new_interpolation_type = "LINEAR"
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.frame_set(MIDDLE)
    wanted = features.drawn(r)
    kind = r.choices(["studio", "room", "outdoor", "clutter"], [0.3, 0.0 if features.OUTDOORS.intersection(wanted) else 0.3, 0.2, 0.2])[0]
    size, background = environment(r, scene, kind, assets)
    if kind == "room":
        room(r, size, assets)
    elif "film" not in wanted or r.random() < 0.2:
        ground(r, kind, size, assets)
    made = things(r, kind, size, assets)
    lights = lamps(r, scene, kind, size, background)
    haze(r, size)
    target = Vector((r.gauss(0, size * 0.2), r.gauss(0, size * 0.2), size * r.uniform(0.1, 0.4)))
    eye, way = camera(r, scene, target, size * (r.uniform(0.5, 1.0) if kind == "room" else r.uniform(0.7, 1.6)))
    if kind == "room":  # stay inside
        limit = size * 1.12
        eye.location = [max(-limit, min(limit, c)) for c in eye.location]
        eye.location.z = max(0.1 * size, min(size * 1.1, eye.location.z))
        eye.rotation_quaternion = (target - eye.location).to_track_quat("-Z", "Y")
    distance = (target - eye.location).length
    step = distance * 36 / eye.data.lens / pixels
    settings(r, scene)
    features.add(Built(r, scene, kind, size, assets, made, lights, distance, step), wanted)
    motion = move_camera(r, eye, way, step)
    if r.random() < 0.65 or motion == "static":
        for thing in r.sample(made, min(len(made), r.randint(1, 5))):
            animate(thing, [r.gauss(0, 1) * step * 2.5 for _ in range(3)], [r.gauss(0, 0.04) for _ in range(3)])
    if lights and r.random() < 0.1:
        animate(r.choice(lights), [r.gauss(0, 1) * step * 3 for _ in range(3)], [0, 0, 0])
    return r, {"kind": kind, "motion": motion, "features": wanted, "film_transparent": "film" in wanted}

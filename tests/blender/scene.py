"""A tiny Cycles scene for tests: a moving, turning cube and a moving camera over a plane. 96 × 54, 4 samples, 5 frames."""

from __future__ import annotations

from pathlib import Path

import bpy

LAST = 5


def build(kind: str = "plain") -> bpy.types.Scene:
    """Replaces what is in the open file. Kinds as in `kit.shot`."""
    if kind not in ("plain", "bare", "blur", "clean"):
        raise ValueError(kind)
    bpy.ops.wm.read_homefile(use_empty=True)
    scene = bpy.context.scene
    _contents(scene)
    render, cycles = scene.render, scene.cycles
    render.engine = "CYCLES"
    render.resolution_x, render.resolution_y, render.resolution_percentage = 96, 54, 100
    render.threads_mode, render.threads = "FIXED", 2
    render.use_motion_blur = kind == "blur"
    scene.frame_start, scene.frame_end = 1, LAST
    cycles.device = "CPU"
    cycles.samples, cycles.use_adaptive_sampling = 256 if kind == "clean" else 4, False
    cycles.max_bounces = 2
    cycles.use_denoising = False
    cycles.use_animated_seed = True
    layer = scene.view_layers[0]
    if kind != "bare":
        layer.cycles.denoising_store_passes = True
        layer.use_pass_vector = layer.use_pass_z = layer.use_pass_position = True
    if kind == "blur":
        vectors = scene.view_layers.new("Vectors")
        vectors.use_motion_blur = False
        vectors.samples = 1
        vectors.use_pass_vector = True
    settings = render.image_settings
    if hasattr(settings, "media_type"):
        settings.media_type = "MULTI_LAYER_IMAGE"
    settings.file_format = "OPEN_EXR_MULTILAYER"
    settings.color_depth, settings.exr_codec = "32", "ZIP"
    return scene


def _contents(scene: bpy.types.Scene) -> None:
    bpy.ops.mesh.primitive_plane_add(size=20)
    bpy.context.object.name = "Ground"
    bpy.ops.mesh.primitive_cube_add(size=1.5)
    cube = bpy.context.object
    cube.name = "Cube"
    material = bpy.data.materials.new("Red")
    material.use_nodes = True
    material.node_tree.nodes["Principled BSDF"].inputs["Base Color"].default_value = (0.8, 0.1, 0.1, 1)
    cube.data.materials.append(material)
    bpy.ops.object.light_add(type="AREA", location=(3, -3, 5))
    light = bpy.context.object
    light.data.energy, light.data.size = 400, 2
    bpy.ops.object.camera_add(location=(0, -7, 4), rotation=(1.05, 0, 0))
    camera = bpy.context.object
    scene.camera = camera
    for frame in range(-1, LAST + 3):
        cube.location = (-1 + 0.3 * frame, 0.1 * frame, 0.9 + 0.02 * frame * frame)
        cube.rotation_euler = (0.05 * frame, 0.08 * frame, 0.15 * frame)
        camera.location.x = 0.15 * frame
        camera.rotation_euler = (1.05, 0.01 * frame, -0.03 * frame)
        for thing in (cube, camera):
            thing.keyframe_insert("location", frame=frame)
            thing.keyframe_insert("rotation_euler", frame=frame)
    scene.frame_set(1)


def render(kind: str, folder: str) -> None:
    """Renders all frames to `folder`/frame_0001.exr …"""
    scene = build(kind)
    scene.render.filepath = str(Path(folder) / "frame_####")
    bpy.ops.render.render(animation=True)

# SPDX-FileCopyrightText: 2026 Hush authors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Prepare Shot: the render settings that Hush wants. Each change is remembered in the scene (`record.py`) so that it can be undone."""

import re
from collections.abc import Callable

import bpy

from . import compat, messages
from .messages import Refusal
from .record import Record, undo
from .scene_operator import SceneOperator

VECTOR_LAYER = "Hush Vectors"
LOSSLESS = {"NONE", "RLE", "ZIPS", "ZIP", "PIZ"}
# In the order in which Blender lets them be set: the file format decides which depths there are.
_IMAGE_SETTINGS = ("media_type", "file_format", "color_mode", "color_depth", "exr_codec", "use_exr_interleave", "quality", "compression")
# What a view layer shows, and so where its motion vectors come from.
_LAYER_FLAGS = ("material_override", "world_override", "use_solid", "use_sky", "use_strand", "use_volumes", "pass_alpha_threshold")
_COLLECTION_FLAGS = ("exclude", "holdout", "indirect_only", "hide_viewport")
# What each view layer of Blender 5.2 can turn off in Denoising Data, property and label, by the step that turns it on again.
GUIDE_SWITCHES = {
    "follow_reflections": ("denoising_pass_follow_reflections", "Follow Reflections"),
    "albedo_weighting": ("denoising_pass_use_albedo_roughness_weighting", "Albedo Roughness Weighting"),
}


def rendered_layers(scene: bpy.types.Scene) -> list[bpy.types.ViewLayer]:
    """The view layers that are rendered, without those that are there for their motion vectors only."""
    used = [layer for layer in scene.view_layers if layer.use]
    shown = [layer for layer in used if layer.name not in (vector_layer(scene), Record(scene).vector_layer)]
    return shown or used


def vector_layer(scene: bpy.types.Scene) -> str:
    """The view layer that the scene takes its motion vectors from, empty where each has its own."""
    name = scene.hush.vector_layer or Record(scene).vector_layer or ""
    return name if name in scene.view_layers else ""


def blurred_layers(scene: bpy.types.Scene) -> list[bpy.types.ViewLayer]:
    """The rendered view layers whose Vector pass will be empty, as they have motion blur."""
    return [layer for layer in rendered_layers(scene) if scene.render.use_motion_blur and layer.use_motion_blur]


def missing_passes(layer: bpy.types.ViewLayer) -> list[str]:
    """Names of the passes that Hush wants and the view layer does not write."""
    wanted = {"Denoising Data": layer.cycles.denoising_store_passes, "Vector": layer.use_pass_vector, "Depth": layer.use_pass_z}
    return [name for name, on in wanted.items() if not on]


def layers_without(scene: bpy.types.Scene, switch: str) -> list[bpy.types.ViewLayer]:
    """The rendered view layers that have one of the `GUIDE_SWITCHES` turned off; none where Blender has no such switch."""
    name, _ = GUIDE_SWITCHES[switch]
    return [layer for layer in rendered_layers(scene) if not getattr(layer.cycles, name, True)]


def seed_is_animated(scene: bpy.types.Scene) -> bool:
    """Whether every frame has other noise."""
    animation = scene.animation_data
    drivers = animation.drivers if animation else []
    moving = any(curve.data_path == "cycles.seed" for curve in (*compat.fcurves(scene), *drivers))
    return scene.cycles.use_animated_seed or moving


def lacks_extension(scene: bpy.types.Scene) -> bool:
    """Whether rendered frames have no .exr at their end, by which they are found."""
    name = re.split(r"[\\/]", scene.render.filepath)[-1].lower()
    return not scene.render.use_file_extension and not ("#" in name and name.endswith(".exr"))


def _engine(scene: bpy.types.Scene, record: Record) -> list[str]:
    return [messages.text("set_engine")] if record.set(("render",), "engine", "CYCLES") else []


def _camera(scene: bpy.types.Scene, record: Record) -> list[str]:
    cameras = [thing for thing in scene.objects if thing.type == "CAMERA"]
    if scene.camera is not None or not cameras:
        return []
    scene.camera = cameras[0]
    return [messages.text("set_camera", camera=cameras[0].name)]


def _passes(scene: bpy.types.Scene, record: Record) -> list[str]:
    changes = []
    for layer in rendered_layers(scene):
        missing = missing_passes(layer)
        path = ("view_layers", layer.name)
        record.set((*path, "cycles"), "denoising_store_passes", True)
        record.set(path, "use_pass_vector", True)
        record.set(path, "use_pass_z", True)
        if missing:
            changes.append(messages.text("set_passes", layer=layer.name, passes=", ".join(missing)))
    return changes


def _guide_switch(switch: str) -> Callable[[bpy.types.Scene, Record], list[str]]:
    """The step that turns one of the `GUIDE_SWITCHES` on."""

    def step(scene: bpy.types.Scene, record: Record) -> list[str]:
        name, label = GUIDE_SWITCHES[switch]
        layers = layers_without(scene, switch)
        for layer in layers:
            record.set(("view_layers", layer.name, "cycles"), name, True)
        return [messages.text("set_guide_switch", layer=layer.name, switch=label) for layer in layers]

    return step


def _seed(scene: bpy.types.Scene, record: Record) -> list[str]:
    if seed_is_animated(scene):
        return []
    record.set(("cycles",), "use_animated_seed", True)
    return [messages.text("set_seed")]


def _denoising(scene: bpy.types.Scene, record: Record) -> list[str]:
    return [messages.text("set_denoising")] if record.set(("cycles",), "use_denoising", False) else []


def _format(scene: bpy.types.Scene, record: Record) -> list[str]:
    changes = []
    with record.watching(("render", "image_settings"), _IMAGE_SETTINGS) as settings:
        depth = settings.color_depth
        if not compat.is_multilayer(settings):
            compat.use_multilayer(settings)
            settings.exr_codec = "ZIP"
            changes.append(messages.text("set_format"))
        elif settings.exr_codec not in LOSSLESS:
            settings.exr_codec = "ZIP"
            changes.append(messages.text("set_codec"))
        settings.color_depth = "32"
        if depth != "32":
            changes.append(messages.text("set_depth"))
    return changes


def _motion_blur(scene: bpy.types.Scene, record: Record) -> list[str]:
    blurred = blurred_layers(scene)
    if not blurred or vector_layer(scene):
        return []
    changes = []
    fitting = [layer.name for layer in scene.view_layers if layer.use and not layer.use_motion_blur and layer.use_pass_vector]
    name = fitting[0] if fitting else ""
    if not name:
        name = record.vector_layer = _add_vector_layer(scene, blurred)
        changes.append(messages.text("set_vector_layer", layer=name))
        changes += _layer_samples(scene, record, name)
    record.set(("hush",), "vector_layer", name)
    changes.append(messages.text("set_vectors_from", layer=name))
    return changes + _single_layer(scene, record)


def _layer_samples(scene: bpy.types.Scene, record: Record, name: str) -> list[str]:
    """Has Cycles heed the one sample of a view layer, and that only, where it ignores what layers say."""
    if scene.cycles.use_layer_samples != "IGNORE":
        return []
    for layer in scene.view_layers:
        if layer.name != name:
            record.set(("view_layers", layer.name), "samples", 0)
    record.set(("cycles",), "use_layer_samples", "USE")
    return [messages.text("set_layer_samples")]


def _add_vector_layer(scene: bpy.types.Scene, blurred: list[bpy.types.ViewLayer]) -> str:
    layer = scene.view_layers.new(VECTOR_LAYER)
    layer.use_motion_blur = False
    layer.samples = 1
    layer.use_pass_vector = True
    layer.use_freestyle = False
    for flag in _LAYER_FLAGS:
        if hasattr(layer, flag):
            setattr(layer, flag, getattr(blurred[0], flag))
    _show_the_same(layer.layer_collection, [other.layer_collection for other in blurred])
    return layer.name


def _show_the_same(target: bpy.types.LayerCollection, sources: list[bpy.types.LayerCollection]) -> None:
    """Gives a view layer's collections the visibility that they have in the others; what one of them shows is shown."""
    for child in target.children:
        same = [source.children[child.name] for source in sources if child.name in source.children]
        shown = [source for source in same if not source.exclude] or same
        for flag in _COLLECTION_FLAGS if shown else ():
            setattr(child, flag, getattr(shown[0], flag))
        _show_the_same(child, same)


def _overwrite(scene: bpy.types.Scene, record: Record) -> list[str]:
    return [messages.text("set_overwrite")] if record.set(("render",), "use_overwrite", True) else []


def _placeholders(scene: bpy.types.Scene, record: Record) -> list[str]:
    return [messages.text("set_placeholders")] if record.set(("render",), "use_placeholder", False) else []


def _file_extension(scene: bpy.types.Scene, record: Record) -> list[str]:
    if not lacks_extension(scene):
        return []
    record.set(("render",), "use_file_extension", True)
    return [messages.text("set_file_extension")]


def _sequencer(scene: bpy.types.Scene, record: Record) -> list[str]:
    return [messages.text("set_sequencer")] if record.set(("render",), "use_sequencer", False) else []


def _single_layer(scene: bpy.types.Scene, record: Record) -> list[str]:
    return [messages.text("set_single_layer")] if record.set(("render",), "use_single_layer", False) else []


def _vector_pass(scene: bpy.types.Scene, record: Record) -> list[str]:
    name = vector_layer(scene)
    wanted = {"use": True, "use_pass_vector": True, "use_motion_blur": False}
    changed = [record.set(("view_layers", name), flag, value) for flag, value in wanted.items() if name]
    return [messages.text("set_vector_pass", layer=name)] if any(changed) else []


def _frame_step(scene: bpy.types.Scene, record: Record) -> list[str]:
    return [messages.text("set_frame_step")] if record.set((), "frame_step", 1) else []


STEPS: dict[str, Callable[[bpy.types.Scene, Record], list[str]]] = {
    "engine": _engine,
    "camera": _camera,
    "passes": _passes,
    **{switch: _guide_switch(switch) for switch in GUIDE_SWITCHES},
    "seed": _seed,
    "denoising": _denoising,
    "format": _format,
    "file_extension": _file_extension,
    "motion_blur": _motion_blur,
    "single_layer": _single_layer,
    "vector_pass": _vector_pass,
    "overwrite": _overwrite,
    "placeholders": _placeholders,
    "sequencer": _sequencer,
    "frame_step": _frame_step,
}
PREPARE = ("passes", *GUIDE_SWITCHES, "seed", "denoising", "format", "file_extension", "motion_blur")


def apply(
    scene: bpy.types.Scene, steps: tuple[str, ...] = PREPARE, *, check: Callable[[bpy.types.Scene], object] = lambda _: None
) -> list[str]:
    """Does the steps and returns each change in words. `check` looks at the scene then: where it refuses, all is put back.

    Raises:
        Refusal: The scene is not rendered with Cycles, or cannot be changed, or is refused by `check`.
    """
    if scene.library is not None:
        raise Refusal(messages.text("prepare_linked", scene=scene.name))
    if scene.render.engine != "CYCLES" and "engine" not in steps:
        raise Refusal(messages.text("prepare_engine", scene=scene.name, engine=compat.label(scene.render, "engine")))
    record = Record(scene)
    try:
        changes = [text for step in steps for text in STEPS[step](scene, record)]
    finally:
        record.save()
    try:
        check(scene)
    except Refusal:
        record.take_back()
        raise
    return changes


class HUSH_OT_prepare_shot(SceneOperator, bpy.types.Operator):
    """Turn on what Hush needs to denoise well: passes, animated seed, multilayer EXR; and Cycles' own denoising off"""

    bl_idname = "hush.prepare_shot"
    bl_label = "Prepare Shot"
    bl_options = {"REGISTER", "UNDO"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Prepares the scene."""
        scene = self.scene_of(context)
        if scene is None:
            return {"CANCELLED"}
        try:
            changes = apply(scene)
        except Refusal as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        self.report({"INFO"}, messages.text("prepared", changes="; ".join(changes)) if changes else messages.text("prepared_already"))
        return {"FINISHED"}


class HUSH_OT_undo_prepare(SceneOperator, bpy.types.Operator):
    """Put every setting that Prepare Shot changed back to what it was"""

    bl_idname = "hush.undo_prepare"
    bl_label = "Undo Prepare"
    bl_options = {"REGISTER", "UNDO"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Puts the scene back."""
        scene = self.scene_of(context)
        if scene is None:
            return {"CANCELLED"}
        if not scene.hush.prepared:
            self.report({"WARNING"}, messages.text("nothing_prepared", scene=scene.name))
            return {"CANCELLED"}
        left = undo(scene)
        for text in left:
            self.report({"WARNING"}, text)
        self.report({"INFO"}, messages.text("unprepared_else" if left else "unprepared"))
        return {"FINISHED"}


register, unregister = bpy.utils.register_classes_factory((HUSH_OT_prepare_shot, HUSH_OT_undo_prepare))

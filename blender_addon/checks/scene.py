# SPDX-FileCopyrightText: 2026 Hush authors
# SPDX-License-Identifier: GPL-3.0-or-later
"""What Check Shot finds in the settings of a scene, without a look at the disk."""

from collections.abc import Iterator

import bpy

from .. import compat, messages, prepare, shot
from ..messages import Refusal
from ..nodes import flow, node
from ..settings import SETTINGS
from .problem import ERROR, INFO, Problem, problem


def scene_problems(scene: bpy.types.Scene) -> Iterator[Problem]:
    """All that is not right with a scene's settings."""
    name, render = scene.name, scene.render
    if scene.library is not None:
        yield problem("linked", "linked", ERROR, file=scene.library.filepath)
    if render.engine != "CYCLES":
        yield problem("engine", "engine", ERROR, fix_in=name, engine=compat.label(render, "engine"))
    if not shot.has_camera(scene):
        if any(thing.type == "CAMERA" for thing in scene.objects):
            yield problem("camera", "camera_inactive", ERROR, fix_in=name)
        else:
            yield problem("camera", "camera", ERROR)
    if not bpy.data.is_saved and shot.is_relative(scene):
        yield problem("save", "save", ERROR, fix_in=name)
    if not any(layer.use for layer in scene.view_layers):
        yield problem("layers", "no_layers", ERROR)
    if render.engine == "CYCLES":
        yield from _cycles_problems(scene)
    yield from _output_problems(scene)
    yield from _stereo_problems(scene)
    yield from _lambda_problems(scene)
    yield from _lambda_mask_problems(scene)
    yield from _node_problems(scene)
    yield from _problems_with_others(scene)


def to_set_before_rendering(scene: bpy.types.Scene) -> list[str]:
    """Why frames that are rendered as the scene is set would not be found, in words."""
    keys = ("engine", "format", "file_extension")
    return [each.text for each in scene_problems(scene) if each.level == ERROR and each.key in keys]


def _cycles_problems(scene: bpy.types.Scene) -> Iterator[Problem]:
    name = scene.name
    for layer in prepare.rendered_layers(scene):
        missing = prepare.missing_passes(layer)
        if missing:
            yield problem("passes", "passes", fix_in=name, layer=layer.name, passes=messages.listed(missing))
    for switch in prepare.GUIDE_SWITCHES:
        for layer in prepare.layers_without(scene, switch):
            yield problem(switch, switch, fix_in=name, layer=layer.name)
    if not prepare.seed_is_animated(scene):
        yield problem("seed", "seed", fix_in=name)
    if scene.cycles.use_denoising:
        yield problem("denoising", "denoising", fix_in=name)
    blurred = prepare.blurred_layers(scene)
    if blurred and not prepare.vector_layer(scene):
        yield problem("motion_blur", "motion_blur", fix_in=name, layers=", ".join(layer.name for layer in blurred))
    elif len(blurred) > 1:
        yield problem("vector_layers", "vector_layers", INFO)
    source = scene.view_layers.get(prepare.vector_layer(scene))
    if source is None and scene.render.use_single_layer and len(prepare.rendered_layers(scene)) > 1:
        yield problem("single_layer", "single_layer_of_several", fix_in=name)
    elif source is not None and scene.render.use_single_layer:
        yield problem("single_layer", "single_layer", fix_in=name, layer=source.name)
    elif source is not None and not (source.use and source.use_pass_vector):
        yield problem("vector_pass", "vector_pass", fix_in=name, layer=source.name)
    elif source is not None and scene.render.use_motion_blur and source.use_motion_blur:
        yield problem("vector_pass", "vector_blur", fix_in=name, layer=source.name)


def _output_problems(scene: bpy.types.Scene) -> Iterator[Problem]:
    name, render, settings = scene.name, scene.render, scene.render.image_settings
    # Frames in a folder of their own come from elsewhere, such as a File Output node.
    if not scene.hush.input_folder:
        if not compat.is_multilayer(settings):
            yield problem("format", "format", ERROR, fix_in=name, format=compat.label(settings, "file_format"))
        elif settings.exr_codec not in prepare.LOSSLESS:
            yield problem("format", "lossy_codec", fix_in=name, codec=settings.exr_codec)
        elif settings.color_depth != "32":
            yield problem("format", "half", fix_in=name)
        if prepare.lacks_extension(scene):
            yield problem("file_extension", "file_extension", ERROR, fix_in=name)
        if compat.TEMPLATES and "{camera_name}" in render.filepath and shot.changes_camera(scene):
            yield problem("path", "path_camera", ERROR)
    if not render.use_overwrite:
        yield problem("overwrite", "overwrite_off", INFO, fix_in=name)
    if render.use_placeholder:
        yield problem("placeholders", "placeholders", INFO, fix_in=name)
    if render.use_sequencer and compat.sequencer_is_rendered(scene):
        yield problem("sequencer", "sequencer", fix_in=name)
    if scene.frame_step > 1:
        yield problem("frame_step", "frame_step", fix_in=name, step=scene.frame_step)


def _stereo_problems(scene: bpy.types.Scene) -> Iterator[Problem]:
    if scene.render.use_multiview and shot.views(scene) == [""] and not compat.READS_VIEWS_OF_ONE_FILE:
        yield problem("stereo", "stereo_one_file")


def _lambda_problems(scene: bpy.types.Scene) -> Iterator[Problem]:
    source = shot.lambda_source(scene)
    if source in ("driver", "nla"):
        yield problem("lambda", "lambda_driven", what="a driver" if source == "driver" else "NLA strips", value=scene.hush.lam)
    low, high = SETTINGS["lambda"].least, SETTINGS["lambda"].most
    curves = [curve for curve in compat.fcurves(scene) if curve.data_path == "hush.lam" and not curve.mute]
    for curve in curves if source == "keys" else ():
        outside = [frame for frame in shot.frame_range(scene) if not low <= round(curve.evaluate(frame), 4) <= high]
        if outside:
            yield problem("lambda", "lambda_outside", value=curve.evaluate(outside[0]), frame=outside[0], low=low, high=high)


def _lambda_mask_problems(scene: bpy.types.Scene) -> Iterator[Problem]:
    name = scene.hush.lambda_pass.strip()
    if name and scene.hush.lambda_images.strip():
        yield problem("lambda_mask", "lambda_mask_both", INFO, name=name)
    elif name and scene.render.engine == "CYCLES" and not scene.hush.input_folder:
        aovs = {layer: {aov.name for aov in scene.view_layers[layer].aovs} for layer in shot.layers(scene)}
        if not any(name in there for there in aovs.values()):
            yield problem("lambda_mask", "lambda_mask_missing", ERROR, layer=messages.listed(aovs), name=name)


def _node_problems(scene: bpy.types.Scene) -> Iterator[Problem]:
    for message, name in node.faults(scene):
        yield problem("node", message, fix_in=scene.name, node=name)
    yield from composite_problems(scene)
    layers = flow.lost_layers(scene)
    if layers:
        yield problem("noisy_image", "noisy_image", fix_in=scene.name, layers=messages.listed(layers))


def composite_problems(scene: bpy.types.Scene) -> Iterator[Problem]:
    """What is denoised twice in a composite of the denoised frames, and what stays noisy."""
    for name in flow.denoised_again(scene):
        yield problem("denoised_again", "denoised_again", node=name)
    layers = flow.past_layers(scene)
    if layers:
        yield problem("past_node", "past_node", layers=messages.listed(layers))


def _problems_with_others(scene: bpy.types.Scene) -> Iterator[Problem]:
    """Other scenes that render to the same files; linked ones are rendered where they are at home."""
    own = _rendered_files(scene)
    for other in bpy.data.scenes:
        same = own & _rendered_files(other) if other != scene and other.library is None else set()
        if same:
            yield problem("same_files", "same_files", ERROR, one=scene.name, other=other.name, path=min(same))


def _rendered_files(scene: bpy.types.Scene) -> set[str]:
    """The patterns that a scene's frames are rendered to; none where it renders nothing itself."""
    if scene.hush.input_folder or not shot.has_camera(scene) or not compat.is_multilayer(scene.render.image_settings):
        return set()
    try:
        return {str(pattern) for pattern in shot.frame_patterns(scene)}
    except Refusal:
        return set()

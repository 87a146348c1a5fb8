# SPDX-FileCopyrightText: 2026 Hush authors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The settings of a shot, kept in the scene as `scene.hush`, and of a node, kept in its tree as `tree.hush`.

None has an update callback: after one was unregistered, Blender 4.2 as a Python module crashes at its end. `handlers.py` hears of changes.
"""

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, PointerProperty, StringProperty

from . import compat
from .settings import SETTINGS


def _description(setting: str, more: str = "") -> str:
    """What a setting does, without what only the command line can do with it."""
    return SETTINGS[setting].help.partition(";")[0] + more


WINDOWS = (
    ("AUTO", "Automatic", "Two frames on each side where the frames have motion vectors, else none"),
    ("0", "This Frame Only", "Each frame is denoised for itself; more flicker"),
    *((str(n), f"{n} Frame{'s' * (n > 1)}", f"Frames on each side that help: {n}") for n in range(1, int(SETTINGS["window"].most) + 1)),
)

COMPOSITE_FORMATS = (
    ("OPEN_EXR", "OpenEXR", "Half float, scene linear; for further work"),
    ("PNG", "PNG", "16 bit, with the view transform; for looking at"),
)


def _folder(name: str, description: str) -> StringProperty:
    return StringProperty(name=name, description=description, subtype="DIR_PATH", options=compat.RELATIVE_PATH)


class HushShot(bpy.types.PropertyGroup):
    """How a scene's frames are denoised."""

    lam: FloatProperty(
        name="λ Noise to Keep",
        description=_description("lambda", ". Can be keyframed. After a change press Denoise Shot again"),
        default=SETTINGS["lambda"].default,
        min=SETTINGS["lambda"].least,
        max=SETTINGS["lambda"].most,
        step=10,
        precision=2,
    )
    lambda_pass: StringProperty(
        name="λ Mask AOV",
        description="Shader AOV that is the mask: at 0 λ Noise to Keep holds, at 1 λ in the Mask. Empty: λ Noise to Keep holds everywhere",
        options=set(),
    )
    lambda_images: StringProperty(
        name="λ Mask Images",
        description="Images that are the mask, in place of an AOV, with # for the frame's number: //masks/mask_####.exr",
        subtype="FILE_PATH",
        options=compat.RELATIVE_PATH,
    )
    lambda_masked: FloatProperty(
        name="λ in the Mask",
        description="Noise to keep where the mask is 1; λ Noise to Keep holds where it is 0",
        default=SETTINGS["lambda_masked"].default,
        min=SETTINGS["lambda_masked"].least,
        max=SETTINGS["lambda_masked"].most,
        step=10,
        precision=2,
        options=set(),
    )
    window: EnumProperty(
        name="Window",
        description=_description("window", ". They need motion vectors"),
        items=WINDOWS,
        default="AUTO",
        options=set(),
    )
    input_folder: _folder("Rendered Frames", "Folder of the noisy frames. Empty: where the scene renders to")
    output_folder: _folder("Denoised Frames", _description("output", ". Empty: a folder named denoised beside the noisy frames"))
    composite_folder: _folder(
        "Composited Frames", "Folder for the frames of Composite Denoised. Empty: a folder named composited beside the noisy frames"
    )
    composite_format: EnumProperty(
        name="Format",
        description="File format of the composited frames",
        items=COMPOSITE_FORMATS,
        default="OPEN_EXR",
        options=set(),
    )
    use_light_passes: BoolProperty(
        name="Light Passes",
        description="Denoise the light passes and light groups too, so that they still add up to the image",
        default=False,
        options=set(),
    )
    keep_noisy: BoolProperty(
        name="Keep Noisy Image",
        description=_description("keep_noisy"),
        default=SETTINGS["keep_noisy"].default,
        options=set(),
    )
    second_pass: BoolProperty(
        name="Second Pass",
        description=_description("second_pass"),
        default=SETTINGS["second_pass"].default,
        options=set(),
    )
    vector_layer: StringProperty(
        name="Vectors From",
        description=_description("vector_layer", ". Empty: the one that Prepare Shot made, else each layer's own"),
        options=set(),
    )
    prepared: StringProperty(
        name="Prepared",
        description="What Prepare Shot changed, so that it can be undone",
        options={"HIDDEN"},
    )


class HushNode(bpy.types.PropertyGroup):
    """What a Temporal Denoise node shows."""

    scene: PointerProperty(
        type=bpy.types.Scene,
        name="Scene",
        description="Scene whose denoised frames to show. Empty: the scene that is composited",
        options=set(),
    )
    view_layer: StringProperty(
        name="View Layer",
        description="View layer to show. Empty: the first one that is rendered",
        options=set(),
    )


def register() -> None:
    """Adds `scene.hush` and `tree.hush`."""
    for cls, owner in _OWNERS:
        bpy.utils.register_class(cls)
        owner.hush = PointerProperty(type=cls)


def unregister() -> None:
    """Takes them away; their values stay in the .blend."""
    for cls, owner in reversed(_OWNERS):
        del owner.hush
        bpy.utils.unregister_class(cls)


_OWNERS = ((HushShot, bpy.types.Scene), (HushNode, bpy.types.NodeTree))

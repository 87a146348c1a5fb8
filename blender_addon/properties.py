# SPDX-FileCopyrightText: 2026 Hush authors
# SPDX-License-Identifier: Apache-2.0
"""The settings of a shot, kept in the scene as `scene.hush`, and of a node, kept in its tree as `tree.hush`.

None has an update callback: after one was unregistered, Blender 4.2 as a Python module crashes at its end. `handlers.py` hears of changes.
"""

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, PointerProperty, StringProperty

WINDOWS = (
    ("AUTO", "Automatic", "Two frames on each side where the frames have motion vectors, else none"),
    ("0", "This Frame Only", "Each frame is denoised for itself; more flicker"),
    ("1", "1 Frame", "One frame on each side helps"),
    ("2", "2 Frames", "Two frames on each side help"),
    ("3", "3 Frames", "Three frames on each side help; slower, wants more memory"),
)

COMPOSITE_FORMATS = (
    ("OPEN_EXR", "OpenEXR", "Half float, scene linear; for further work"),
    ("PNG", "PNG", "16 bit, with the view transform; for looking at"),
)


class HushShot(bpy.types.PropertyGroup):
    """How a scene's frames are denoised."""

    lam: FloatProperty(
        name="λ Noise to Keep",
        description=(
            "1 is cleanest. Higher keeps more of the render's grain, and the fine detail hidden in it. "
            "Can be keyframed. After a change press Denoise Shot again"
        ),
        default=1.0,
        min=1.0,
        max=64.0,
        step=10,
        precision=2,
    )
    window: EnumProperty(
        name="Window",
        description="How many frames before and after each frame help to denoise it. They need motion vectors",
        items=WINDOWS,
        default="AUTO",
        options=set(),
    )
    input_folder: StringProperty(
        name="Rendered Frames",
        description="Folder of the noisy frames. Empty: where the scene renders to",
        subtype="DIR_PATH",
        options=set(),
    )
    output_folder: StringProperty(
        name="Denoised Frames",
        description="Folder for the denoised frames. Empty: a folder named denoised beside the noisy frames",
        subtype="DIR_PATH",
        options=set(),
    )
    composite_folder: StringProperty(
        name="Composited Frames",
        description="Folder for the frames of Composite Denoised. Empty: a folder named composited beside the noisy frames",
        subtype="DIR_PATH",
        options=set(),
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
        description="Keep the noisy image in the denoised files, as the pass Noisy Image",
        default=False,
        options=set(),
    )
    vector_layer: StringProperty(
        name="Vectors From",
        description="View layer that the motion vectors are taken from. Empty: the one that Prepare Shot made, else each layer's own",
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

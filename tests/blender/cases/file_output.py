"""Frames of a File Output node, whose files have passes without the names of view layers."""

from __future__ import annotations

from pathlib import Path

import bpy
import composites
import frames
import kit
import numpy as np
import OpenEXR


def shot_of_file_output(name: str) -> tuple[bpy.types.Scene, Path]:
    """A scene whose own output is PNG, and the folder of its frames as a File Output node of several layers writes them."""
    folder = kit.folder(name)
    for frame in (1, 2):
        planes = kit.channels(kit.shot() / f"frame_{frame:04d}.exr")
        named = {key.removeprefix("ViewLayer.").replace("Combined.", "Image."): plane for key, plane in planes.items()}
        header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
        OpenEXR.File(header, {key: np.ascontiguousarray(plane) for key, plane in named.items()}).write(
            str(folder / f"shot_{frame:04d}.exr")
        )
    scene = kit.build_scene("plain", kit.folder(f"{name}-png"))
    kit.module("compat").use_image_format(scene.render.image_settings, "PNG")
    scene.frame_end = 2
    scene.hush.input_folder = str(folder)
    return scene, folder


def test_they_are_denoised_shown_and_composited() -> None:
    """Every frame failed: the file has no view layer of the scene's name."""
    scene, folder = shot_of_file_output("files")
    problems = kit.module("checks.check").problems(scene, fresh=True)
    assert not problems, [problem.text for problem in problems]
    assert bpy.ops.hush.denoise_shot() == {"FINISHED"}
    noisy, made = (kit.layer(place / "shot_0001.exr", "Image", "RGBA") for place in (folder, folder / "denoised"))
    kit.assert_differs(noisy, made, 1e-3)
    status = kit.module("status")
    status.forget()
    assert status.shot_status(scene).done == 2
    assert bpy.ops.hush.add_node() == {"FINISHED"}
    (node,) = kit.module("nodes.node").nodes(scene)
    assert bpy.ops.hush.composite_shot() == {"FINISHED"}
    kit.assert_close(composites.plain(folder / "composited" / "shot_0001.exr"), made, composites.HALF)
    frames.put_in(scene, node)
    frames.assert_same(frames.shown(scene, 1), made, "the node")

"""What is packed into the .blend: never a denoised frame, which would be shown for all others."""

from __future__ import annotations

from pathlib import Path

import bpy
import frames
import kit


def shown_in_a_file(name: str) -> tuple[Path, bpy.types.Scene, bpy.types.NodeTree, Path]:
    """A shot, its scene whose node shows frame 2, the node's tree and a .blend that was saved before."""
    shot = kit.copy_of_shot(name)
    scene, node = frames.scene_with_node(shot)
    frames.denoise(scene)
    blend = kit.folder(f"{name}-file") / "shot.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(blend))
    frames.assert_same(frames.shown(scene, 2), frames.denoised(shot, 2), "before it is packed")
    return shot, scene, node.node_tree, blend


def image_of(tree: bpy.types.NodeTree) -> bpy.types.Image:
    return tree.nodes["Denoised Frame"].image


def test_after_pack_resources_every_frame_is_its_own() -> None:
    shot, scene, tree, _ = shown_in_a_file("packed")
    bpy.ops.file.pack_all()
    assert image_of(tree).packed_file is not None, "nothing was packed, so this tells nothing"
    for frame in (4, 2):
        frames.assert_same(frames.shown(scene, frame), frames.denoised(shot, frame), f"frame {frame}")


def test_a_packed_frame_is_not_saved() -> None:
    _, _, tree, blend = shown_in_a_file("packed-saved")
    bpy.ops.file.pack_all()
    bpy.ops.wm.save_mainfile()
    assert image_of(tree).packed_file is None
    bpy.ops.wm.open_mainfile(filepath=str(blend))
    assert [image.name for image in bpy.data.images if image.packed_file is not None] == ["incoming.exr"]


def test_automatically_pack_resources_leaves_the_frame_out() -> None:
    shot, scene, tree, blend = shown_in_a_file("autopacked")
    bpy.data.use_autopack = True
    node = kit.module("nodes.node")
    bpy.ops.wm.save_mainfile()
    assert [image.name for image in bpy.data.images if image.packed_file is not None] == ["incoming.exr"]
    # As after saving in a window: what is shown comes back.
    before = {tree.name: 2}
    node.suspend()
    node.resume(before)
    with frames.without_handlers():
        frames.assert_same(frames.render(scene, 2, kit.folder("out")), frames.denoised(shot, 2), "resumed")
    frames.assert_same(frames.shown(scene, 4), frames.denoised(shot, 4), "another frame")
    bpy.ops.wm.open_mainfile(filepath=str(blend))
    frames.assert_same(frames.shown(bpy.context.scene, 3), frames.denoised(shot, 3), "opened again")


def test_a_file_with_a_packed_frame_is_read_anew() -> None:
    """As it was saved by an earlier Hush."""
    shot, _, _, blend = shown_in_a_file("packed-before")
    bpy.ops.file.pack_all()
    with frames.without_handlers():
        bpy.ops.wm.save_mainfile()
    bpy.ops.wm.open_mainfile(filepath=str(blend))
    assert any(image.packed_file is not None for image in bpy.data.images if image.name != "incoming.exr")
    for frame in (2, 5):
        frames.assert_same(frames.shown(bpy.context.scene, frame), frames.denoised(shot, frame), f"frame {frame}")


def test_another_drive() -> None:
    """Of Windows: a path beside the file cannot be said there."""
    shot, scene, _, _ = shown_in_a_file("drive")
    scene.hush.output_folder = bpy.path.relpath(str(shot / "denoised"))
    real = bpy.path.relpath

    def other_drive(*_: object, **__: object) -> str:
        raise ValueError("path is on mount 'D:', start on mount 'C:'")

    bpy.path.relpath = other_drive
    try:
        frames.assert_same(frames.shown(scene, 3), frames.denoised(shot, 3), "frame 3")
    finally:
        bpy.path.relpath = real

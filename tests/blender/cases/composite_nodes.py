"""Composite Denoised finds the nodes of Hush, the old ones too, and refuses what it does not know."""

from __future__ import annotations

from pathlib import Path

import bpy
import kit
from composites import (
    HALF,
    combined,
    contents,
    denoised_scene,
    plain,
    refused,
    tree_of,
    untouched,
)

TIME_LIMIT = 600.0
# Opens a file and puts a node of a class of its own between Render Layers and the output.
WITH_OWN_CLASS = """
import os, sys, bpy
bpy.ops.wm.open_mainfile(filepath=sys.argv[1])

class Node(bpy.types.CompositorNodeCustomGroup):
    bl_idname, bl_label = sys.argv[2], sys.argv[3]

    def init(self, context):
        self.node_tree = bpy.data.node_groups.new(".Inner", "CompositorNodeTree")
        for direction in ("INPUT", "OUTPUT"):
            self.node_tree.interface.new_socket("Image", in_out=direction, socket_type="NodeSocketColor")

bpy.utils.register_class(Node)
scene = bpy.context.scene
tree = scene.compositing_node_group if bpy.app.version >= (5, 0) else scene.node_tree
node = tree.nodes.new(sys.argv[2])
target = next(each for each in tree.nodes if each.bl_idname in ("NodeGroupOutput", "CompositorNodeComposite")).inputs[0]
source = target.links[0].from_socket
tree.links.new(source, node.inputs[0])
tree.links.new(node.outputs[0], target)
bpy.ops.wm.save_mainfile()
bpy.utils.unregister_class(Node)
# 4.5 hangs at its end once there was such a class.
os._exit(0)
"""


def with_own_class(name: str, idname: str, label: str) -> Path:
    """Opens a file, with denoised frames in the folder that is returned, whose compositor has a node that this Blender does not know."""
    scene, folder = denoised_scene(name)
    tree_of(scene)
    blend = kit.folder(f"{name}-file") / "shot.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(blend))
    kit.blender(WITH_OWN_CLASS, blend, idname, label, enabled=False)
    bpy.ops.wm.open_mainfile(filepath=str(blend))
    return folder


def test_the_node_as_it_is_added() -> None:
    scene, folder = denoised_scene("added")
    assert bpy.ops.hush.add_node() == {"FINISHED"}
    assert untouched() == {"FINISHED"}
    for name in kit.files(folder / "composited"):
        kit.assert_close(plain(folder / "composited" / name), combined(folder / "denoised" / name), HALF, name)
    assert len(kit.files(folder / "composited")) == 3


def test_the_node_of_the_first_form_is_replaced_too() -> None:
    folder = with_own_class("first-form", "HushTemporalDenoiseNode", "Temporal Denoise")
    assert untouched() == {"FINISHED"}
    assert len(kit.files(folder / "composited")) == 3
    for name in kit.files(folder / "composited"):
        kit.assert_close(plain(folder / "composited" / name), combined(folder / "denoised" / name), HALF, name)


def test_a_node_that_only_the_other_process_does_not_know_is_refused() -> None:
    folder = with_own_class("stranger", "StrangersNode", "Stranger")
    made = contents.make(bpy.context.scene, allow_stale=False)
    assert [each.split(" › ")[1] for each in made.work["undefined"]] == ["Stranger"]
    made.work["undefined"] = []
    real, contents.make = contents.make, lambda *_, **__: made
    try:
        refused("Stranger", "add-on")
    finally:
        contents.make = real
    assert not (folder / "composited").exists()

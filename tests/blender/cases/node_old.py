"""Nodes of Hush 0.1, which had a class of Python's own, are found in old files and replaced."""

from __future__ import annotations

from pathlib import Path

import bpy
import frames
import kit

# What Hush 0.1 put into files, as far as it can be read without it.
OLD = """\
import sys, bpy, kit
scene = kit.build_scene()
scene.name = "Old"
if bpy.app.version >= (5, 0):
    tree = scene.compositing_node_group = bpy.data.node_groups.new("Comp", "CompositorNodeTree")
    tree.interface.new_socket("Image", in_out="OUTPUT", socket_type="NodeSocketColor")
    output = tree.nodes.new("NodeGroupOutput")
else:
    scene.use_nodes = True
    tree = scene.node_tree
    tree.nodes.clear()
    output = tree.nodes.new("CompositorNodeComposite")
layers = tree.nodes.new("CompositorNodeRLayers")

class Node(bpy.types.CompositorNodeCustomGroup):
    bl_idname = "HushTemporalDenoiseNode"
    bl_label = "Temporal Denoise"
    source_scene: bpy.props.PointerProperty(type=bpy.types.Scene)
    view_layer: bpy.props.StringProperty()

    def init(self, context):
        inner = bpy.data.node_groups.new(".Hush Temporal Denoise", "CompositorNodeTree")
        for direction in ("INPUT", "OUTPUT"):
            inner.interface.new_socket("Image", in_out=direction, socket_type="NodeSocketColor")
        inner["hush_form"] = "3 True"
        if sys.argv[3]:
            inner.interface.new_socket("Mask", in_out="OUTPUT", socket_type="NodeSocketFloat")
        self.node_tree = inner

bpy.utils.register_class(Node)
node = tree.nodes.new("HushTemporalDenoiseNode")
node.view_layer, node.source_scene, node.location = "ViewLayer", scene, (123, 45)
if sys.argv[2]:
    node.name = sys.argv[2]
tree.links.new(layers.outputs["Image"], node.inputs[0])
tree.links.new(node.outputs[0], output.inputs[0])
bpy.ops.wm.save_as_mainfile(filepath=sys.argv[1])
bpy.utils.unregister_class(Node)
"""


def opened(name: str, other: str = "") -> bpy.types.Scene:
    blend = kit.folder("old") / "old.blend"
    kit.blender(OLD, blend, name, other, enabled=False)
    bpy.ops.wm.open_mainfile(filepath=str(blend))
    return bpy.context.scene


def found(scene: bpy.types.Scene) -> list[object]:
    return [problem for problem in kit.module("checks.check").problems(scene, fresh=True) if problem.key == "node"]


def test_it_is_found_and_replaced() -> None:
    shot: Path = kit.copy_of_shot("shot")
    for name in ("", "A Name of the Artist's"):
        scene = opened(name)
        scene.hush.input_folder = str(shot)
        assert not list(kit.module("nodes.node").nodes(scene))
        (problem,) = found(scene)
        assert "earlier Hush" in problem.text and problem.fix
        assert bpy.ops.hush.fix(**problem.fix[1]) == {"FINISHED"}
        (node,) = kit.module("nodes.node").nodes(scene)
        assert found(scene) == []
        assert node.name == (name or "Temporal Denoise")
        assert node.node_tree.hush.scene == scene and node.node_tree.hush.view_layer == "ViewLayer"
        assert tuple(node.location) == (123, 45)
        assert node.inputs[0].links[0].from_node.bl_idname == "CompositorNodeRLayers"
        assert node.outputs[0].links[0].to_socket.name == "Image"
        frames.put_in(scene, node)
        frames.denoise(scene)
        frames.assert_same(frames.shown(scene, 2), frames.denoised(shot, 2), "replaced")


def test_unknown_nodes_of_others_are_left_alone() -> None:
    scene = opened("", "with a mask")
    assert any(node.bl_idname == "NodeUndefined" for node in kit.module("compat").compositor_tree(scene).nodes)
    assert found(scene) == []

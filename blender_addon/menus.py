# SPDX-FileCopyrightText: 2026 Hush authors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The compositor's Add menu, and putting the node where it belongs with one click."""

import bpy
from bpy.props import BoolProperty

from . import compat, messages, refresh
from .nodes import node


class HUSH_OT_add_node(bpy.types.Operator):
    """Add the Temporal Denoise node after the rendered image in the compositor"""

    bl_idname = "hush.add_node"
    bl_label = "Add Temporal Denoise Node"
    bl_options = {"REGISTER", "UNDO"}

    at_cursor: BoolProperty(
        name="At Cursor",
        description="Add it at the cursor, without links, to the nodes that are edited",
        default=False,
        options={"HIDDEN", "SKIP_SAVE"},
    )

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Puts it behind the first Render Layers node of this scene; everything that took its image takes the node's."""
        scene = context.scene
        if not self.at_cursor and compat.is_switched_off(scene):
            self.report({"ERROR"}, messages.text("node_switched_off"))
            return {"CANCELLED"}
        if not self.at_cursor and any(node.nodes(scene)):
            self.report({"INFO"}, messages.text("node_there"))
            return {"CANCELLED"}
        tree = _edited(context) if self.at_cursor else compat.ensure_compositor_tree(scene)
        if tree is None:
            self.report({"ERROR"}, messages.text("node_no_editor"))
            return {"CANCELLED"}
        if tree.library is not None:
            self.report({"ERROR"}, messages.text("node_tree_linked"))
            return {"CANCELLED"}
        if self.at_cursor:
            _add_at_cursor(context, tree)
        else:
            insert(tree, scene)
        refresh.request(now=True)
        return {"FINISHED"}

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        """At the cursor the node hangs on the mouse until it is put down, as any other."""
        result = self.execute(context)
        if self.at_cursor and result == {"FINISHED"} and context.region and context.region.type == "WINDOW":
            bpy.ops.node.translate_attach_remove_on_cancel("INVOKE_DEFAULT")
        return result


def insert(tree: bpy.types.NodeTree, scene: bpy.types.Scene) -> bpy.types.Node:
    """Adds the node between the scene's Render Layers and whatever takes its image."""
    added = node.new(tree)
    layers = [n for n in tree.nodes if n.bl_idname == "CompositorNodeRLayers" and n.scene in (scene, None)]
    linked = [n for n in layers if n.outputs["Image"].is_linked]
    source = next(iter(linked or layers), None)
    if source is not None:
        added.location = (source.location.x + source.width + 60, source.location.y + 120)
        if len(scene.view_layers) > 1:
            added.node_tree.hush.view_layer = source.layer
        image = source.outputs["Image"]
        targets = [link.to_socket for link in tree.links if link.from_socket == image]
        tree.links.new(image, added.inputs[0])
    else:
        targets = [compat.output_node(tree).inputs[0]]
    for target in targets:
        tree.links.new(added.outputs[0], target)
    return added


def _edited(context: bpy.types.Context) -> bpy.types.NodeTree | None:
    space = context.space_data
    if space is None or space.type != "NODE_EDITOR" or space.tree_type != "CompositorNodeTree":
        return None
    return space.edit_tree


def _add_at_cursor(context: bpy.types.Context, tree: bpy.types.NodeTree) -> None:
    for other in tree.nodes:
        other.select = False
    added = node.new(tree)
    added.location = context.space_data.cursor_location
    added.select = True
    tree.nodes.active = added


def draw_add_menu(self: bpy.types.Menu, _context: bpy.types.Context) -> None:
    """The last entry of the Add menu."""
    self.layout.separator()
    self.layout.operator_context = "INVOKE_REGION_WIN"
    self.layout.operator("hush.add_node", text=node.LABEL, icon=node.ICON).at_cursor = True


def register() -> None:
    """Adds the operator and the menu's entry."""
    bpy.utils.register_class(HUSH_OT_add_node)
    getattr(bpy.types, compat.ADD_MENU).append(draw_add_menu)


def unregister() -> None:
    """Takes both away."""
    getattr(bpy.types, compat.ADD_MENU).remove(draw_add_menu)
    bpy.utils.unregister_class(HUSH_OT_add_node)

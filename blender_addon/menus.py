# SPDX-FileCopyrightText: 2026 Hush authors
# SPDX-License-Identifier: Apache-2.0
"""The compositor's Add menu, and putting the node where it belongs with one click."""

import bpy

from . import compat, node


class HUSH_OT_add_node(bpy.types.Operator):
    """Add the Temporal Denoise node after the rendered image in the compositor"""

    bl_idname = "hush.add_node"
    bl_label = "Add Temporal Denoise Node"
    bl_options = {"REGISTER", "UNDO"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Puts it behind the first Render Layers node of this scene; everything that took its image takes the node's."""
        scene = context.scene
        if any(node.nodes(scene)):
            self.report({"INFO"}, "The compositor has a Temporal Denoise node already")
            return {"CANCELLED"}
        tree = compat.ensure_compositor_tree(scene)
        if tree.library is not None:
            self.report({"ERROR"}, "The compositor nodes are linked from another file: add the node there")
            return {"CANCELLED"}
        insert(tree, scene)
        node.sync(scene)
        return {"FINISHED"}


def insert(tree: bpy.types.NodeTree, scene: bpy.types.Scene) -> node.TemporalDenoise:
    """Adds the node between the scene's Render Layers and whatever takes its image."""
    added = tree.nodes.new(node.IDNAME)
    layers = [n for n in tree.nodes if n.bl_idname == "CompositorNodeRLayers" and n.scene in (scene, None)]
    linked = [n for n in layers if n.outputs["Image"].is_linked]
    source = next(iter(linked or layers), None)
    if source is not None:
        added.location = (source.location.x + source.width + 60, source.location.y + 120)
        if len(scene.view_layers) > 1:
            added.view_layer = source.layer
        image = source.outputs["Image"]
        targets = [link.to_socket for link in tree.links if link.from_socket == image]
        tree.links.new(image, added.inputs[0])
    else:
        targets = [compat.output_node(tree).inputs[0]]
    for target in targets:
        tree.links.new(added.outputs[0], target)
    return added


def draw_add_menu(self: bpy.types.Menu, _context: bpy.types.Context) -> None:
    """The last entry of the Add menu."""
    self.layout.separator()
    entry = self.layout.operator("node.add_node", text=node.LABEL, icon=node.ICON)
    entry.type = node.IDNAME
    entry.use_transform = True


def register() -> None:
    """Adds the operator and the menu's entry."""
    bpy.utils.register_class(HUSH_OT_add_node)
    getattr(bpy.types, compat.ADD_MENU).append(draw_add_menu)


def unregister() -> None:
    """Takes both away."""
    getattr(bpy.types, compat.ADD_MENU).remove(draw_add_menu)
    bpy.utils.unregister_class(HUSH_OT_add_node)

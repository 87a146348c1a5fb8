# SPDX-FileCopyrightText: 2026 Hush authors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The compositor's Add menu, and putting the node where it belongs with one click."""

import bpy
from bpy.props import BoolProperty

from . import compat, messages, refresh, shot
from .nodes import flow, kinds, node


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
            return self._add_to_the_rest(scene)
        tree = _edited(context) if self.at_cursor else _tree_for(scene)
        if tree is None:
            self.report({"ERROR"}, messages.text("node_no_editor"))
            return {"CANCELLED"}
        # What is added to an override is gone when the file is opened again.
        if tree.library is not None or tree.override_library is not None:
            self.report({"ERROR"}, messages.text("node_tree_linked"))
            return {"CANCELLED"}
        if self.at_cursor:
            _add_at_cursor(context, tree)
        elif not insert(tree, scene).outputs[0].is_linked:
            self.report({"WARNING"}, messages.text("node_unlinked"))
        else:
            _insert_where_it_goes_past(scene)
        refresh.request(now=True)
        return {"FINISHED"}

    def _add_to_the_rest(self, scene: bpy.types.Scene) -> set[str]:
        count = _insert_where_it_goes_past(scene)
        if not count:
            self.report({"INFO"}, messages.text("node_there"))
            return {"CANCELLED"}
        self.report({"INFO"}, messages.text("node_added", count=count))
        refresh.request(now=True)
        return {"FINISHED"}

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        """At the cursor the node hangs on the mouse until it is put down, as any other."""
        result = self.execute(context)
        if self.at_cursor and result == {"FINISHED"} and context.region and context.region.type == "WINDOW":
            bpy.ops.node.translate_attach_remove_on_cancel("INVOKE_DEFAULT")
        return result


def insert(tree: bpy.types.NodeTree, scene: bpy.types.Scene) -> bpy.types.Node:
    """Adds the node between what is rendered, of this scene or else of another, and whatever takes its image.

    Where nothing that is rendered is in the tree it stays without links, but for an output that has none.
    """
    source = _source(tree, scene)
    if source is not None:
        return _insert_behind(tree, scene, source)
    added = node.new(tree)
    result = compat.output_node(tree).inputs[0]
    if not result.is_linked:
        tree.links.new(added.outputs[0], result)
    return added


def _insert_behind(tree: bpy.types.NodeTree, scene: bpy.types.Scene, source: bpy.types.NodeSocket) -> bpy.types.Node:
    """Adds the node between a socket and whatever takes its image."""
    added, origin = node.new(tree), source.node
    added.location = (origin.location.x + origin.width + 60, origin.location.y + 120)
    shown = getattr(origin, "scene", None) or scene
    if shown != scene:
        added.node_tree.hush.scene = shown
    if len(shown.view_layers) > 1:
        added.node_tree.hush.view_layer = getattr(origin, "layer", shown.view_layers[0].name)
    targets = [(link.to_socket, link.is_muted) for link in tree.links if link.from_socket == source]
    tree.links.new(source, added.inputs[0])
    for target, is_muted in targets:
        tree.links.new(added.outputs[0], target).is_muted = is_muted
    return added


def _insert_where_it_goes_past(scene: bpy.types.Scene) -> int:
    """Adds a node where a view layer that is denoised goes past those that are there, as with several Render Layers. Returns how many."""
    found = [(tree, source) for tree, source in flow.past(scene) if tree.library is None and tree.override_library is None]
    for tree, source in found:
        _insert_behind(tree, scene, source)
    return len(found)


def _source(tree: bpy.types.NodeTree, scene: bpy.types.Scene) -> bpy.types.NodeSocket | None:
    """Where a tree gets the rendered image from, if it does: this scene's come first, of view layers that are rendered, and those that are
    composited."""
    layers = [each for each in tree.nodes if each.bl_idname == kinds.RENDER_LAYERS]
    found = [each.outputs[name] for name in flow.IMAGES for each in layers if name in each.outputs and each.outputs[name].enabled]
    given = compat.render_input(tree, scene)
    found += [given.outputs[0]] if given is not None else []
    is_other = lambda socket: getattr(socket.node, "scene", None) not in (scene, None)
    is_off = lambda socket: not is_other(socket) and getattr(socket.node, "layer", scene.view_layers[0].name) not in shot.layers(scene)
    return min(found, key=lambda socket: (is_other(socket), is_off(socket), not flow.is_composited(socket)), default=None)


def _tree_for(scene: bpy.types.Scene) -> bpy.types.NodeTree:
    """The first of the scene's compositor trees that gets a rendered image, else the first one; made where there is none."""
    trees = compat.compositor_trees(scene)
    return next((tree for tree in trees if _source(tree, scene) is not None), None) or compat.ensure_compositor_tree(scene)


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

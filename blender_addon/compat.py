# SPDX-FileCopyrightText: 2026 Hush authors
# SPDX-License-Identifier: GPL-3.0-or-later
"""What differs between Blender 4.2, 4.5, 5.0, 5.2 and 5.3, and nothing else."""

import os
from collections.abc import Callable, Iterable

import bpy

BLENDER_5 = bpy.app.version >= (5, 0, 0)
# The Image node of Blender 5.0 shows the first view for all, where one file holds several.
READS_VIEWS_OF_ONE_FILE = not BLENDER_5
# Blender 4.2 renders the Sequencer for strips that are muted, too.
MUTED_STRIPS_COUNT = bpy.app.version < (4, 5, 0)
ADD_MENU = "NODE_MT_compositor_node_add_all"


def compositor_tree(scene: bpy.types.Scene) -> bpy.types.NodeTree | None:
    """The scene's compositor tree, None where compositing is off or has no tree."""
    if BLENDER_5:
        return scene.compositing_node_group
    return scene.node_tree if scene.use_nodes else None


def is_switched_off(scene: bpy.types.Scene) -> bool:
    """Whether the scene has compositor nodes, but Use Nodes is off; Blender 5 knows no such state."""
    return not BLENDER_5 and not scene.use_nodes and scene.node_tree is not None and len(scene.node_tree.nodes) > 0


def ensure_compositor_tree(scene: bpy.types.Scene) -> bpy.types.NodeTree:
    """The scene's compositor tree; a new one, Render Layers straight to the output, where there is none."""
    tree = compositor_tree(scene)
    if tree is not None:
        return tree
    if BLENDER_5:
        tree = bpy.data.node_groups.new("Compositor Nodes", "CompositorNodeTree")
        scene.compositing_node_group = tree
    else:
        scene.use_nodes = True
        tree = scene.node_tree
    if not tree.nodes:
        layers = tree.nodes.new("CompositorNodeRLayers")
        layers.scene = scene
        output = output_node(tree)
        output.location = (400, 0)
        tree.links.new(layers.outputs["Image"], output.inputs[0])
    return tree


def output_node(tree: bpy.types.NodeTree) -> bpy.types.Node:
    """The node that takes the finished image in its first input; made where there is none."""
    kind = "NodeGroupOutput" if BLENDER_5 else "CompositorNodeComposite"
    nodes = [node for node in tree.nodes if node.bl_idname == kind]
    active = [node for node in nodes if getattr(node, "is_active_output", False)]
    if BLENDER_5 and not any(item.item_type == "SOCKET" and item.in_out == "OUTPUT" for item in tree.interface.items_tree):
        tree.interface.new_socket("Image", in_out="OUTPUT", socket_type="NodeSocketColor")
    return (active or nodes or [tree.nodes.new(kind)])[0]


def fcurves(owner: bpy.types.ID) -> Iterable[bpy.types.FCurve]:
    """The F-curves of an ID's own action."""
    animation = owner.animation_data
    action = animation.action if animation else None
    if action is None:
        return []
    slot = getattr(animation, "action_slot", None)
    if slot is None or not hasattr(action, "layers"):
        return getattr(action, "fcurves", [])
    strips = [strip for layer in action.layers for strip in layer.strips]
    bags = [strip.channelbag(slot) for strip in strips if hasattr(strip, "channelbag")]
    return [curve for bag in bags if bag for curve in bag.fcurves]


def working_space() -> str:
    """The colour space that renders are in."""
    space = getattr(bpy.data, "colorspace", None)
    return getattr(space, "working_space", "") or "Linear Rec.709"


def use_working_space(image: bpy.types.Image) -> None:
    """Says that an image's pixels are in the colour space that renders are in."""
    try:
        image.colorspace_settings.name = working_space()
    except TypeError:
        # A colour configuration without that name: no conversion at all is the same here.
        image.colorspace_settings.is_data = True


def use_multilayer(settings: bpy.types.ImageFormatSettings) -> None:
    """Sets an image format to multilayer OpenEXR."""
    if hasattr(settings, "media_type"):
        settings.media_type = "MULTI_LAYER_IMAGE"
    settings.file_format = "OPEN_EXR_MULTILAYER"


def use_image_format(settings: bpy.types.ImageFormatSettings, file_format: str) -> None:
    """Sets an image format to one that holds a single image."""
    if hasattr(settings, "media_type"):
        settings.media_type = "IMAGE"
    settings.file_format = file_format


def sequencer_is_rendered(scene: bpy.types.Scene) -> bool:
    """Whether the scene's Sequencer has strips for which Blender renders it in place of the scene, where Sequencer is on."""
    editor = scene.sequence_editor
    strips = (editor.strips if hasattr(editor, "strips") else editor.sequences) if editor else ()
    seen = [strip for strip in strips if strip.type != "SOUND"]
    if MUTED_STRIPS_COUNT:
        return bool(seen)
    return any(not strip.mute and not editor.channels[strip.channel].mute for strip in seen)


def own_compositor_tree(scene: bpy.types.Scene) -> bpy.types.NodeTree:
    """The scene's compositor tree, made one that can be changed where it is a library's."""
    tree = compositor_tree(scene)
    if BLENDER_5 and tree.library is not None:
        name = tree.name_full
        tree = scene.compositing_node_group = tree.copy()
        tree["hush_original"] = name
    return tree


def without_templates(path: str) -> str:
    """An output path whose curly brackets mean themselves; newer Blenders fill in what stands between them."""
    return path.replace("{", "{{").replace("}", "}}") if bpy.app.version >= (4, 5) else path


def set_folder(node: bpy.types.Node, change: Callable[[str], str]) -> None:
    """Changes the folder that a File Output node writes to."""
    name = "directory" if BLENDER_5 else "base_path"
    setattr(node, name, change(getattr(node, name)))


def written_by(node: bpy.types.Node) -> list[str]:
    """Where a File Output node writes OpenEXR files: absolute paths up to the frame number."""
    if not node.format.file_format.startswith("OPEN_EXR"):
        return []
    multilayer = node.format.file_format == "OPEN_EXR_MULTILAYER"
    if BLENDER_5:
        names = [node.file_name] if multilayer else [node.file_name, *(node.file_name + item.name for item in node.file_output_items)]
        paths = [os.path.join(node.directory, name) for name in names]
    else:
        paths = [node.base_path] if multilayer else [os.path.join(node.base_path, slot.path) for slot in node.file_slots]
    return [bpy.path.abspath(path).rstrip("#") for path in paths]

# SPDX-FileCopyrightText: 2026 Hush authors
# SPDX-License-Identifier: GPL-3.0-or-later
"""What differs between Blender 4.2, 4.5, 5.0, 5.2 and 5.3, and nothing else."""

import os
import re
from collections.abc import Callable, Iterable
from typing import Any

import bpy

BLENDER_5 = bpy.app.version >= (5, 0, 0)
# The Image node of Blender 5.0 shows the first view for all, where one file holds several.
READS_VIEWS_OF_ONE_FILE = not BLENDER_5
# Blender 4.2 renders the Sequencer for strips that are muted, too.
MUTED_STRIPS_COUNT = bpy.app.version < (4, 5, 0)
# Blender 5.3 has a row of compositor trees in a scene: the first gets the image of its first view layer, each other the one before's.
HAS_EFFECTS = "compositor_effects" in bpy.types.Scene.bl_rna.properties
# Whether Blender fills in what stands in curly brackets in output paths.
TEMPLATES = bpy.app.version >= (4, 5)
ADD_MENU = "NODE_MT_compositor_node_add_all"
# What lets a path of an add-on start with // in the file browser and its field; before Blender 5 every path may.
RELATIVE_PATH = {"PATH_SUPPORTS_BLEND_RELATIVE"} if "is_path_supports_blend_relative" in bpy.types.Property.bl_rna.properties else set()


def compositor_trees(scene: bpy.types.Scene) -> list[bpy.types.NodeTree]:
    """The trees that composite what the scene renders, in their order; none where compositing is off or has no tree."""
    if HAS_EFFECTS:
        return [effect.node_group for effect in effects(scene)]
    tree = scene.compositing_node_group if BLENDER_5 else scene.node_tree if scene.use_nodes else None
    return [] if tree is None else [tree]


def compositor_tree(scene: bpy.types.Scene) -> bpy.types.NodeTree | None:
    """The scene's compositor tree, the first where there are several; None where compositing is off or has no tree."""
    return next(iter(compositor_trees(scene)), None)


def effects(scene: bpy.types.Scene) -> list[Any]:
    """The effects of Blender 5.3 that are rendered."""
    return [effect for effect in scene.compositor_effects if effect.enable_for_render and effect.node_group is not None]


def is_switched_off(scene: bpy.types.Scene) -> bool:
    """Whether the scene has compositor nodes, but they are switched off; Blender 5.0 and 5.2 know no such state."""
    if HAS_EFFECTS:
        return not effects(scene) and any(effect.node_group is not None for effect in scene.compositor_effects)
    return not BLENDER_5 and not scene.use_nodes and scene.node_tree is not None and len(scene.node_tree.nodes) > 0


def render_input(tree: bpy.types.NodeTree, scene: bpy.types.Scene) -> bpy.types.Node | None:
    """The node of a compositor tree that gives the image of the scene's first view layer; None where it has none."""
    if not HAS_EFFECTS or tree != compositor_tree(scene):
        return None
    return min(group_inputs(tree), key=lambda node: not node.outputs[0].is_linked, default=None)


def group_inputs(tree: bpy.types.NodeTree) -> list[bpy.types.Node]:
    """The Group Input nodes of a tree that has inputs."""
    return [node for node in tree.nodes if node.bl_idname == "NodeGroupInput" and node.outputs[0].type != "CUSTOM"]


def ensure_compositor_tree(scene: bpy.types.Scene) -> bpy.types.NodeTree:
    """The scene's compositor tree; a new one, Render Layers straight to the output, where there is none."""
    tree = compositor_tree(scene)
    if tree is not None:
        return tree
    if BLENDER_5:
        tree = bpy.data.node_groups.new("Compositor Nodes", "CompositorNodeTree")
        if HAS_EFFECTS:
            scene.compositor_effects.new(tree.name).node_group = tree
        else:
            scene.compositing_node_group = tree
        is_new = True
    else:
        is_new = scene.node_tree is None
        scene.use_nodes = True
        tree = scene.node_tree
    if not tree.nodes:
        layers = tree.nodes.new("CompositorNodeRLayers")
        layers.scene = scene
        output = output_node(tree)
        output.location = (400, 0)
        tree.links.new(layers.outputs["Image"], output.inputs[0])
    rendered = next((layer.name for layer in scene.view_layers if layer.use), None)
    for layers in tree.nodes if is_new and rendered else ():
        if layers.bl_idname == "CompositorNodeRLayers":
            layers.layer = rendered
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


def file_space(scene: bpy.types.Scene) -> str:
    """The colour space of the EXR files that a scene renders: the one renders are in, unless Output › Color Management says another."""
    settings = scene.render.image_settings
    if settings.color_management == "OVERRIDE" and settings.file_format.startswith("OPEN_EXR"):
        return settings.linear_colorspace_settings.name
    return working_space()


def use_space(image: bpy.types.Image, name: str) -> None:
    """Says which colour space an image's pixels are in, if that is not said already."""
    try:
        if image.colorspace_settings.name != name:
            image.colorspace_settings.name = name
    except TypeError:
        # A colour configuration without that name: no conversion at all is the same here.
        image.colorspace_settings.is_data = True


def label(owner: Any, name: str) -> str:  # noqa: ANN401 (whatever has properties)
    """What the interface calls the choice that a property holds, without the extension of files that Blender 5 puts behind formats."""
    value = getattr(owner, name)
    return re.sub(r" \(\.\w+\)$", "", bpy.types.UILayout.enum_item_name(owner, name, value)) or value


_MULTILAYER = "OPEN_EXR_MULTILAYER"


def is_multilayer(settings: bpy.types.ImageFormatSettings) -> bool:
    """Whether an image format is multilayer OpenEXR, which holds all view layers and passes."""
    return settings.file_format == _MULTILAYER


def use_multilayer(settings: bpy.types.ImageFormatSettings) -> None:
    """Sets an image format to multilayer OpenEXR."""
    if hasattr(settings, "media_type"):
        settings.media_type = "MULTI_LAYER_IMAGE"
    settings.file_format = _MULTILAYER


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


def own_compositor_trees(scene: bpy.types.Scene) -> list[bpy.types.NodeTree]:
    """The scene's compositor trees, made ones that can be changed where they are a library's, or are used elsewhere too."""
    owners = [(effect, "node_group") for effect in effects(scene)] if HAS_EFFECTS else [(scene, "compositing_node_group")]
    for owner, name in owners if BLENDER_5 else ():
        tree = getattr(owner, name)
        if tree.library is not None or HAS_EFFECTS and tree.users > 1:
            copied = tree.copy()
            copied["hush_original"] = tree.name_full
            setattr(owner, name, copied)
    return compositor_trees(scene)


def without_templates(path: str) -> str:
    """An output path whose curly brackets mean themselves; newer Blenders fill in what stands between them."""
    return path.replace("{", "{{").replace("}", "}}") if TEMPLATES else path


def with_folder(path: str, folder: str) -> str:
    """An output path that says of itself which folder the .blend is in, where Blender would fill in `{blend_dir}`."""
    return re.sub(r"(?<!\{)\{blend_dir\}", lambda _: without_templates(folder), path) if TEMPLATES else path


def filled_in(path: str, scene: bpy.types.Scene, node: bpy.types.Node) -> str:
    """A path of a File Output node with its templates filled in. Changes the output path of the scene."""
    if "{" not in path or not TEMPLATES:
        return path
    scene.render.filepath = path.replace("{node_name}", without_templates(node.name)) + "####"
    try:
        return re.split(r"\d{4}[^\\/\d]*$", scene.render.frame_path(frame=0))[0]
    except RuntimeError:
        # Blender does not write to it either.
        return path


def set_folder(node: bpy.types.Node, change: Callable[[str], str]) -> None:
    """Changes the folder that a File Output node writes to, and where Blender 5 fills in parts, its names too."""
    for name in ("directory", "file_name") if BLENDER_5 else ("base_path",):
        setattr(node, name, change(getattr(node, name)))


def written_by(node: bpy.types.Node) -> list[str]:
    """Where a File Output node writes OpenEXR files: absolute paths up to the frame number."""
    if not node.format.file_format.startswith("OPEN_EXR"):
        return []
    multilayer = is_multilayer(node.format)
    if BLENDER_5:
        names = [node.file_name] if multilayer else [node.file_name, *(node.file_name + item.name for item in node.file_output_items)]
        paths = [os.path.join(node.directory, name) for name in names]
    else:
        paths = [node.base_path] if multilayer else [os.path.join(node.base_path, slot.path) for slot in node.file_slots]
    return [bpy.path.abspath(path).rstrip("#") for path in paths]

# SPDX-FileCopyrightText: 2026 Hush authors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The nodes that a composite has to know: those of Hush, also of its first form, and those that this Blender does not know."""

import os
from collections.abc import Iterator
from typing import Any

import bpy

from .. import compat
from .inside import is_one

RENDER_LAYERS, CRYPTOMATTE = "CompositorNodeRLayers", "CompositorNodeCryptomatteV2"
_FIRST_FORM, _FIRST_NAME = "HushTemporalDenoiseNode", "Temporal Denoise"


def of_hush(node: bpy.types.Node) -> tuple[bpy.types.Scene | None, str] | None:
    """The scene (None: the one that is composited) and view layer (empty: the first) that a node of Hush shows; None for others.

    Where the extension is off its settings cannot be read.
    """
    tree = getattr(node, "node_tree", None)
    if node.bl_idname == "CompositorNodeGroup" and is_one(tree):
        settings = getattr(tree, "hush", None)
        return getattr(settings, "scene", None), getattr(settings, "view_layer", "") or ""
    if node.bl_idname == _FIRST_FORM:
        return getattr(node, "source_scene", None), getattr(node, "view_layer", "")
    if is_first_form(node):
        scene = _properties(node).get("source_scene")
        return scene if isinstance(scene, bpy.types.Scene) else None, str(_properties(node).get("view_layer") or "")
    return None


def shows_renders(node: bpy.types.Node, scene: bpy.types.Scene) -> bool:
    """Whether a node shows what a scene renders."""
    renders = node.bl_idname == RENDER_LAYERS or node.bl_idname == CRYPTOMATTE and node.source == "RENDER"
    return renders and not node.mute and node.scene in (None, scene)


def is_undefined(node: bpy.types.Node) -> bool:
    """Whether a node is of an add-on that is not there."""
    return node.bl_idname == "NodeUndefined"


def is_first_form(node: bpy.types.Node) -> bool:
    """Whether a node is one of Hush 0.1; Blender tells no name of an unknown class, so sockets, name and properties must do."""
    if node.bl_idname == _FIRST_FORM:
        return True
    if not is_undefined(node):
        return False
    sockets = [socket.name for socket in node.inputs], [socket.name for socket in node.outputs]
    known = node.name.split(".")[0] == _FIRST_NAME or {"source_scene", "view_layer"} & set(_properties(node).keys())
    return sockets == (["Image"], ["Image"]) and bool(known)


def _properties(node: bpy.types.Node) -> Any:  # noqa: ANN401 (a mapping of Blender's)
    """The properties that an unknown node keeps."""
    return (node.bl_system_properties_get() or {}) if hasattr(node, "bl_system_properties_get") else node


def key(tree: bpy.types.NodeTree, node: bpy.types.Node) -> str:
    """A name for a node that means the same in a copy of the file."""
    return f"{tree.get('hush_original', tree.name_full)} › {node.name}"


def local_copy(tree: bpy.types.NodeTree) -> bpy.types.NodeTree:
    """A tree of a library, as one that can be changed; its nodes keep their `key`."""
    copied = tree.copy()
    copied["hush_original"] = tree.name_full
    return copied


def reached(scene: bpy.types.Scene) -> Iterator[tuple[bpy.types.NodeTree, bpy.types.Node]]:
    """Every node that the scene's compositor reaches, also inside groups, but not inside those of Hush."""
    waiting, seen = compat.compositor_trees(scene)[::-1], set()
    while waiting:
        tree = waiting.pop()
        if tree in seen:
            continue
        seen.add(tree)
        for node in tree.nodes:
            yield tree, node
            if of_hush(node) is None and getattr(node, "node_tree", None) is not None:
                waiting.append(node.node_tree)


def absolute(path: str, origin: str) -> str:
    """A path of the original file, which lay in the folder `origin`; the copy lies elsewhere."""
    return os.path.normpath(os.path.join(origin, path[2:])) + ("/" if path.endswith("/") else "") if path.startswith("//") else path

# SPDX-FileCopyrightText: 2026 Hush authors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Where the denoised image goes in a compositor: what is denoised once more, and what goes past the nodes of Hush and stays noisy."""

from collections import defaultdict
from collections.abc import Iterator

import bpy

from .. import compat, shot
from . import kinds

_DENOISE, _GROUP = "CompositorNodeDenoise", "CompositorNodeGroup"
# What goes there is looked at only, or was meant to be as it is rendered.
_ASIDE = {"CompositorNodeViewer", "CompositorNodeOutputFile"}
_Place = tuple[bpy.types.NodeTree, bpy.types.Node]
_Users = dict[bpy.types.NodeTree, list[_Place]]


def denoised_again(scene: bpy.types.Scene) -> list[str]:
    """Names of the Denoise nodes that get what Hush has denoised."""
    places = list(kinds.reached(scene))
    are_there, users = any(_is_ours(node) for _, node in places), _users(places)
    found = []
    for tree, node in places:
        if node.bl_idname == _DENOISE and not node.mute:
            sources = _sources(tree, node.inputs[0], users, set())
            # Without a node of Hush everything that is rendered is composited denoised.
            if any(_is_ours(each.node) or not are_there and _is_render(tree, each, scene) for tree, each in sources):
                found.append(node.name)
    return sorted(set(found))


def past(scene: bpy.types.Scene) -> list[tuple[bpy.types.NodeTree, bpy.types.NodeSocket]]:
    """The sockets that give the image of a view layer that is denoised to something else than a node of Hush; all of the trees' own."""
    places = list(kinds.reached(scene))
    users, denoised = _users(places), set(shot.layers(scene))
    ours = [(tree, node) for tree, node in places if _is_ours(node) and node.inputs]
    taken = {socket for tree, node in ours for _, socket in _sources(tree, node.inputs[0], users, set())}
    found = []
    for tree, node in places:
        given = node.outputs[0] if node.outputs and not node.mute else None
        if given is None or given in taken or not _is_render(tree, given, scene):
            continue
        if getattr(node, "layer", scene.view_layers[0].name) in denoised and any(_counts(link) for link in given.links):
            found.append((tree, given))
    return found


def past_layers(scene: bpy.types.Scene) -> list[str]:
    """The view layers of `past`, where the compositor has a node of Hush; without one they are composited denoised."""
    if not any(_is_ours(node) for _, node in kinds.reached(scene)):
        return []
    return sorted({getattr(socket.node, "layer", scene.view_layers[0].name) for _, socket in past(scene)})


def _is_ours(node: bpy.types.Node) -> bool:
    return not node.mute and kinds.of_hush(node) is not None


def _is_render(tree: bpy.types.NodeTree, socket: bpy.types.NodeSocket, scene: bpy.types.Scene) -> bool:
    """Whether a socket gives the rendered image of a scene."""
    node = socket.node
    if node.bl_idname == kinds.RENDER_LAYERS:
        return socket.name == "Image" and kinds.shows_renders(node, scene)
    return node == compat.render_input(tree, scene)


def _counts(link: bpy.types.NodeLink) -> bool:
    return not link.is_muted and link.to_node.bl_idname not in _ASIDE


def _users(places: list[_Place]) -> _Users:
    """The nodes that have a tree as their group, by tree; a muted one lets its input pass by what is in it."""
    found = defaultdict(list)
    for tree, node in places:
        if node.bl_idname == _GROUP and not node.mute and node.node_tree is not None:
            found[node.node_tree].append((tree, node))
    return found


def _sources(
    tree: bpy.types.NodeTree, socket: bpy.types.NodeSocket, users: _Users, seen: set[bpy.types.NodeSocket]
) -> Iterator[tuple[bpy.types.NodeTree, bpy.types.NodeSocket]]:
    """Every output that an input gets something of, also through groups; what a node of Hush or a Denoise node gets is left out."""
    if socket in seen:
        return
    seen.add(socket)
    for link in socket.links:
        if link.is_muted:
            continue
        node, given = link.from_node, link.from_socket
        yield tree, given
        if _is_ours(node) or node.bl_idname == _DENOISE and not node.mute:
            continue
        inner = node.node_tree if node.bl_idname == _GROUP and not node.mute else None
        if node.bl_idname == "NodeGroupInput":
            ends = [(outer, group.inputs) for outer, group in users.get(tree, ())]
        elif inner is not None:
            ends = [(inner, each.inputs) for each in inner.nodes if each.bl_idname == "NodeGroupOutput"]
        else:
            yield from _of_all(tree, node, users, seen)
            continue
        for place, inputs in ends:
            for each in inputs:
                if each.identifier == given.identifier:
                    yield from _sources(place, each, users, seen)


def _of_all(
    tree: bpy.types.NodeTree, node: bpy.types.Node, users: _Users, seen: set[bpy.types.NodeSocket]
) -> Iterator[tuple[bpy.types.NodeTree, bpy.types.NodeSocket]]:
    for each in node.inputs:
        yield from _sources(tree, each, users, seen)

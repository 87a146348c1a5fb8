# SPDX-FileCopyrightText: 2026 Hush authors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Where the denoised image goes in a compositor: what is denoised once more, and what goes past the nodes of Hush and stays noisy."""

from collections import defaultdict
from collections.abc import Collection, Iterator

import bpy

from .. import compat, shot
from . import kinds

_DENOISE, _GROUP = "CompositorNodeDenoise", "CompositorNodeGroup"
# The outputs of Render Layers that are its image: Cycles' own Denoise leaves the second one as it was rendered.
IMAGES = ("Image", "Noisy Image")
# What goes there is looked at only, or was meant to be as it is rendered.
_ASIDE = {"CompositorNodeViewer", "CompositorNodeOutputFile"}
_Place = tuple[bpy.types.NodeTree, bpy.types.Node]
_Given = tuple[bpy.types.NodeTree, bpy.types.NodeSocket]


def denoised_again(scene: bpy.types.Scene) -> list[str]:
    """Names of the Denoise nodes that get what Hush has denoised."""
    flow, found = _Flow(scene), set()
    are_there = any(_is_ours(node) for _, node in flow.places)
    for tree, node in flow.places:
        if node.bl_idname == _DENOISE and not node.mute:
            # Without a node of Hush everything that is rendered is composited denoised.
            sources = flow.sources(tree, node.inputs[0])
            if any(_is_ours(given.node) or not are_there and _is_image(place, given, scene, IMAGES[:1]) for place, given in sources):
                found.add(node.name)
    return sorted(found)


def past(scene: bpy.types.Scene) -> list[_Given]:
    """The sockets that give the image of a view layer that is denoised to something else than a node of Hush, and their trees."""
    flow, denoised = _Flow(scene), set(shot.layers(scene))
    ours = [(tree, node) for tree, node in flow.places if _is_ours(node) and node.inputs]
    taken = {given for tree, node in ours for _, given in flow.sources(tree, node.inputs[0])}
    found = []
    for tree, node in flow.places:
        images = [given for given in node.outputs if given.enabled and _is_image(tree, given, scene)] if not node.mute else []
        for given in images:
            if given not in taken and _layer(node, scene) in denoised and is_composited(given):
                found.append((tree, given))
    return found


def past_layers(scene: bpy.types.Scene) -> list[str]:
    """The view layers of `past`, where the compositor has a node of Hush; without one they are composited denoised."""
    if not any(_is_ours(node) for _, node in kinds.reached(scene)):
        return []
    return sorted({_layer(socket.node, scene) for _, socket in past(scene)})


def lost(scene: bpy.types.Scene) -> list[_Given]:
    """The linked sockets for a noisy image that is not rendered, as Cycles' own Denoise is off: what they lead to gets nothing."""
    outputs = [(tree, given) for tree, node in kinds.reached(scene) if node.bl_idname == kinds.RENDER_LAYERS for given in node.outputs]
    # Blender finds such a socket by its name no more.
    gone = [(tree, given) for tree, given in outputs if given.name == IMAGES[1] and not given.enabled]
    return [(tree, given) for tree, given in gone if given.is_linked and kinds.shows_renders(given.node, scene)]


def lost_layers(scene: bpy.types.Scene) -> list[str]:
    """The view layers of `lost`."""
    return sorted({_layer(given.node, scene) for _, given in lost(scene)})


def take_image(scene: bpy.types.Scene) -> int:
    """Gives what `lost` leads to the rendered image, which is the noisy one then. Returns how many links were changed."""
    count = 0
    for tree, given in lost(scene):
        own = tree.library is None and tree.override_library is None
        for target, is_muted in [(link.to_socket, link.is_muted) for link in given.links] if own else ():
            tree.links.new(given.node.outputs[IMAGES[0]], target).is_muted = is_muted
            count += 1
    return count


def _layer(node: bpy.types.Node, scene: bpy.types.Scene) -> str:
    """The view layer of a Render Layers, or of the Group Input of Blender 5.3."""
    return getattr(node, "layer", scene.view_layers[0].name)


def _is_ours(node: bpy.types.Node) -> bool:
    return not node.mute and kinds.of_hush(node) is not None


def _is_image(tree: bpy.types.NodeTree, socket: bpy.types.NodeSocket, scene: bpy.types.Scene, names: Collection[str] = IMAGES) -> bool:
    """Whether a socket gives the rendered image of a scene."""
    node = socket.node
    if node.bl_idname == kinds.RENDER_LAYERS:
        return socket.name in names and kinds.shows_renders(node, scene)
    return node == compat.render_input(tree, scene) and socket == node.outputs[0]


def is_composited(socket: bpy.types.NodeSocket) -> bool:
    """Whether a socket's image goes somewhere else than aside, through reroutes or not."""
    waiting, seen = list(socket.links), set()
    while waiting:
        link = waiting.pop()
        if link.is_muted or link.to_node.bl_idname in _ASIDE or link.to_node in seen:
            continue
        if link.to_node.bl_idname != "NodeReroute":
            return True
        seen.add(link.to_node)
        waiting += link.to_node.outputs[0].links
    return False


class _Flow:
    """The links of all trees that a scene's compositor reaches, by where they lead; Blender itself looks through all for each socket."""

    def __init__(self, scene: bpy.types.Scene) -> None:
        self.places: list[_Place] = list(kinds.reached(scene))
        self._links: dict[bpy.types.NodeTree, dict[bpy.types.NodeSocket, list[bpy.types.NodeLink]]] = {}
        # The nodes that have a tree as their group; a muted one lets its input pass by what is in it.
        self._users: dict[bpy.types.NodeTree, list[_Place]] = defaultdict(list)
        for tree, node in self.places:
            if _group(node) is not None:
                self._users[node.node_tree].append((tree, node))

    def sources(self, tree: bpy.types.NodeTree, socket: bpy.types.NodeSocket) -> list[_Given]:
        """Every output that an input gets something of, also through groups; what a node of Hush or a Denoise node gets is left out."""
        found: list[_Given] = []
        waiting, seen = [(tree, socket)], {socket}
        while waiting:
            place, end = waiting.pop()
            for link in self._into(place, end):
                found.append((place, link.from_socket))
                for each in self._behind(place, link.from_node, link.from_socket):
                    if each[1] not in seen:
                        seen.add(each[1])
                        waiting.append(each)
        return found

    def _behind(self, tree: bpy.types.NodeTree, node: bpy.types.Node, given: bpy.types.NodeSocket) -> Iterator[_Given]:
        """The inputs that an output is made from."""
        if _is_ours(node) or node.bl_idname == _DENOISE and not node.mute:
            return
        inner = _group(node)
        if node.bl_idname == "NodeGroupInput":
            ends = [(outer, group.inputs) for outer, group in self._users.get(tree, ())]
        elif inner is not None:
            ends = [(inner, each.inputs) for each in inner.nodes if each.bl_idname == "NodeGroupOutput"]
        else:
            yield from ((tree, each) for each in node.inputs if each.is_linked)
            return
        for place, inputs in ends:
            yield from ((place, each) for each in inputs if each.identifier == given.identifier)

    def _into(self, tree: bpy.types.NodeTree, socket: bpy.types.NodeSocket) -> list[bpy.types.NodeLink]:
        if tree not in self._links:
            self._links[tree] = defaultdict(list)
            for link in tree.links:
                if not link.is_muted:
                    self._links[tree][link.to_socket].append(link)
        return self._links[tree].get(socket, [])


def _group(node: bpy.types.Node) -> bpy.types.NodeTree | None:
    """The tree that a node runs."""
    return node.node_tree if node.bl_idname == _GROUP and not node.mute else None

# SPDX-FileCopyrightText: 2026 Hush authors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The Temporal Denoise node: where it is, and what it shows: the denoised frame if that is current, else the incoming image.

It never shows a denoised frame in what is rendered or saved; `handlers.py` sees to that.
"""

from collections.abc import Iterator

import bpy

from .. import compat, messages, shot, status
from ..messages import Refusal
from . import inside, kinds

LABEL, ICON = inside.NAME, "SHADERFX"
_GROUP = "CompositorNodeGroup"
_why: dict[int, str] = {}
# By tree that shows a frame: its scene's name and its settings then.
_shown_with: dict[int, tuple[str, object]] = {}
# By scene and frame: the stamp of its file when the frame was rendered last.
_rendered: dict[tuple[int, int], tuple[int, int] | None] = {}


def nodes(scene: bpy.types.Scene) -> Iterator[bpy.types.Node]:
    """Every Temporal Denoise node that the scene's compositor reaches, also inside groups."""
    return (node for _, node in kinds.reached(scene) if node.bl_idname == _GROUP and inside.is_one(node.node_tree))


def trees(scene: bpy.types.Scene) -> list[bpy.types.NodeTree]:
    """The trees of these nodes, each once."""
    return list(dict.fromkeys(node.node_tree for node in nodes(scene)))


def owners(tree: bpy.types.NodeTree) -> list[bpy.types.Scene]:
    """The scenes whose compositor reaches the tree."""
    return [scene for scene in bpy.data.scenes if tree in trees(scene)]


def new(parent: bpy.types.NodeTree) -> bpy.types.Node:
    """Adds a node, with a tree and an image of its own."""
    node = parent.nodes.new(_GROUP)
    node.node_tree = inside.build()
    node.name, node.width = LABEL, 240
    return node


def are_there() -> bool:
    """Whether the file has any such node."""
    return any(inside.is_one(tree) for tree in bpy.data.node_groups)


def sync(*scenes: bpy.types.Scene) -> None:
    """Shows the denoised frame in the scenes' nodes where it is current, else the incoming image. From the main thread, not in a render.

    Of scenes that share a node the first one counts. Costs a look at a file or two a node, and no compositing where nothing changed.
    """
    done = set()
    for scene in scenes:
        for tree in trees(scene):
            if tree not in done:
                done.add(tree)
                _sync_tree(tree, scene)


def settings_changed() -> bool:
    """Whether a scene has other settings than when its frame was shown; without a look at the disk."""
    for tree in _local_trees() if _shown_with else ():
        name, then = _shown_with.get(tree.session_uid, ("", None)) if is_on(tree) else ("", None)
        if then is not None and (name not in bpy.data.scenes or _settings(bpy.data.scenes[name]) != then):
            return True
    return False


def pass_through() -> None:
    """Has every node pass its input through in what is rendered from now on. From any thread; cheap."""
    for tree in _local_trees():
        inside.pass_through(tree)


def suspend() -> dict[str, int]:
    """Takes what the nodes show out of the file, as before it is saved; returns it for `resume`."""
    shown = {tree.name: frame for tree in _local_trees() if (frame := inside.shown_frame(tree)) is not None}
    for tree in _local_trees():
        inside.hide(tree)
        inside.unload(tree)
    return shown


def resume(shown: dict[str, int]) -> None:
    """Shows again what `suspend` took away."""
    for tree in _local_trees():
        if tree.name in shown:
            inside.resume(tree, shown[tree.name])


def is_on(tree: bpy.types.NodeTree) -> bool:
    """Whether a node's tree shows a denoised frame."""
    return inside.shown_frame(tree) is not None


def why_off(tree: bpy.types.NodeTree) -> str:
    """Why it does not, in words."""
    return _why.get(tree.session_uid) or messages.text("node_unknown")


def frame_is_rendered(scene: bpy.types.Scene) -> None:
    """Remembers what the files of the current frame were when it began to be rendered: unless they change, the picture is newer."""
    for source in {scene, *(tree.hush.scene for tree in trees(scene) if tree.hush.scene)}:
        try:
            file = shot.frame_file(shot.frame_pattern(source), scene.frame_current)
        except Refusal:
            continue
        _rendered[source.session_uid, scene.frame_current] = shot.stamp(file)


def forget() -> None:
    """Another file was opened."""
    inside.forget()
    _why.clear()
    _shown_with.clear()
    _rendered.clear()


def faults(scene: bpy.types.Scene) -> Iterator[tuple[str, str]]:
    """What `repair` would mend, as keys of messages with the node's name."""
    for _, node in kinds.reached(scene):
        if kinds.is_first_form(node):
            yield "node_old", node.name
        elif _is_broken(node):
            yield "node_broken", node.name


def repair(scene: bpy.types.Scene) -> int:
    """Replaces nodes of earlier versions of Hush, their links kept, and makes anew what is inside of broken ones. Returns how many."""
    count = 0
    for _, node in list(kinds.reached(scene)):
        if kinds.is_first_form(node) and not _is_linked(node):
            _replace(node)
        elif _is_broken(node):
            inside.fill(node.node_tree)
        else:
            continue
        count += 1
    return count


def _local_trees() -> list[bpy.types.NodeTree]:
    return [tree for tree in bpy.data.node_groups if tree.library is None and inside.is_one(tree)]


def _is_linked(node: bpy.types.Node) -> bool:
    return node.id_data.library is not None or getattr(node, "node_tree", None) is not None and node.node_tree.library is not None


def _is_broken(node: bpy.types.Node) -> bool:
    is_ours = node.bl_idname == _GROUP and inside.is_one(node.node_tree)
    return is_ours and not _is_linked(node) and not inside.is_sound(node.node_tree)


def _sync_tree(tree: bpy.types.NodeTree, scene: bpy.types.Scene) -> None:
    if tree.library is not None:
        _why[tree.session_uid] = messages.text("node_linked", file=tree.library.filepath)
        return
    reason = _show(tree, scene)
    _why[tree.session_uid] = reason or ""
    if reason:
        inside.hide(tree)


def _show(tree: bpy.types.NodeTree, scene: bpy.types.Scene) -> str | None:
    """Shows the scene's frame; else the reason why it cannot be."""
    if not inside.is_sound(tree):
        return messages.text("node_inside")
    source = tree.hush.scene or scene
    others = [] if tree.hush.scene else [other for other in owners(tree) if _files(other) != _files(scene)]
    if others:
        return messages.text("node_owners", scenes=messages.listed(sorted(each.name for each in {scene, *others})))
    if scene.render.use_multiview or source.render.use_multiview:
        return messages.text("node_stereo")
    if scene.render.frame_map_old != scene.render.frame_map_new:
        return messages.text("node_stretch")
    frame = scene.frame_current
    try:
        known = status.frame(source, frame)
    except Refusal as error:
        return str(error)
    if known.state != "current" or known.output is None:
        return known.why
    began = _rendered.get((source.session_uid, frame), known)
    if began is not known and began == shot.stamp(known.source):
        return messages.text("node_rendered")
    stamp = shot.stamp(known.output)
    if stamp is None:
        return messages.text("node_missing")
    layers = (tree.hush.view_layer,) if tree.hush.view_layer else tuple(shot.layers(source))
    picture = inside.Picture(known.output, stamp, layers, shot.is_relative(source), compat.file_space(source))
    if not inside.show(tree, frame, picture):
        return messages.text("node_layer", layer=" or ".join(layers))
    _shown_with[tree.session_uid] = source.name, _settings(source)
    return None


def _settings(scene: bpy.types.Scene) -> object:
    hush, render = scene.hush, scene.render
    paths = render.filepath, hush.input_folder, hush.output_folder, hush.vector_layer
    return shot.settings(scene, None)[0], paths, shot.render_size(scene), render.use_multiview, compat.file_space(scene)


def _files(scene: bpy.types.Scene) -> object:
    """What decides which denoised frames a scene has."""
    try:
        return shot.sequences(scene)
    except Refusal:
        return None


def _replace(old: bpy.types.Node) -> None:
    parent = old.id_data
    made = new(parent)
    made.node_tree.hush.scene, made.node_tree.hush.view_layer = kinds.of_hush(old)
    made.location, made.width, made.parent = old.location, old.width, old.parent
    for link in [link for link in parent.links if old in (link.from_node, link.to_node)]:
        if link.to_node == old:
            parent.links.new(link.from_socket, made.inputs[0])
        else:
            parent.links.new(made.outputs[0], link.to_socket)
    name = old.name
    parent.nodes.remove(old)
    made.name = name


def register() -> None:
    """Nothing to add: the node is Blender's own group."""


def unregister() -> None:
    """Without Hush every node passes its input through."""
    suspend()
    forget()

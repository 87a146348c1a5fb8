# SPDX-FileCopyrightText: 2026 Hush authors
# SPDX-License-Identifier: Apache-2.0
"""The tree inside a Temporal Denoise node: the files of the denoised frames, and the incoming image wherever there is none."""

from collections.abc import Iterable, Sequence

import bpy

from . import compat

FRAMES, VIEWS, GUARD, CHOICE = "Denoised Frames", "Views", "Is There a Picture", "Denoised or Incoming"
# Offsets of the Image nodes: started at frame 0 and moved by one, the scene's frame is the number in the file's name.
HERE, NOWHERE = -1, 1_000_000
# A tree of another form, or made by another Blender, is built anew.
_FORM_KEY, _FORM = "hush_form", f"3 {compat.BLENDER_5}"
# Opaque black, as Blender gives for a missing file.
_NOTHING = (0.0, 0.0, 0.0, 1.0)


def is_sound(tree: bpy.types.NodeTree | None, views: Sequence[str]) -> bool:
    """Whether a tree is one that `build` made for these views."""
    return tree is not None and tree.get(_FORM_KEY) == _form(views) and all(n in tree.nodes for n in (*names(views), GUARD, CHOICE))


def names(views: Sequence[str]) -> list[str]:
    """Names of the Image nodes: one for each view."""
    return [f"{FRAMES} {view}".strip() for view in views]


def targets(tree: bpy.types.NodeTree, view: str) -> list[bpy.types.NodeSocket]:
    """What the image of a view goes to."""
    if VIEWS in tree.nodes:
        return [socket for socket in tree.nodes[VIEWS].inputs if socket.name == view]
    return [tree.nodes[GUARD].inputs[0], compat.choice_sockets(tree.nodes[CHOICE]).b]


def is_linked(tree: bpy.types.NodeTree, views: Sequence[str]) -> bool:
    """Whether the images of all views are connected."""
    found = [target for view in views for target in targets(tree, view)]
    return bool(found) and all(target.is_linked for target in found)


def _form(views: Sequence[str]) -> str:
    return f"{_FORM} {'|'.join(views)}"


def build(views: Sequence[str]) -> bpy.types.NodeTree:
    """A new tree that shows no frames yet; `views` are the stereo views, one empty name without.

    Where no file is, Blender's Image node gives opaque black, in 4.2 magenta. Where the denoised image is exactly that, the guard
    passes the incoming one; so a file that vanishes while its frame is rendered does no harm, nor does a Blender without Hush.
    """
    tree = bpy.data.node_groups.new(".Hush Temporal Denoise", "CompositorNodeTree")
    for direction in ("INPUT", "OUTPUT"):
        tree.interface.new_socket("Image", in_out=direction, socket_type="NodeSocketColor")

    def add(kind: str, name: str, x: float, y: float) -> bpy.types.Node:
        node = tree.nodes.new(kind)
        node.name = node.label = name
        node.location = (x, y)
        return node

    def math(operation: str, *values: float | bpy.types.NodeSocket) -> bpy.types.NodeSocket:
        node = add(compat.MATH_NODE, operation, x=200 * len(tree.nodes) - 600, y=-300)
        node.operation = operation
        for socket, value in zip(node.inputs, values, strict=False):
            if isinstance(value, bpy.types.NodeSocket):
                tree.links.new(value, socket)
            else:
                socket.default_value = value
        return node.outputs[0]

    incoming = add("NodeGroupInput", "Incoming", -400, 300).outputs[0]
    images = [add("CompositorNodeImage", name, -800, -400 * i) for i, name in enumerate(names(views))]
    for image in images:
        image.frame_offset = NOWHERE
    guard = add("CompositorNodeSeparateColor", GUARD, -200, -300)
    red, green, blue, alpha = guard.outputs[:4]
    see_through = math("MAXIMUM", math("MULTIPLY", alpha, math("SUBTRACT", 1.0, alpha)), 0.0)
    light = math("ADD", red, math("ADD", green, blue))
    magenta = math("MULTIPLY", math("COMPARE", red, 1.0, 0.0), math("COMPARE", blue, 1.0, 0.0))
    present = math("GREATER_THAN", math("ADD", light, see_through), math("MULTIPLY", magenta, 2.0))
    choice = compat.new_choice(tree)
    choice.node.name = choice.node.label = CHOICE
    choice.node.location = (1700, 200)
    out = add("NodeGroupOutput", "Result", 1900, 200)
    tree.links.new(present, choice.choose)
    tree.links.new(incoming, choice.a)
    tree.links.new(choice.result, out.inputs[0])
    # What is not connected must look like a missing file.
    guard.inputs[0].default_value = choice.b.default_value = _NOTHING
    if len(views) > 1:
        chosen = add("CompositorNodeSwitchView", VIEWS, -500, 0)
        for socket in chosen.inputs:
            socket.default_value = _NOTHING
        tree.links.new(chosen.outputs[0], guard.inputs[0])
        tree.links.new(chosen.outputs[0], choice.b)
    tree[_FORM_KEY] = _form(views)
    return tree


def show_frames(tree: bpy.types.NodeTree, shown: Iterable[int], now: int) -> None:
    """Keys the Image nodes so that they find files at these frames only; `now` is the current one.

    Blender sees what Python changes right before a frame is rendered one frame too late, but keys at once; and files that are not
    whole are never opened, which crashes some versions.
    """
    shown = set(shown)
    # From each of these frames on: here or nowhere.
    wanted = [(float(min(shown) - 1), float(NOWHERE))] if shown else []
    for frame in sorted({frame for n in shown for frame in (n, n + 1)}):
        value = float(HERE if frame in shown else NOWHERE)
        if wanted[-1][1] != value:
            wanted.append((float(frame), value))
    images = [node for node in tree.nodes if node.name.startswith(FRAMES)]
    curves = {curve.data_path: curve for curve in compat.fcurves(tree)}
    paths = [image.path_from_id("frame_offset") for image in images]
    if any(wanted != ([tuple(p.co) for p in curves[path].keyframe_points] if path in curves else []) for path in paths):
        clear_animation(tree)
        for image in images if wanted else ():
            image.keyframe_insert("frame_offset", frame=wanted[0][0])
        for curve in compat.fcurves(tree):
            curve.keyframe_points.add(len(wanted) - 1)
            for point, key in zip(curve.keyframe_points, wanted, strict=True):
                point.co = key
                point.interpolation = "CONSTANT"
            curve.update()
    for image in images:
        value = HERE if now in shown else NOWHERE
        if image.frame_offset != value:
            image.frame_offset = value


def users(tree: bpy.types.NodeTree) -> int:
    """How many nodes have the tree inside; Blender's own count is one too high in some versions."""
    return sum(getattr(node, "node_tree", None) == tree for other in compat.compositor_trees() for node in other.nodes)


def remove(tree: bpy.types.NodeTree) -> None:
    """Takes a tree out of the file, with its keys."""
    clear_animation(tree)
    bpy.data.node_groups.remove(tree)


def clear_animation(tree: bpy.types.NodeTree) -> None:
    """Takes a tree's keys away, and the action that held them."""
    action = tree.animation_data.action if tree.animation_data else None
    tree.animation_data_clear()
    if action is not None and action.users == 0:
        bpy.data.actions.remove(action)


def own_copy(tree: bpy.types.NodeTree) -> bpy.types.NodeTree:
    """A copy with keys of its own."""
    copied = tree.copy()
    clear_animation(copied)
    return copied

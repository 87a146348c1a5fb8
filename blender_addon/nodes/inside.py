# SPDX-FileCopyrightText: 2026 Hush authors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The tree of a Temporal Denoise node: a Switch between the incoming image and the file of one denoised frame.

It is a plain node group. A node class of Python's own has all compositing skipped in Blender 4.5 and 5.0 where the class is missing,
crashes 4.2 when the class goes while a node is there, and its private tree loses users until it is purged.

A driver turns the Switch on at one frame, the one in the tree's custom property `hush_shown`. Such a simple expression is evaluated
without Hush and without the permission to run scripts, so every other frame passes the incoming image through. The property can be
written from a render's own thread; what Blender renders is read from it anew.
"""

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import bpy

from .. import compat

FORM_KEY, FORM = "hush_form", "4"
SHOWN_KEY = "hush_shown"
# What no frame has as its number; a whole number for a driver, which reckons in single precision.
NO_FRAME = -(2**30)
NAME, FRAME, CHOICE = "Temporal Denoise", "Denoised Frame", "Denoised or Incoming"
_EXPRESSION = "frame == shown"


@dataclass(frozen=True)
class Picture:
    """The file of a denoised frame: its path, size in bytes and time of change, and the view layers of which the first found is shown.

    `space` is the colour space of its pixels; `relative` whether the path shall be beside the .blend.
    """

    path: Path
    stamp: tuple[int, int]
    layers: tuple[str, ...]
    relative: bool
    space: str


# By tree: what the image's pixels were read from.
_read: dict[int, Picture] = {}


def is_one(tree: bpy.types.NodeTree | None) -> bool:
    """Whether a tree is that of a Temporal Denoise node."""
    return tree is not None and tree.bl_idname == "CompositorNodeTree" and FORM_KEY in tree


def build() -> bpy.types.NodeTree:
    """A new tree that passes its input through, with an image of its own."""
    tree = bpy.data.node_groups.new(NAME, "CompositorNodeTree")
    for direction in ("INPUT", "OUTPUT"):
        tree.interface.new_socket("Image", in_out=direction, socket_type="NodeSocketColor")
    fill(tree)
    return tree


def fill(tree: bpy.types.NodeTree) -> None:
    """Makes the inside of a tree anew; its sockets stay, and so do the links of its nodes."""
    image = _own_image(tree) or _new_image()
    tree.animation_data_clear()
    tree.nodes.clear()
    tree[SHOWN_KEY] = NO_FRAME

    def add(kind: str, name: str, x: float, y: float) -> bpy.types.Node:
        node = tree.nodes.new(kind)
        node.name = node.label = name
        node.location = (x, y)
        return node

    incoming = add("NodeGroupInput", "Incoming", -300, 150)
    frame = add("CompositorNodeImage", FRAME, -400, -50)
    frame.image = image
    choice = add("CompositorNodeSwitch", CHOICE, 0, 50)
    result = add("NodeGroupOutput", "Result", 250, 50)
    tree.links.new(incoming.outputs[0], choice.inputs["Off"])
    tree.links.new(choice.outputs[0], result.inputs[0])
    owner, name = _chosen(choice)
    driver = owner.driver_add(name).driver
    shown = driver.variables.new()
    shown.name, shown.type = "shown", "SINGLE_PROP"
    target = shown.targets[0]
    target.id_type, target.id, target.data_path = "NODETREE", tree, f'["{SHOWN_KEY}"]'
    driver.expression = _EXPRESSION
    tree[FORM_KEY] = FORM
    _read.pop(tree.session_uid, None)


def is_sound(tree: bpy.types.NodeTree) -> bool:
    """Whether all that decides what is shown is as `fill` made it, in this Blender."""
    frame, choice = tree.nodes.get(FRAME), tree.nodes.get(CHOICE)
    if tree.get(FORM_KEY) != FORM or SHOWN_KEY not in tree or frame is None or choice is None or tree.animation_data is None:
        return False
    if frame.bl_idname != "CompositorNodeImage" or choice.bl_idname != "CompositorNodeSwitch" or choice.mute:
        return False
    if _own_image(tree) is None:
        return False
    owner, name = _chosen(choice)
    paths = {curve.data_path: curve for curve in tree.animation_data.drivers}
    curve = paths.get(f"{owner.path_from_id()}.{name}")
    if curve is None or curve.mute or curve.driver.expression != _EXPRESSION or len(curve.driver.variables) != 1:
        return False
    target = curve.driver.variables[0].targets[0]
    return target.id == tree and target.data_path == f'["{SHOWN_KEY}"]'


def shown_frame(tree: bpy.types.NodeTree) -> int | None:
    """The frame at which the denoised file is shown, None where the input passes through at all frames."""
    frame = tree.get(SHOWN_KEY, NO_FRAME)
    return None if frame == NO_FRAME else frame


def show(tree: bpy.types.NodeTree, frame: int, picture: Picture) -> bool:
    """Shows a denoised file at a frame; False where it has none of the view layers. Writes nothing where it is shown already."""
    node = tree.nodes[FRAME]
    known = _read.get(tree.session_uid)
    image = node.image
    if known == picture and not _is_of(image, picture.path):
        known = None
    if known == picture and shown_frame(tree) == frame and tree.nodes[CHOICE].inputs["On"].is_linked:
        return True
    if known != picture:
        _load(image, picture)
        # Its sockets are those of the new file.
        node.image = image
        _read[tree.session_uid] = picture
    if not _connect(tree, picture.layers):
        hide(tree)
        return False
    tree[SHOWN_KEY] = frame
    _set_chosen(tree, True)
    return True


def hide(tree: bpy.types.NodeTree) -> None:
    """Passes the incoming image through, and has Blender composite again where it did not. From the main thread."""
    if pass_through(tree) or _is_chosen(tree):
        _set_chosen(tree, False)


def pass_through(tree: bpy.types.NodeTree) -> bool:
    """Passes the incoming image through in what is rendered or read from now on; from any thread. False where it did already."""
    if shown_frame(tree) is None:
        return False
    tree[SHOWN_KEY] = NO_FRAME
    return True


def resume(tree: bpy.types.NodeTree, frame: int) -> None:
    """Shows what was shown before `hide` and `unload`."""
    picture = _read.get(tree.session_uid)
    if picture is not None and is_sound(tree):
        show(tree, frame, picture)


def unload(tree: bpy.types.NodeTree) -> None:
    """Leaves nothing of a denoised frame that the open file could hold: what was packed goes, and nothing is there to be packed."""
    image = _own_image(tree)
    if image is None:
        return
    _unpack(image)
    if bpy.data.use_autopack:
        image.source = "GENERATED"


def forget() -> None:
    """Another file was opened: no pixels are read yet."""
    _read.clear()


def _own_image(tree: bpy.types.NodeTree) -> bpy.types.Image | None:
    """A tree's image; none where it is that of an earlier tree, whose frames it would show, as after the tree was copied."""
    image = getattr(tree.nodes.get(FRAME), "image", None)
    for other in bpy.data.node_groups:
        if other == tree:
            return image
        if image is not None and is_one(other) and getattr(other.nodes.get(FRAME), "image", None) == image:
            return None
    return image


def _new_image() -> bpy.types.Image:
    image = bpy.data.images.new(NAME, 1, 1)
    image.source = "FILE"
    compat.use_space(image, compat.working_space())
    return image


def _load(image: bpy.types.Image, picture: Picture) -> None:
    """Points an image at a file and has its pixels read anew, as Blender keeps those of a file that was written again."""
    _unpack(image)
    image.source = "FILE"
    compat.use_space(image, picture.space)
    if _is_at(image, picture.path):
        image.reload()
        return
    path = str(picture.path)
    try:
        image.filepath = bpy.path.relpath(path) if picture.relative and bpy.data.is_saved else path
    except ValueError:
        # Another drive of Windows.
        image.filepath = path


def _is_of(image: bpy.types.Image, path: Path) -> bool:
    """Whether an image's pixels are those of a file, and not of a copy in the open file, as after Pack Resources."""
    return image.source == "FILE" and image.packed_file is None and _is_at(image, path)


def _is_at(image: bpy.types.Image, path: Path) -> bool:
    """Whether an image's file is this one; a path beside the .blend may lead out of its folder, by `..`."""
    return os.path.normpath(bpy.path.abspath(image.filepath, library=image.library)) == os.path.normpath(path)


def _unpack(image: bpy.types.Image) -> None:
    if image.packed_file is not None:
        image.unpack(method="REMOVE")


def _connect(tree: bpy.types.NodeTree, layers: Sequence[str]) -> bool:
    """Connects the first of the view layers that the file has."""
    node = tree.nodes[FRAME]
    found = not node.has_layers
    for name in () if found else layers:
        try:
            if node.layer != name:
                node.layer = name
        except TypeError:
            continue
        found = True
        break
    combined = next((node.outputs[name] for name in ("Combined", "Image") if name in node.outputs), None) if found else None
    if combined is None:
        return False
    target = tree.nodes[CHOICE].inputs["On"]
    if not target.is_linked or target.links[0].from_socket != combined:
        tree.links.new(combined, target)
    return True


def _chosen(choice: bpy.types.Node) -> tuple[bpy.types.bpy_struct, str]:
    """What turns a Switch on, as owner and name: a property of its own before Blender 4.5, then a socket."""
    first = choice.inputs[0]
    return (first, "default_value") if first.type == "BOOLEAN" else (choice, "check")


def _is_chosen(tree: bpy.types.NodeTree) -> bool:
    choice = tree.nodes.get(CHOICE)
    return choice is not None and getattr(*_chosen(choice))


def _set_chosen(tree: bpy.types.NodeTree, value: bool) -> None:
    """What the driver says, said in the way that has Blender composite again; a file is saved with it, also for other versions."""
    choice = tree.nodes.get(CHOICE)
    if choice is not None:
        owner, name = _chosen(choice)
        setattr(owner, name, value)
        tree.update_tag()

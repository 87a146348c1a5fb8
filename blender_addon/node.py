# SPDX-FileCopyrightText: 2026 Hush authors
# SPDX-License-Identifier: Apache-2.0
"""The compositor node that shows the denoised frames, and the incoming image where there are none."""

import os
import re
from collections.abc import Iterator
from pathlib import Path

import bpy
from bpy.props import PointerProperty, StringProperty

from . import compat, exr, shot

FRAMES = "Denoised Frames"
SWITCH = "Denoised or Incoming"
GUARD = "Is There a Picture"
_NUMBER = re.compile(r"^(.*?)(\d+)(\D*)$")
# Blender's own highest frame number.
_LAST_FRAME = 1048574
# Of the inner tree; one of another form is built anew.
_FORM_KEY, _FORM = "hush_form", 1
_why: dict[int, str] = {}


def _retarget(self: "HushTemporalDenoiseNode", context: bpy.types.Context) -> None:
    owners = [scene for scene in bpy.data.scenes if any(node == self for node in nodes(scene))]
    sync_node(self, (owners or [context.scene])[0])


class HushTemporalDenoiseNode(bpy.types.CompositorNodeCustomGroup):
    """Shows the denoised frames of the shot. Where a frame is not denoised yet, the image passes through"""

    bl_idname = "HushTemporalDenoiseNode"
    bl_label = "Temporal Denoise"
    bl_icon = "SHADERFX"
    bl_width_default = 240
    bl_width_min = 180

    source_scene: PointerProperty(
        type=bpy.types.Scene,
        name="Scene",
        description="Scene whose denoised frames to show. Empty: the scene that is composited",
        update=_retarget,
    )
    view_layer: StringProperty(
        name="View Layer",
        description="View layer to show. Empty: the first one that is rendered",
        update=_retarget,
    )

    @classmethod
    def poll(cls, tree: bpy.types.NodeTree) -> bool:
        """Only in the compositor."""
        return tree.bl_idname == "CompositorNodeTree"

    def init(self, context: bpy.types.Context) -> None:
        """Each node has a tree of its own inside, so that it can show its own files."""
        self.node_tree = _build()

    def copy(self, original: bpy.types.Node) -> None:
        """A copy gets its own inner tree."""
        self.node_tree = original.node_tree.copy() if original.node_tree else _build()

    def free(self) -> None:
        """Takes the inner tree along when the node is deleted."""
        tree = self.node_tree
        if tree is not None and tree.users <= 1 and tree.library is None:
            bpy.data.node_groups.remove(tree)

    def draw_label(self) -> str:
        """The name in the node's header."""
        return self.bl_label

    def draw_buttons(self, context: bpy.types.Context, layout: bpy.types.UILayout) -> None:
        """The shot's settings and how far it is."""
        from . import panel

        panel.draw_node(self, context, layout)


def nodes(scene: bpy.types.Scene) -> Iterator[HushTemporalDenoiseNode]:
    """Every Temporal Denoise node that the scene's compositor reaches, also inside groups."""
    waiting = [compat.compositor_tree(scene)]
    seen = set()
    while waiting:
        tree = waiting.pop()
        if tree is None or tree in seen:
            continue
        seen.add(tree)
        for node in tree.nodes:
            if node.bl_idname == HushTemporalDenoiseNode.bl_idname:
                yield node
            elif getattr(node, "node_tree", None) is not None:
                waiting.append(node.node_tree)


def sync(scene: bpy.types.Scene, *, reload: bool = False) -> None:
    """Points the scene's nodes at its denoised frames; `reload` reads the files again, as after denoising.

    Only from the main thread.
    """
    if reload:
        exr.forget()
    for node in nodes(scene):
        sync_node(node, scene, reload=reload)


def sync_node(node: HushTemporalDenoiseNode, scene: bpy.types.Scene, *, reload: bool = False) -> None:
    """Points one node at the frames of its scene."""
    if node.id_data.library is not None:
        return
    if node.node_tree is None:
        node.node_tree = _build()
    elif node.node_tree.users > 1:
        node.node_tree = node.node_tree.copy()
    source = node.source_scene or scene
    found = _any_file(source) if reload or not _is_loaded(node, source) else None
    if found is not None:
        _show(node, source, *found, reload=reload)
    switch_node(node, scene)


def switch(scene: bpy.types.Scene) -> None:
    """Turns the scene's nodes to the denoised frame where it is there and whole, else to the incoming image."""
    for node in nodes(scene):
        switch_node(node, scene)


def switch_node(node: HushTemporalDenoiseNode, scene: bpy.types.Scene) -> None:
    """The same for one node, at the scene's current frame."""
    inside = node.node_tree.nodes.get(SWITCH) if node.node_tree else None
    if inside is None:
        return
    wrong = problem(node, scene)
    compat.set_switch(inside, on=wrong is None)
    _why[node.node_tree.session_uid] = wrong or ""


def is_on(node: HushTemporalDenoiseNode) -> bool:
    """Whether the node shows the denoised frame; as it was last switched."""
    inside = node.node_tree.nodes.get(SWITCH) if node.node_tree else None
    return inside is not None and compat.is_switched_on(inside)


def why_off(node: HushTemporalDenoiseNode) -> str:
    """Why it does not, as found when it was last switched."""
    return (_why.get(node.node_tree.session_uid) if node.node_tree else "") or "This frame is not denoised"


def problem(node: HushTemporalDenoiseNode, scene: bpy.types.Scene) -> str | None:
    """Why the node passes the incoming image at the current frame, None where it shows the denoised one."""
    source = node.source_scene or scene
    try:
        files = [shot.output_file(source, scene.frame_current, view) for view in shot.views(source)]
    except shot.ShotError as error:
        return str(error)
    frames = node.node_tree.nodes.get(FRAMES) if node.node_tree else None
    if frames is None or frames.image is None or not shows(frames.image, files[0], scene.frame_current):
        return "The denoised frames are not loaded"
    if not _is_linked(frames):
        return "The denoised frames have no image of this view layer"
    sizes = {exr.size_if_whole(file) for file in files}
    if None in sizes:
        return "This frame is not denoised"
    wanted = render_size(source)
    if wanted and sizes != {wanted}:
        width, height = sizes.pop()
        return f"This frame was denoised at {width} × {height}, the scene renders {wanted[0]} × {wanted[1]}"
    return None


def _is_loaded(node: HushTemporalDenoiseNode, scene: bpy.types.Scene) -> bool:
    """Whether the inner tree is as it should be for the scene's files."""
    tree = node.node_tree
    frames = tree.nodes.get(FRAMES)
    if tree.get(_FORM_KEY) != _FORM or frames is None or frames.image is None:
        return False
    try:
        file = shot.output_file(scene, scene.frame_current)
    except shot.ShotError:
        return False
    layers = [node.view_layer] if node.view_layer else shot.layers(scene)
    return shows(frames.image, file, scene.frame_current) and (not frames.has_layers or frames.layer in layers) and _is_linked(frames)


def _is_linked(frames: bpy.types.Node) -> bool:
    return any(link.is_valid and link.to_node.name == "Mix" for link in frames.id_data.links if link.from_node == frames)


def render_size(scene: bpy.types.Scene) -> tuple[int, int] | None:
    """The size the scene renders at, None where it is cropped to a border."""
    render = scene.render
    if render.use_border and render.use_crop_to_border:
        return None
    percentage = render.resolution_percentage
    return render.resolution_x * percentage // 100, render.resolution_y * percentage // 100


def shows(image: bpy.types.Image, file: Path, frame: int) -> bool:
    """Whether the image, a sequence, shows the file at the frame."""
    # Blender takes the last digits of a name for the frame number, wherever the render put it.
    wanted, given = _NUMBER.match(file.name), _NUMBER.match(_path_of(image).name)
    same = wanted and given and (wanted[1], wanted[3]) == (given[1], given[3]) and _path_of(image).parent == file.parent
    return bool(same and int(wanted[2]) == frame)


def _path_of(image: bpy.types.Image) -> Path:
    return Path(bpy.path.abspath(image.filepath, library=image.library))


def _any_file(scene: bpy.types.Scene) -> tuple[Path, int] | None:
    """A denoised file that is whole and its frame, best of the current frame; None where there is none."""
    try:
        folder, pattern = shot.output_folder(scene), shot.frame_pattern(scene)
        present = set(os.listdir(folder))
    except (OSError, shot.ShotError):
        return None
    for frame in (scene.frame_current, *shot.frame_range(scene)):
        name = shot.frame_file(pattern, frame).name
        if name in present and exr.size_if_whole(folder / name):
            return folder / name, frame
    return None


def _show(node: HushTemporalDenoiseNode, scene: bpy.types.Scene, file: Path, frame: int, *, reload: bool) -> None:
    tree = node.node_tree
    if tree.get(_FORM_KEY) != _FORM or not all(name in tree.nodes for name in (FRAMES, SWITCH, GUARD, "Mix")):
        node.node_tree = _build()
        bpy.data.node_groups.remove(tree)
        tree = node.node_tree
    frames = tree.nodes[FRAMES]
    before = frames.image
    image = before if before and shows(before, file, frame) else _image(scene, file, frame)
    _set(image, "use_multiview", scene.render.use_multiview)
    if image.use_multiview:
        _set(image, "views_format", "INDIVIDUAL" if shot.views(scene) != [""] else "MULTIVIEW")
    if reload:
        # Blender keeps the pixels of files that were written again since.
        image.reload()
    if image != before or reload:
        frames.image = image
        if before is not None and before.users == 0:
            bpy.data.images.remove(before)
    # Started at frame 0 and moved by one, the number in the file's name is the scene's frame.
    for name, value in (("frame_start", 0), ("frame_offset", -1), ("frame_duration", _LAST_FRAME), ("use_auto_refresh", True)):
        _set(frames, name, value)
    _link(node, frames, scene)


def _image(scene: bpy.types.Scene, file: Path, frame: int) -> bpy.types.Image:
    """The image of a sequence of files: one that is there already, else a new one."""
    for image in bpy.data.images:
        if image.source == "SEQUENCE" and image.library is None and shows(image, file, frame):
            return image
    image = bpy.data.images.new(f"Denoised {scene.name}", 1, 1)
    image.source = "SEQUENCE"
    try:
        image.colorspace_settings.name = compat.working_space()
    except TypeError:
        # A colour configuration without that name: no conversion at all is the same here.
        image.colorspace_settings.is_data = True
    path = str(file)
    relative = any(p.startswith("//") for p in (scene.render.filepath, scene.hush.input_folder, scene.hush.output_folder))
    image.filepath = bpy.path.relpath(path) if relative and bpy.data.is_saved else path
    return image


def _link(node: HushTemporalDenoiseNode, frames: bpy.types.Node, scene: bpy.types.Scene) -> None:
    """Connects the view layer's image."""
    layers = [node.view_layer] if node.view_layer else shot.layers(scene)
    for name in layers:
        try:
            _set(frames, "layer", name)
            break
        except TypeError:
            continue
    tree = node.node_tree
    wanted = next((frames.outputs[name] for name in ("Combined", "Image") if name in frames.outputs), None)
    guard, mix = tree.nodes[GUARD], tree.nodes["Mix"]
    for target in (guard.inputs[0], compat.mix_sockets(mix).b):
        if wanted and (not target.is_linked or target.links[0].from_socket != wanted):
            tree.links.new(wanted, target)


def _set(owner: object, name: str, value: object) -> None:
    """Sets a property only where it differs, as setting one makes Blender composite again."""
    if getattr(owner, name) != value:
        setattr(owner, name, value)


def _build() -> bpy.types.NodeTree:
    """The tree inside a node: the switch between the incoming image and the denoised one.

    A file that vanishes while its frame is rendered comes out opaque black, in Blender 4.2 magenta. Where the denoised image is
    exactly that, the guard passes the incoming one, also in a Blender without the extension.
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
    frames = add("CompositorNodeImage", FRAMES, -400, 0)
    guard = add("CompositorNodeSeparateColor", GUARD, -200, -300)
    red, green, blue, alpha = guard.outputs[:4]
    see_through = math("MULTIPLY", alpha, math("SUBTRACT", 1.0, alpha))
    light = math("ADD", red, math("ADD", green, blue))
    magenta = math("MULTIPLY", math("COMPARE", red, 1.0, 0.0), math("COMPARE", blue, 1.0, 0.0))
    present = math("GREATER_THAN", math("ADD", light, see_through), math("MULTIPLY", magenta, 2.0))
    mix = compat.new_mix(tree)
    mix.node.name = "Mix"
    mix.node.location = (1300, 200)
    switch_inside = add(compat.SWITCH_NODE, SWITCH, 1500, 300)
    off, on, result = compat.switch_sockets(switch_inside)
    out = add("NodeGroupOutput", "Result", 1700, 300)
    tree.links.new(present, mix.factor)
    tree.links.new(incoming, mix.a)
    tree.links.new(incoming, off)
    tree.links.new(frames.outputs[0], guard.inputs[0])
    tree.links.new(frames.outputs[0], mix.b)
    tree.links.new(mix.result, on)
    tree.links.new(result, out.inputs[0])
    compat.set_switch(switch_inside, on=False)
    tree[_FORM_KEY] = _FORM
    return tree


def register() -> None:
    """Adds the node."""
    bpy.utils.register_class(HushTemporalDenoiseNode)


def unregister() -> None:
    """Takes the node away."""
    bpy.utils.unregister_class(HushTemporalDenoiseNode)
    exr.forget()

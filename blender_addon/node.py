# SPDX-FileCopyrightText: 2026 Hush authors
# SPDX-License-Identifier: Apache-2.0
"""The compositor node that shows the denoised frames, and the incoming image where there are none."""

import os
import re
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import bpy
from bpy.props import PointerProperty, StringProperty

from . import compat, exr, shot

FRAMES, GUARD, MIX = "Denoised Frames", "Is There a Picture", "Denoised or Incoming"
_NUMBER = re.compile(r"^(.*?)(\d+)(\D*)$")
# Blender's own highest frame number.
_LAST_FRAME = 1048574
# Offsets of the Image node: started at frame 0 and moved by one, the scene's frame is the number in the file's name.
_HERE, _NOWHERE = -1, 1_000_000
# Of the inner tree; one of another form, or made by another Blender, is built anew.
_FORM_KEY, _FORM = "hush_form", 2 + 100 * compat.BLENDER_5
_why: dict[int, str] = {}
_plans: dict[int, "_Plan"] = {}


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
        self.node_tree = _own_copy(original.node_tree) if original.node_tree else _build()

    def free(self) -> None:
        """Takes the inner tree along when the node is deleted."""
        tree = self.node_tree
        if tree is not None and tree.users <= 1 and tree.library is None:
            clear_animation(tree)
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


def sync(scene: bpy.types.Scene, *, fresh: bool = False, reload: bool = False) -> None:
    """Points the scene's nodes at its denoised frames. Only from the main thread; cheap where nothing changed.

    `fresh` looks at each file; `reload` also reads the pixels again, as after denoising.
    """
    if reload:
        forget()
    for node in nodes(scene):
        sync_node(node, scene, fresh=fresh, reload=reload)


def sync_node(node: HushTemporalDenoiseNode, scene: bpy.types.Scene, *, fresh: bool = False, reload: bool = False) -> None:
    """Points one node at the frames of its scene."""
    if node.id_data.library is not None:
        return
    tree = node.node_tree
    if tree is None or tree.get(_FORM_KEY) != _FORM or not all(name in tree.nodes for name in (FRAMES, GUARD, MIX)):
        node.node_tree = _build()
        if tree is not None and tree.users == 0:
            bpy.data.node_groups.remove(tree)
    elif tree.users > 1:
        node.node_tree = _own_copy(tree)
    source = node.source_scene or scene
    plan = _plan_of(source, fresh=fresh or reload)
    if plan.frames:
        _show(node, source, plan, reload=reload)
    _set_frames_shown(node.node_tree, plan.frames if plan.reason is None and _is_linked(node.node_tree) else {})
    _why[node.node_tree.session_uid] = plan.reason or ""


def is_on(node: HushTemporalDenoiseNode) -> bool:
    """Whether the node shows a denoised frame at the current frame of the open scene."""
    frames = node.node_tree.nodes.get(FRAMES) if node.node_tree else None
    return frames is not None and frames.frame_offset == _HERE


def why_off(node: HushTemporalDenoiseNode) -> str:
    """Why it does not, in words."""
    return (_why.get(node.node_tree.session_uid) if node.node_tree else "") or "This frame is not denoised"


@dataclass
class _Plan:
    """The denoised frames of a scene: the first view's files by frame; a reason where none can be shown.

    It holds while the folder does not change, unless a file in it is not whole yet, and in any case for a rest after a slow look.
    """

    frames: dict[int, Path]
    reason: str | None = None
    growing: bool = False
    key: object = None
    changed: int = 0
    until: float = 0.0


def forget() -> None:
    """The files changed: the next look is at the disk."""
    exr.forget()
    _plans.clear()


def _plan_of(scene: bpy.types.Scene, *, fresh: bool) -> _Plan:
    """The frames to show, found anew only when folder or settings changed."""
    try:
        folder, views = shot.output_folder(scene), shot.views(scene)
        patterns = [shot.frame_pattern(scene, view) for view in views]
    except shot.ShotError as error:
        return _Plan({}, str(error))
    render = scene.render
    if render.frame_map_old != render.frame_map_new:
        return _Plan({}, "Time stretching is on, which files of frames cannot follow")
    if any(char.isdigit() for pattern in patterns for char in pattern.stem.rpartition("#")[2]):
        return _Plan({}, "The frame number must be the last number in the file names")
    try:
        changed = os.stat(folder).st_mtime_ns
    except OSError:
        return _Plan({}, "Nothing is denoised yet")
    key = (folder, tuple(patterns), render_size(scene))
    known = None if fresh else _plans.get(scene.session_uid)
    if known and known.key == key and (known.changed == changed and not known.growing or time.monotonic() < known.until):
        return known
    began = time.monotonic()
    plan = _plans[scene.session_uid] = _find(folder, patterns, render_size(scene))
    now = time.monotonic()
    plan.key, plan.changed, plan.until = key, changed, now + 50 * (now - began)
    return plan


def _find(folder: Path, patterns: list[Path], wanted: tuple[int, int] | None) -> _Plan:
    head, tail = re.split("#+", patterns[0].name)
    frames, others, growing = {}, set(), False
    for name in sorted(os.listdir(folder)):
        number = name[len(head) : len(name) - len(tail)]
        if not (name.startswith(head) and name.endswith(tail) and number.isdigit()):
            continue
        files = [folder / shot.frame_file(pattern, int(number)).name for pattern in patterns]
        sizes = {exr.size_if_whole(file) for file in files}
        if files[0].name != name:
            continue
        if None in sizes:
            growing = True
        elif wanted is None or sizes == {wanted}:
            frames[int(number)] = files[0]
        else:
            others |= sizes
    if others and not frames:
        width, height = others.pop()
        return _Plan({}, f"The frames were denoised at {width} × {height}, the scene renders {wanted[0]} × {wanted[1]}")
    return _Plan(frames, None if frames else "Nothing is denoised yet", growing)


def render_size(scene: bpy.types.Scene) -> tuple[int, int] | None:
    """The size the scene renders at, None where it is cropped to a border."""
    render = scene.render
    if render.use_border and render.use_crop_to_border:
        return None
    percentage = render.resolution_percentage
    return render.resolution_x * percentage // 100, render.resolution_y * percentage // 100


def _show(node: HushTemporalDenoiseNode, scene: bpy.types.Scene, plan: _Plan, *, reload: bool) -> None:
    frames = node.node_tree.nodes[FRAMES]
    before = frames.image
    image = before if before and _is_of(before, plan) else _image(scene, plan)
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
    for name, value in (("frame_start", 0), ("frame_duration", _LAST_FRAME), ("use_auto_refresh", True)):
        _set(frames, name, value)
    _link(node, frames, scene)


def _is_of(image: bpy.types.Image, plan: _Plan) -> bool:
    """Whether the image is the sequence of the plan's files."""
    return Path(bpy.path.abspath(image.filepath, library=image.library)) in plan.frames.values()


def _image(scene: bpy.types.Scene, plan: _Plan) -> bpy.types.Image:
    """The image of a sequence of files: one that is there already, else a new one."""
    for image in bpy.data.images:
        if image.source == "SEQUENCE" and image.library is None and _is_of(image, plan):
            return image
    image = bpy.data.images.new(f"Denoised {scene.name}", 1, 1)
    image.source = "SEQUENCE"
    try:
        image.colorspace_settings.name = compat.working_space()
    except TypeError:
        # A colour configuration without that name: no conversion at all is the same here.
        image.colorspace_settings.is_data = True
    path = str(next(iter(plan.frames.values())))
    relative = any(p.startswith("//") for p in (scene.render.filepath, scene.hush.input_folder, scene.hush.output_folder))
    image.filepath = bpy.path.relpath(path) if relative and bpy.data.is_saved else path
    return image


def _link(node: HushTemporalDenoiseNode, frames: bpy.types.Node, scene: bpy.types.Scene) -> None:
    """Connects the view layer's image; nothing where the files do not have it."""
    tree = node.node_tree
    found = not frames.has_layers
    for name in [] if found else [node.view_layer] if node.view_layer else shot.layers(scene):
        try:
            _set(frames, "layer", name)
        except TypeError:
            continue
        found = True
        break
    wanted = next((frames.outputs[name] for name in ("Combined", "Image") if name in frames.outputs), None) if found else None
    for target in (tree.nodes[GUARD].inputs[0], compat.mix_sockets(tree.nodes[MIX]).b):
        if wanted is None:
            for link in target.links:
                tree.links.remove(link)
        elif not target.is_linked or target.links[0].from_socket != wanted:
            tree.links.new(wanted, target)


def _is_linked(tree: bpy.types.NodeTree) -> bool:
    """Whether the image of the view layer is connected."""
    return compat.mix_sockets(tree.nodes[MIX]).b.is_linked


def _set_frames_shown(tree: bpy.types.NodeTree, shown: Iterable[int]) -> None:
    """Keys the Image node so that it finds files at these frames only.

    Blender sees what Python changes right before a frame is rendered one frame too late, but keys at once; and files that are not
    whole are never opened, which crashes some versions.
    """
    shown = set(shown)
    frames = tree.nodes[FRAMES]
    # From each of these frames on: here or nowhere.
    keys = sorted({frame for n in shown for frame in (n, n + 1)})
    wanted = [(float(min(shown) - 1), float(_NOWHERE))] if shown else []
    for frame in keys:
        value = float(_HERE if frame in shown else _NOWHERE)
        if wanted[-1][1] != value:
            wanted.append((float(frame), value))
    curve = next((c for c in compat.fcurves(tree) if c.data_path == frames.path_from_id("frame_offset")), None)
    if wanted == ([tuple(point.co) for point in curve.keyframe_points] if curve else []):
        return
    clear_animation(tree)
    frames.frame_offset = _NOWHERE
    if not wanted:
        return
    frames.keyframe_insert("frame_offset", frame=wanted[0][0])
    curve = next(iter(compat.fcurves(tree)))
    curve.keyframe_points.add(len(wanted) - 1)
    for point, key in zip(curve.keyframe_points, wanted, strict=True):
        point.co = key
        point.interpolation = "CONSTANT"
    curve.update()
    current = bpy.context.scene.frame_current if bpy.context.scene else 0
    frames.frame_offset = round(curve.evaluate(current))


def clear_animation(tree: bpy.types.NodeTree) -> None:
    """Takes a tree's keys away, and the action that held them."""
    action = tree.animation_data.action if tree.animation_data else None
    tree.animation_data_clear()
    if action is not None and action.users == 0:
        bpy.data.actions.remove(action)


def _own_copy(tree: bpy.types.NodeTree) -> bpy.types.NodeTree:
    """A copy with keys of its own."""
    copied = tree.copy()
    clear_animation(copied)
    return copied


def _set(owner: object, name: str, value: object) -> None:
    """Sets a property only where it differs, as setting one makes Blender composite again."""
    if getattr(owner, name) != value:
        setattr(owner, name, value)


def _build() -> bpy.types.NodeTree:
    """The tree inside a node: the denoised image, and the incoming one wherever there is none.

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
    frames = add("CompositorNodeImage", FRAMES, -400, 0)
    guard = add("CompositorNodeSeparateColor", GUARD, -200, -300)
    red, green, blue, alpha = guard.outputs[:4]
    see_through = math("MULTIPLY", alpha, math("SUBTRACT", 1.0, alpha))
    light = math("ADD", red, math("ADD", green, blue))
    magenta = math("MULTIPLY", math("COMPARE", red, 1.0, 0.0), math("COMPARE", blue, 1.0, 0.0))
    present = math("GREATER_THAN", math("ADD", light, see_through), math("MULTIPLY", magenta, 2.0))
    mix = compat.new_mix(tree)
    mix.node.name = mix.node.label = MIX
    mix.node.location = (1700, 200)
    out = add("NodeGroupOutput", "Result", 1900, 200)
    tree.links.new(present, mix.factor)
    tree.links.new(incoming, mix.a)
    tree.links.new(mix.result, out.inputs[0])
    frames.frame_offset = _NOWHERE
    # Not connected they must look like a missing file.
    guard.inputs[0].default_value = mix.b.default_value = (0.0, 0.0, 0.0, 1.0)
    tree[_FORM_KEY] = _FORM
    return tree


def register() -> None:
    """Adds the node."""
    global HushTemporalDenoiseNode
    base = bpy.types.CompositorNodeCustomGroup
    if HushTemporalDenoiseNode.__bases__ != (base,):
        # Blender forgets the base class when a subclass is unregistered, and refuses subclasses of the forgotten one.
        body = {name: value for name, value in vars(HushTemporalDenoiseNode).items() if name not in ("__dict__", "__weakref__")}
        HushTemporalDenoiseNode = type("HushTemporalDenoiseNode", (base,), body)
    bpy.utils.register_class(HushTemporalDenoiseNode)


def unregister() -> None:
    """Takes the node away."""
    bpy.utils.unregister_class(HushTemporalDenoiseNode)
    forget()
    _why.clear()

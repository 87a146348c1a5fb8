# SPDX-FileCopyrightText: 2026 Hush authors
# SPDX-License-Identifier: Apache-2.0
"""The compositor node that shows the denoised frames, and the incoming image where there are none."""

import os
import re
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import bpy
from bpy.props import PointerProperty, StringProperty

from . import compat, exr, inside, shot

# Blender's own highest frame number.
_LAST_FRAME = 1048574
IDNAME, LABEL, ICON = "HushTemporalDenoiseNode", "Temporal Denoise", "SHADERFX"
_why: dict[int, str] = {}
_plans: dict[int, "_Plan"] = {}
_classes: list[type] = []


def _retarget(self: "TemporalDenoise", context: bpy.types.Context) -> None:
    owners = [scene for scene in bpy.data.scenes if any(node == self for node in nodes(scene))]
    sync_node(self, (owners or [context.scene])[0])


class TemporalDenoise:
    """Shows the denoised frames of the shot. Where a frame is not denoised yet, the image passes through"""

    bl_idname = IDNAME
    bl_label = LABEL
    bl_icon = ICON
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
        self.node_tree = inside.build([""])

    def copy(self, original: bpy.types.Node) -> None:
        """A copy gets its own inner tree."""
        self.node_tree = inside.own_copy(original.node_tree) if original.node_tree else inside.build([""])

    def free(self) -> None:
        """Takes the inner tree along when the node is deleted."""
        tree = self.node_tree
        if tree is not None and tree.library is None and inside.users(tree) <= 1:
            inside.remove(tree)

    def draw_label(self) -> str:
        """The name in the node's header."""
        return self.bl_label

    def draw_buttons(self, context: bpy.types.Context, layout: bpy.types.UILayout) -> None:
        """The shot's settings and how far it is."""
        from . import panel

        panel.draw_node(self, context, layout)


def nodes(scene: bpy.types.Scene) -> Iterator[TemporalDenoise]:
    """Every Temporal Denoise node that the scene's compositor reaches, also inside groups."""
    waiting = [compat.compositor_tree(scene)]
    seen = set()
    while waiting:
        tree = waiting.pop()
        if tree is None or tree in seen:
            continue
        seen.add(tree)
        for node in tree.nodes:
            if node.bl_idname == IDNAME:
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


def sync_node(node: TemporalDenoise, scene: bpy.types.Scene, *, fresh: bool = False, reload: bool = False) -> None:
    """Points one node at the frames of its scene."""
    if node.id_data.library is not None:
        return
    source = node.source_scene or scene
    tree, views = node.node_tree, shot.stereo_views(source)
    if not inside.is_sound(tree, views):
        node.node_tree = inside.build(views)
        if tree is not None and inside.users(tree) == 0:
            inside.remove(tree)
    elif inside.users(tree) > 1:
        node.node_tree = inside.own_copy(tree)
    tree = node.node_tree
    plan = _plan_of(source, fresh=fresh or reload)
    if plan.files:
        for view, name in zip(views, inside.names(views), strict=True):
            _show(node, source, tree.nodes[name], view, plan, reload=reload)
    wrong = plan.reason or (None if inside.is_linked(tree, views) else "The denoised frames do not have this view layer")
    _why[tree.session_uid] = wrong or ""
    inside.show_frames(tree, [] if wrong else plan.files, scene.frame_current)


def is_on(node: TemporalDenoise) -> bool:
    """Whether the node shows a denoised frame at the current frame of the open scene."""
    images = [each for each in node.node_tree.nodes if each.name.startswith(inside.FRAMES)] if node.node_tree else []
    return any(image.frame_offset == inside.HERE for image in images)


def why_off(node: TemporalDenoise) -> str:
    """Why it does not, in words."""
    return (_why.get(node.node_tree.session_uid) if node.node_tree else "") or "This frame is not denoised"


@dataclass
class _Plan:
    """The denoised frames of a scene: a file for each view by frame; a reason where none can be shown.

    It holds while the folder does not change, unless a file in it is not whole yet, and in any case for a rest after a slow look.
    """

    files: dict[int, list[Path]]
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
        changed = None
    if changed is None or not folder.is_dir():
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
            frames[int(number)] = files
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


def _show(node: TemporalDenoise, scene: bpy.types.Scene, frames: bpy.types.Node, view: str, plan: _Plan, *, reload: bool) -> None:
    """Gives an Image node the files of its view."""
    own_files = view and shot.views(scene) != [""]
    files = [row[shot.views(scene).index(view) if own_files else 0] for row in plan.files.values()]
    before = frames.image
    image = before if before and _path_of(before) in files else _image(scene, files)
    _set(image, "use_multiview", bool(view and not own_files))
    if reload:
        # Blender keeps the pixels of files that were written again since.
        image.reload()
    if image != before or reload:
        frames.image = image
        if before is not None and before.users == 0:
            bpy.data.images.remove(before)
    for name, value in (("frame_start", 0), ("frame_duration", _LAST_FRAME), ("use_auto_refresh", True)):
        _set(frames, name, value)
    if frames.has_views:
        # Left to itself, Blender 5.0 shows the first view of a file for all.
        _set(frames, "view", view or "ALL")
    _link(node, scene, frames, view)


def _path_of(image: bpy.types.Image) -> Path:
    return Path(bpy.path.abspath(image.filepath, library=image.library))


def _image(scene: bpy.types.Scene, files: list[Path]) -> bpy.types.Image:
    """The image of a sequence of files: one that is there already, else a new one."""
    for image in bpy.data.images:
        if image.source == "SEQUENCE" and image.library is None and _path_of(image) in files:
            return image
    image = bpy.data.images.new(f"Denoised {scene.name}", 1, 1)
    image.source = "SEQUENCE"
    try:
        image.colorspace_settings.name = compat.working_space()
    except TypeError:
        # A colour configuration without that name: no conversion at all is the same here.
        image.colorspace_settings.is_data = True
    path = str(files[0])
    relative = any(p.startswith("//") for p in (scene.render.filepath, scene.hush.input_folder, scene.hush.output_folder))
    image.filepath = bpy.path.relpath(path) if relative and bpy.data.is_saved else path
    return image


def _link(node: TemporalDenoise, scene: bpy.types.Scene, frames: bpy.types.Node, view: str) -> None:
    """Connects the view layer's image; nothing where the files do not have it."""
    found = not frames.has_layers
    for name in [] if found else [node.view_layer] if node.view_layer else shot.layers(scene):
        try:
            _set(frames, "layer", name)
        except TypeError:
            continue
        found = True
        break
    wanted = next((frames.outputs[name] for name in ("Combined", "Image") if name in frames.outputs), None) if found else None
    links = node.node_tree.links
    for target in inside.targets(node.node_tree, view):
        if wanted is None:
            for link in target.links:
                links.remove(link)
        elif not target.is_linked or target.links[0].from_socket != wanted:
            links.new(wanted, target)


def _set(owner: object, name: str, value: object) -> None:
    """Sets a property only where it differs, as setting one makes Blender composite again."""
    if getattr(owner, name) != value:
        setattr(owner, name, value)


def register() -> None:
    """Adds the node."""
    # Blender makes its class of custom groups anew whenever one is unregistered, so the node's is made here.
    _classes.append(type(IDNAME, (TemporalDenoise, bpy.types.CompositorNodeCustomGroup), {"__doc__": TemporalDenoise.__doc__}))
    bpy.utils.register_class(_classes[-1])


def unregister() -> None:
    """Takes the node away."""
    while _classes:
        bpy.utils.unregister_class(_classes.pop())
    forget()
    _why.clear()

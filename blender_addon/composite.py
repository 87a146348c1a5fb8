# SPDX-FileCopyrightText: 2026 Hush authors
# SPDX-License-Identifier: Apache-2.0
"""Composite Denoised: only the compositor over the frame range, without rendering again.

It works on a copy of the scene, whose Render Layers nodes are replaced by the files of the frames with all their passes. The scene
itself is never changed, and the copy is gone before Blender does anything else.
"""

import time
from collections.abc import Iterator
from pathlib import Path

import bpy
from bpy.props import StringProperty

from . import check, compat, exr, job, node, prepare, refresh, shot

_RENDER_LAYERS = "CompositorNodeRLayers"
_CRYPTOMATTE = "CompositorNodeCryptomatteV2"
_FILE_OUTPUT = "CompositorNodeOutputFile"
_TICK, _AT_A_TIME = 0.05, 1.0
_LAYERS_OF_OTHERS = "Scene {} is in the composite too: it is rendered again, noisy"


class CompositeError(Exception):
    """Why the shot cannot be composited."""


def folder(scene: bpy.types.Scene) -> Path:
    """Where the composited frames go."""
    given = scene.hush.composite_folder.strip()
    if given:
        return Path(bpy.path.abspath(given, library=scene.library))
    return shot.frame_pattern(scene).parent / "composited"


class Stage:
    """A copy of a scene that composites files; a context manager, which takes the copy away again."""

    def __init__(self, scene: bpy.types.Scene) -> None:
        self._check(scene)
        self.warnings: list[str] = []
        self._scene = scene
        self._folder = folder(scene)
        self._pattern = shot.frame_pattern(scene)
        self._shows_denoised = any(node.nodes(scene))
        self._groups: list[bpy.types.NodeTree] = []
        self._copy: bpy.types.Scene | None = None
        self._image: bpy.types.Image | None = None
        self._before: set[int] = set()
        self._path = ""
        self._view = ""

    @staticmethod
    def _check(scene: bpy.types.Scene) -> None:
        if compat.compositor_tree(scene) is None:
            raise CompositeError("The scene has no compositor nodes: add a Temporal Denoise node in the compositor first")
        if scene.render.use_multiview and shot.views(scene) == [""] and not compat.READS_VIEWS_OF_ONE_FILE:
            raise CompositeError("Blender 5 reads only one view of files that hold several: render with Views Format Individual")
        target = folder(scene)
        taken = {pattern.parent for pattern in shot.frame_patterns(scene)} | {shot.output_folder(scene)}
        if any(target.resolve() == other.resolve() for other in taken):
            raise CompositeError(f"Composited frames would replace others in {target}: choose another folder")
        wrong = check.why_not_writable(target)
        if wrong:
            raise CompositeError(wrong)

    def __enter__(self) -> "Stage":
        try:
            self._build()
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        if self._copy is not None:
            compat.remove_with_tree(self._copy)
        for group in reversed(self._groups):
            bpy.data.node_groups.remove(group)
        # The copy's Temporal Denoise nodes have trees, images and keys of their own.
        for group in [each for each in bpy.data.node_groups if each.session_uid not in self._before and each.name.startswith(".Hush")]:
            bpy.data.node_groups.remove(group)
        for kind in (bpy.data.images, bpy.data.actions):
            for each in [each for each in kind if each.session_uid not in self._before and each.users == 0]:
                kind.remove(each)
        self._copy, self._image, self._groups = None, None, []

    def composite(self, frame: int) -> str:
        """Composites a frame into its file; `denoised`, `noisy`, or `missing` where there is nothing to composite.

        Raises:
            CompositeError: Blender did not write the file.
        """
        states = [self._composite_view(frame, view) for view in shot.views(self._scene)]
        return next(state for state in ("missing", "noisy", "denoised") if state in states)

    def _composite_view(self, frame: int, view: str) -> str:
        state, file = source(self._scene, frame, view, noisy=self._shows_denoised)
        if file is None:
            return state
        self._turn_to(view)
        self._image.filepath = str(file)
        copy = self._copy
        copy.frame_start = copy.frame_end = frame
        began = time.time()
        try:
            bpy.ops.render.render(animation=True, scene=copy.name)
        except RuntimeError as error:
            raise CompositeError(f"Frame {frame}: {str(error).removeprefix('Error: ').strip()}") from error
        for name in shot.views(copy):
            written = Path(copy.render.frame_path(frame=frame, view=name))
            # Some file systems keep the time of a file to two seconds only.
            if not written.is_file() or written.stat().st_mtime < began - 3:
                raise CompositeError(f"Frame {frame}: Blender did not write {written}")
        return state

    def _turn_to(self, view: str) -> None:
        """Views with files of their own are composited one by one: Blender reads only the first one's passes."""
        if view == self._view:
            return
        self._view = view
        self._copy.render.filepath = self._path + self._scene.render.views[view].file_suffix
        self._copy.hush.input_folder = str(shot.frame_pattern(self._scene, view))
        node.sync(self._copy)

    def _build(self) -> None:
        scene = self._scene
        view = shot.views(scene)[0]
        states = [source(scene, frame, view, noisy=self._shows_denoised) for frame in shot.frame_range(scene)]
        first = next((file for _, file in states if file), None)
        if first is None or not any(state == "denoised" for state, _ in states):
            raise CompositeError("No frame of this shot is denoised: press Denoise Shot first")
        self._before = {each.session_uid for each in (*bpy.data.node_groups, *bpy.data.images, *bpy.data.actions)}
        copy = self._copy = scene.copy()
        self._image = self._load(first)
        self._set_output(copy)
        # The copy writes elsewhere, but its frames are those of the scene.
        copy.hush.output_folder = str(shot.output_folder(scene))
        given = scene.hush.input_folder.strip()
        copy.hush.input_folder = bpy.path.abspath(given, library=scene.library) if given else str(self._pattern.parent)
        self._feed(compat.own_compositor_tree(copy))
        node.sync(copy)

    def _load(self, file: Path) -> bpy.types.Image:
        image = bpy.data.images.load(str(file))
        image.use_multiview = self._scene.render.use_multiview and shot.views(self._scene) == [""]
        return image

    def _set_output(self, copy: bpy.types.Scene) -> None:
        render, settings = copy.render, copy.render.image_settings
        views = settings.views_format
        compat.use_image_format(settings, self._scene.hush.composite_format)
        settings.color_mode, settings.color_depth = "RGBA", "16"
        if views == "INDIVIDUAL":
            render.use_multiview = False
        elif render.use_multiview:
            settings.views_format = "STEREO_3D" if settings.file_format == "PNG" else views
        render.filepath = str(self._folder / Path(self._scene.render.filepath.replace("\\", "/")).name)
        if "#" not in Path(render.filepath).name:
            render.filepath += "####"
        self._path = render.filepath
        render.use_file_extension = render.use_overwrite = render.use_compositing = True
        render.use_placeholder = render.use_sequencer = False
        copy.frame_step = 1

    def _feed(self, tree: bpy.types.NodeTree) -> None:
        for each in list(tree.nodes):
            if each.bl_idname == _RENDER_LAYERS:
                self._replace(tree, each)
            elif each.bl_idname == _CRYPTOMATTE and each.source == "RENDER" and self._is_ours(each):
                each.source = "IMAGE"
                each.image = self._image
            elif each.bl_idname == _FILE_OUTPUT and self._would_replace_frames(each):
                each.mute = True
                self.warnings.append(f"File Output node {each.name} would replace the frames of the shot and was left out")
            elif isinstance(each, bpy.types.CompositorNodeGroup) and each.node_tree is not None and _has_renders(each.node_tree):
                each.node_tree = each.node_tree.copy()
                self._groups.append(each.node_tree)
                self._feed(each.node_tree)

    def _is_ours(self, each: bpy.types.Node) -> bool:
        return each.scene in (None, self._scene, self._copy)

    def _would_replace_frames(self, each: bpy.types.Node) -> bool:
        begins = {str(parent / self._pattern.name).split("#")[0] for parent in (self._pattern.parent, shot.output_folder(self._scene))}
        return any(str(Path(path)) in begins or path in begins for path in compat.written_by(each))

    def _replace(self, tree: bpy.types.NodeTree, layers: bpy.types.Node) -> None:
        """Puts the files in place of a Render Layers node, socket by socket."""
        if not self._is_ours(layers):
            self.warnings.append(_LAYERS_OF_OTHERS.format(layers.scene.name))
            return
        files = tree.nodes.new("CompositorNodeImage")
        files.image = self._image
        name = layers.layer
        known = True
        try:
            files.layer = name
        except TypeError:
            # Files of a File Output node have no view layers; those of Blender that lack this one cannot stand in for it.
            known = len({output.name for output in files.outputs} & {"Combined", "Image"}) > 0 and not self._has_named_layers()
        there = {output.name: output for output in files.outputs} if known else {}
        lost = []
        for output in layers.outputs if not layers.mute else ():
            targets = [link.to_socket for link in output.links]
            stand_in = there.get("Combined", there.get("Image")) if output.name == "Image" else there.get(output.name)
            for target in targets if stand_in is not None else ():
                tree.links.new(stand_in, target)
            if targets and stand_in is None:
                lost.append(output.name)
        if lost:
            text = f"The frames do not hold {', '.join(lost)} of view layer {name}; the composite does without"
            self.warnings.append(text)
        tree.nodes.remove(layers)

    def _has_named_layers(self) -> bool:
        try:
            import hush

            told = hush.inspect(bpy.path.abspath(self._image.filepath))
        except (ImportError, OSError, RuntimeError, ValueError):
            return True
        return any(layer["name"] for layer in told.get("layout", told)["layers"])


def source(scene: bpy.types.Scene, frame: int, view: str, *, noisy: bool) -> tuple[str, Path | None]:
    """What a frame is composited from: `denoised` or `noisy`, and the file; with `noisy` the rendered one where it is there.

    A Temporal Denoise node shows the denoised image over it, and may want the noisy one too.
    """
    rendered = shot.frame_file(shot.frame_pattern(scene, view), frame)
    denoised = shot.output_file(scene, frame, view)
    is_rendered = exr.size_if_whole(rendered) is not None
    if exr.size_if_whole(denoised) is None:
        return ("noisy", rendered) if is_rendered else ("missing", None)
    return "denoised", rendered if noisy and is_rendered else denoised


def _has_renders(tree: bpy.types.NodeTree) -> bool:
    for each in tree.nodes:
        if each.bl_idname in (_RENDER_LAYERS, _CRYPTOMATTE, _FILE_OUTPUT):
            return True
        if isinstance(each, bpy.types.CompositorNodeGroup) and each.node_tree is not None and _has_renders(each.node_tree):
            return True
    return False


class HUSH_OT_composite_shot(bpy.types.Operator):
    """Run only the compositor over all frames, with the denoised images and all other passes; nothing is rendered again"""

    bl_idname = "hush.composite_shot"
    bl_label = "Composite Denoised"
    bl_options = {"REGISTER"}

    scene: StringProperty(name="Scene", description="Scene to composite. Empty: the open one", options={"SKIP_SAVE"})

    _frames: list[int]
    _done: dict[str, list[int]]
    _warnings: list[str]
    _timer: bpy.types.Timer | None = None
    _began = 0.0

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Not while the frames are still changing."""
        if job.current() is not None:
            cls.poll_message_set("The shot is being denoised")
            return False
        return True

    def _begin(self, context: bpy.types.Context) -> bpy.types.Scene | None:
        self._began, self._done, self._warnings = time.monotonic(), {"denoised": [], "noisy": [], "missing": []}, []
        scene = prepare.scene_of(self, context)
        self._frames = list(shot.frame_range(scene)) if scene else []
        exr.forget()
        return scene

    def _some(self, scene: bpy.types.Scene, seconds: float) -> Iterator[int]:
        """Composites frames for about so many seconds."""
        until = time.monotonic() + seconds
        waiting = self._frames[sum(map(len, self._done.values())) :]
        with Stage(scene) as stage:
            self._warnings += stage.warnings
            for frame in waiting:
                self._done[stage.composite(frame)].append(frame)
                yield frame
                if time.monotonic() > until:
                    break

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Composites and returns when it is done; for scripts."""
        scene = self._begin(context)
        if scene is None:
            return {"CANCELLED"}
        context.window_manager.progress_begin(0, max(1, len(self._frames)))
        try:
            for count, frame in enumerate(self._some(scene, float("inf")), 1):
                print(f"Hush: frame {frame} composited ({count} of {len(self._frames)})", flush=True)
                context.window_manager.progress_update(count)
        except (CompositeError, shot.ShotError) as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        finally:
            context.window_manager.progress_end()
        return self._finish(scene)

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        """Composites some frames at a time, so that Esc is heard."""
        if bpy.app.background or context.window is None:
            return self.execute(context)
        scene = self._begin(context)
        if scene is None:
            return {"CANCELLED"}
        self.scene = scene.name
        context.window_manager.progress_begin(0, max(1, len(self._frames)))
        self._timer = context.window_manager.event_timer_add(_TICK, window=context.window)
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Between two ticks the scene is as it always was, and so is a file that is saved then."""
        if event.type == "ESC" and event.value == "PRESS":
            self._hide(context)
            self.report({"WARNING"}, f"Compositing was stopped after {self._count()} of {len(self._frames)} frames")
            return {"CANCELLED"}
        if event.type != "TIMER":
            return {"PASS_THROUGH"}
        scene = bpy.data.scenes.get(self.scene)
        try:
            if scene is None:
                raise CompositeError(f"Scene {self.scene} is gone")
            for _ in self._some(scene, _AT_A_TIME):
                context.window_manager.progress_update(self._count())
        except (CompositeError, shot.ShotError) as error:
            self._hide(context)
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        if self._count() == len(self._frames):
            self._hide(context)
            return self._finish(scene)
        if context.workspace:
            context.workspace.status_text_set(f"Hush: composited {self._count()} of {len(self._frames)} frames   Esc: stop")
        return {"RUNNING_MODAL"}

    def cancel(self, context: bpy.types.Context) -> None:
        """Blender ends the operator, as when another file is opened."""
        self._hide(context)

    def _count(self) -> int:
        return sum(map(len, self._done.values()))

    def _hide(self, context: bpy.types.Context) -> None:
        if self._timer is not None:
            context.window_manager.event_timer_remove(self._timer)
            self._timer = None
        context.window_manager.progress_end()
        for workspace in bpy.data.workspaces:
            workspace.status_text_set(None)

    def _finish(self, scene: bpy.types.Scene) -> set[str]:
        refresh.request(now=True)
        for text in dict.fromkeys(self._warnings):
            self.report({"WARNING"}, text)
        noisy, missing = self._done["noisy"], self._done["missing"]
        if noisy:
            self.report({"WARNING"}, f"{check.in_words(noisy)} not denoised: composited with noise")
        finished = len(self._frames) - len(missing)
        text = f"{finished} {'frame' if finished == 1 else 'frames'} composited in {job.clock(time.monotonic() - self._began)}"
        if missing:
            self.report({"ERROR"}, f"{check.in_words(missing)} neither rendered nor denoised. {text}")
            return {"CANCELLED"}
        self.report({"INFO"}, f"{text}, in {folder(scene)}")
        return {"FINISHED"}


def register() -> None:
    """Adds the operator."""
    bpy.utils.register_class(HUSH_OT_composite_shot)


def unregister() -> None:
    """Takes the operator away."""
    bpy.utils.unregister_class(HUSH_OT_composite_shot)

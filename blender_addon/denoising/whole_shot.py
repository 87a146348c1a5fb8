# SPDX-FileCopyrightText: 2026 Hush authors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Render and Denoise Shot: the whole way with one button. Prepared, rendered, denoised, and composited where the compositor has the node.

It goes on where it was stopped: frames that are rendered are not rendered again, unless that is asked for.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import bpy
from bpy.props import BoolProperty

from .. import exr, messages, prepare, refresh, shot
from ..checks import check
from ..compositing import composite
from ..jobs import background, job
from ..messages import Refusal
from ..nodes import kinds
from . import denoise

# What is wrong with frames that are there does not matter before they are rendered.
_OF_FRAMES = {"first_frame", "frames", "older"}
_RUNS_OF_FRAMES = "frame_start" in bpy.ops.render.render.get_rna_type().properties


def to_render(scene: bpy.types.Scene) -> list[int]:
    """The frames of which a file is not there, not whole or of another size than the scene renders."""
    exr.forget()
    patterns, size = shot.frame_patterns(scene), shot.render_size(scene)

    def is_there(frame: int) -> bool:
        sizes = {exr.size_if_whole(shot.frame_file(pattern, frame)) for pattern in patterns}
        return None not in sizes and len(sizes) == 1 and (size is None or sizes == {size})

    return [frame for frame in shot.frame_range(scene) if not is_there(frame)]


def runs(frames: list[int], step: int) -> list[tuple[int, int]]:
    """First and last of each row of frames without a gap."""
    found: list[tuple[int, int]] = []
    for frame in frames:
        if found and frame == found[-1][1] + step:
            found[-1] = found[-1][0], frame
        else:
            found.append((frame, frame))
    return found


def begin(scene: bpy.types.Scene, *, render_again: bool) -> tuple[list[int], list[str]]:
    """Prepares the scene and returns the frames to render, and in words what was changed and which frames are kept.

    Raises:
        Refusal: The scene cannot be rendered or denoised so.
    """
    job.refuse_second()
    changes = prepare.apply(scene)
    check.forget()
    wrong = [each for each in check.problems(scene, fresh=True) if each.level == check.ERROR and each.key not in _OF_FRAMES]
    if wrong:
        raise Refusal(". ".join(each.text for each in wrong))
    todo = list(shot.frame_range(scene)) if render_again else to_render(scene)
    # Frames of a folder of their own are rendered elsewhere.
    if todo and scene.hush.input_folder:
        raise Refusal(messages.text("unrendered", frames=todo))
    notes = [messages.text("prepared", changes="; ".join(changes))] if changes else []
    there = [frame for frame in shot.frame_range(scene) if frame not in todo]
    return todo, [*notes, messages.text("whole_kept", frames=there)] if there else notes


def has_node(scene: bpy.types.Scene) -> bool:
    """Whether there is something to composite."""
    return any(kinds.of_hush(each) is not None for _, each in kinds.reached(scene))


@contextmanager
def only(scene: bpy.types.Scene, first: int, last: int) -> Iterator[dict[str, Any]]:
    """The arguments with which Blender renders these frames only; before 5.0 its range is set for so long."""
    arguments: dict[str, Any] = {"animation": True, "scene": scene.name}
    if _RUNS_OF_FRAMES:
        yield {**arguments, "frame_start": first, "frame_end": last}
        return
    before = scene.frame_start, scene.frame_end
    scene.frame_start, scene.frame_end = first, last
    try:
        yield arguments
    finally:
        scene.frame_start, scene.frame_end = before


def _render_in_window(arguments: dict[str, Any]) -> None:
    bpy.ops.render.render("INVOKE_DEFAULT", **arguments)


class _Render:
    """Blender's own render in a window, which ends in its own time; its handlers are not called in the main thread."""

    def __init__(self) -> None:
        self.began = self.ended = self.cancelled = False

    def pre(self, *_: object) -> None:
        self.began = True

    def complete(self, *_: object) -> None:
        self.ended = True

    def cancel(self, *_: object) -> None:
        self.ended = self.cancelled = True

    def _places(self) -> list[tuple[list[Callable], Callable]]:
        handlers = bpy.app.handlers
        return [(handlers.render_pre, self.pre), (handlers.render_complete, self.complete), (handlers.render_cancel, self.cancel)]

    def listen(self) -> None:
        for place, function in self._places():
            place.append(function)

    def forget(self) -> None:
        for place, function in self._places():
            if function in place:
                place.remove(function)


class HUSH_OT_whole_shot(background.JobOperator, bpy.types.Operator):
    """Prepare the shot, render what is not rendered yet, denoise it, and composite it where the compositor has a Temporal Denoise node"""

    bl_idname = "hush.whole_shot"
    bl_label = "Render and Denoise Shot"
    bl_options = {"REGISTER"}

    render_again: BoolProperty(
        name="Render Again",
        description="Render every frame, also those that are rendered already",
        default=False,
        options={"SKIP_SAVE"},
    )

    _todo: list[int]
    _runs: list[tuple[int, int]]
    _render: _Render | None = None
    # What holds the scene's range until Blender has begun to render.
    _range: Any = None

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Does all of it and returns when it is done; for scripts."""
        scene = self._prepare(context)
        if scene is None:
            return {"CANCELLED"}
        name = scene.name
        try:
            for first, last in self._runs:
                print(f"Hush: rendering frames {first} to {last}", flush=True)
                with only(scene, first, last) as arguments:
                    bpy.ops.render.render(**arguments)
            self._look_at_renders(scene)
            bpy.ops.hush.denoise_shot(scene=name)
            if has_node(scene):
                bpy.ops.hush.composite_shot(scene=name)
        except (RuntimeError, Refusal) as error:
            self.report({"ERROR"}, str(error).removeprefix("Error: ").strip())
            return {"CANCELLED"}
        return self._sum_up(scene)

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        """Does it step by step; Blender shows its render as ever, and Esc stops the step in hand."""
        if bpy.app.background or context.window is None:
            return self.execute(context)
        scene = self._prepare(context)
        if scene is None:
            return {"CANCELLED"}
        self.scene = scene.name
        context.window_manager.progress_begin(0, 1000)
        self._timer = context.window_manager.event_timer_add(background.TICK, window=context.window)
        context.window_manager.modal_handler_add(self)
        self._render_next(scene)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Waits for Blender's render, then for the processes."""
        if self._job is not None:
            return super().modal(context, event)
        if event.type != "TIMER":
            return {"PASS_THROUGH"}
        if self._range is not None and self._render.began:
            self._give_range_back()
        if self._render is not None and (not self._render.ended or bpy.app.is_job_running("RENDER")):
            return {"PASS_THROUGH"}
        return self._next(context, None)

    def cancel(self, context: bpy.types.Context) -> None:
        """Blender ends the operator, as when another file is opened."""
        self._give_range_back()
        if self._render is not None:
            self._render.forget()
        self._hide(context)
        if self._job is not None:
            self._job.close()

    def _prepare(self, context: bpy.types.Context) -> bpy.types.Scene | None:
        scene = self.scene_of(context)
        if scene is None:
            return None
        try:
            self._todo, notes = begin(scene, render_again=self.render_again)
        except Refusal as error:
            self.report({"ERROR"}, str(error))
            return None
        self._runs = runs(self._todo, max(1, scene.frame_step))
        for text in notes:
            self.report({"INFO"}, text)
        return scene

    def _render_next(self, scene: bpy.types.Scene) -> None:
        self._render = None
        if self._runs:
            self._render = _Render()
            self._render.listen()
            self._range = only(scene, *self._runs.pop(0))
            _render_in_window(self._range.__enter__())

    def _give_range_back(self) -> None:
        if self._range is not None:
            held, self._range = self._range, None
            held.__exit__(None, None, None)

    def _next(self, context: bpy.types.Context, done: job.Job | None) -> set[str]:
        """Begins the next step, or ends."""
        self._give_range_back()
        stopped = self._render is not None and self._render.cancelled
        if self._render is not None:
            self._render.forget()
        scene = bpy.data.scenes.get(self.scene)
        try:
            if scene is None:
                raise Refusal(messages.text("whole_gone", name=self.scene))
            if stopped:
                raise Refusal(messages.text("whole_stopped"))
            if done is None and self._runs:
                self._render_next(scene)
            elif done is None:
                self._render = None
                self._look_at_renders(scene)
                self._job = denoise.start(scene)
            elif isinstance(done, denoise.DenoiseJob) and has_node(scene):
                self._job = composite.start(scene)
            else:
                self._hide(context)
                return self._sum_up(scene)
        except (Refusal, RuntimeError) as error:
            self._hide(context)
            self.report({"WARNING" if stopped else "ERROR"}, str(error).removeprefix("Error: ").strip())
            return {"CANCELLED"}
        return {"RUNNING_MODAL"}

    def _ended(self, context: bpy.types.Context) -> set[str]:
        """A process has ended: the next step, where it was not in vain."""
        done = self._job
        result, reports = (composite if isinstance(done, composite.CompositeJob) else denoise).outcome(done)
        for level, text in reports:
            self.report({level}, text)
        scene = bpy.data.scenes.get(self.scene)
        if scene is not None:
            check.forget()
            refresh.shot_changed(scene)
        if result != "FINISHED":
            self._hide(context)
            return {"CANCELLED"}
        return self._next(context, done)

    def _look_at_renders(self, scene: bpy.types.Scene) -> None:
        """Raises a Refusal where a frame is not there after rendering."""
        missing = to_render(scene)
        if missing:
            raise Refusal(messages.text("whole_failed", frames=missing))

    def _sum_up(self, scene: bpy.types.Scene) -> set[str]:
        key = "whole_composited" if has_node(scene) else "whole_done"
        self.report({"INFO"}, messages.text(key, total=len(shot.frame_range(scene)), rendered=len(self._todo)))
        return {"FINISHED"}


register, unregister = bpy.utils.register_classes_factory((HUSH_OT_whole_shot,))

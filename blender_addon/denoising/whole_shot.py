# SPDX-FileCopyrightText: 2026 Hush authors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Render and Denoise Shot: the whole way with one button. Prepared, rendered, denoised, and composited where the compositor has the node.

It goes on where it was stopped: frames that are rendered are not rendered again, unless that is asked for.
"""

import bpy
from bpy.props import BoolProperty

from .. import exr, messages, prepare, refresh, shot
from ..checks import check
from ..compositing import composite
from ..jobs import background, job
from ..messages import Refusal
from ..nodes import kinds
from . import denoise
from .rendering import Rendering, only

# What is wrong with frames that are there does not matter before they are rendered.
_OF_FRAMES = {"first_frame", "frames", "older"}
# With what is only odd elsewhere, as frames may have come before it, nothing can be rendered.
_STRICT = {"sequencer"}


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


def begin(scene: bpy.types.Scene, *, render_again: bool) -> tuple[list[int], list[tuple[str, str]]]:
    """Prepares the scene and returns the frames to render, and reports (level, text) of what was changed and which frames are kept.

    Raises:
        Refusal: The scene cannot be rendered or denoised so; nothing is changed then.
    """
    job.refuse_second()
    refuse(scene, but_for={*_OF_FRAMES, *prepare.PREPARE})
    todo: list[int] = []

    def look(scene: bpy.types.Scene) -> None:
        refuse(scene, but_for=_OF_FRAMES)
        todo.extend(shot.frame_range(scene) if render_again else to_render(scene))
        # Frames of a folder of their own are rendered elsewhere.
        if todo and scene.hush.input_folder:
            raise Refusal(messages.text("unrendered", frames=todo, how=shot.how_to_render(scene)))
        wrong = check.why_not_writable(shot.frame_pattern(scene).parent, where=check.RENDERED) if todo else None
        if wrong:
            raise Refusal(wrong)

    changes = prepare.apply(scene, check=look)
    if changes:
        bpy.ops.ed.undo_push(message="Prepare Shot")
    notes = [("INFO", messages.text("prepared", changes="; ".join(changes)))] if changes else []
    there = [frame for frame in shot.frame_range(scene) if frame not in todo]
    if there:
        notes.append(
            ("WARNING", messages.text("whole_kept_old", frames=there)) if changes else ("INFO", messages.text("whole_kept", frames=there))
        )
    return todo, notes


def refuse(scene: bpy.types.Scene, *, but_for: set[str]) -> None:
    """Raises a Refusal where something is wrong, but for problems with these keys."""
    found = (each for each in check.problems(scene, fresh=True) if each.key not in but_for)
    wrong = [each.text for each in found if each.level == check.ERROR or each.key in _STRICT]
    if wrong:
        raise Refusal(". ".join(wrong))


def stamps(scene: bpy.types.Scene, frames: list[int]) -> dict[int, list[tuple[int, int] | None]]:
    """What tells whether the rendered files of each frame were written again."""
    patterns = shot.frame_patterns(scene)
    return {frame: [shot.stamp(shot.frame_file(pattern, frame)) for pattern in patterns] for frame in frames}


def has_node(scene: bpy.types.Scene) -> bool:
    """Whether there is something to composite."""
    return any(kinds.of_hush(each) is not None for _, each in kinds.reached(scene))


class HUSH_OT_whole_shot(background.JobOperator, bpy.types.Operator):
    """Prepare the shot, render what is not rendered yet, denoise it, and composite it where the compositor has a Temporal Denoise node"""

    bl_idname = "hush.whole_shot"
    bl_label = "Render and Denoise Shot"
    bl_options = {"REGISTER"}
    doing = "rendered"

    render_again: BoolProperty(
        name="Render Again",
        description="Render every frame, also those that are rendered already",
        default=False,
        options={"SKIP_SAVE"},
    )

    _todo: list[int]
    # The stamps of their files before they are rendered.
    _before: dict[int, list[tuple[int, int] | None]]
    _runs: list[tuple[int, int]]
    _render: Rendering | None = None
    # What is told once more at the end.
    _warnings: list[str]
    # Which scene it is, also after it was renamed meanwhile.
    _uid = 0

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
        self.scene, self._uid = scene.name, scene.session_uid
        self._go_on(context)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Has Blender render, one row of frames after the other, then waits for the processes."""
        if self._job is not None:
            return background.JobOperator.modal(self, context, event)
        if background.is_stop(event) and self._render is not None:
            self._render.stop()
            return {"RUNNING_MODAL"}
        if event.type != "TIMER" or self._render is not None and not self._render.is_over():
            return {"PASS_THROUGH"}
        return self._next(context, None)

    def cancel(self, context: bpy.types.Context) -> None:
        """Blender ends the operator, as when another file is opened."""
        if self._render is not None:
            self._render.end()
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
        self._before = stamps(scene, self._todo)
        self._runs = runs(self._todo, max(1, scene.frame_step))
        self._warnings = [text for level, text in notes if level == "WARNING"]
        for level, text in notes:
            self.report({level}, text)
        return scene

    def _next(self, context: bpy.types.Context, done: job.Job | None) -> set[str]:
        """Begins the next step, or ends."""
        rendered, self._render = self._render, None
        stopped = rendered is not None and rendered.stopped
        if rendered is not None:
            rendered.end()
        scene = next((each for each in bpy.data.scenes if each.session_uid == self._uid), None)
        try:
            if scene is None:
                raise Refusal(messages.text("whole_gone", name=self.scene))
            if stopped:
                raise Refusal(messages.text("whole_stopped"))
            if rendered is not None and rendered.failed:
                raise Refusal(messages.text("whole_no_start"))
            if done is None and self._runs:
                self._render = Rendering()
                self._render.start(scene, *self._runs.pop(0))
            elif done is None:
                self._look_at_renders(scene)
                self._job = denoise.start(scene)
            elif isinstance(done, denoise.DenoiseJob) and has_node(scene):
                self._job = composite.start(scene)
            else:
                self._hide(context)
                return self._sum_up(scene)
        except (Refusal, RuntimeError) as error:
            if self._render is not None:
                self._render.end()
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
        check.forget()
        refresh.shot_changed()
        if result != "FINISHED":
            self._hide(context)
            return {"CANCELLED"}
        return self._next(context, done)

    def _look_at_renders(self, scene: bpy.types.Scene) -> None:
        """Raises a Refusal where a frame is not there after rendering, or is still the file that was there before."""
        now = stamps(scene, self._todo)
        missing = {*to_render(scene), *(frame for frame in self._todo if now[frame] == self._before[frame])}
        if missing:
            raise Refusal(messages.text("whole_failed", frames=missing))

    def _sum_up(self, scene: bpy.types.Scene) -> set[str]:
        key = "whole_composited" if has_node(scene) else "whole_done"
        self.report({"INFO"}, messages.text(key, total=len(shot.frame_range(scene)), rendered=len(self._todo)))
        for text in self._warnings:
            self.report({"WARNING"}, text)
        return {"FINISHED"}


register, unregister = bpy.utils.register_classes_factory((HUSH_OT_whole_shot,))

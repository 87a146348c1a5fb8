# SPDX-FileCopyrightText: 2026 Hush authors
# SPDX-License-Identifier: GPL-3.0-or-later
"""What the operators share whose work another process does: in scripts they wait for it, in a window Blender stays usable."""

import time

import bpy

from .. import messages, refresh
from ..messages import Refusal
from ..scene_operator import SceneOperator
from . import job

TICK = 0.1
# The operators that go on in a window.
_going_on: list["JobOperator"] = []


def is_stop(event: bpy.types.Event) -> bool:
    """Whether Esc was pressed for a job; while Blender renders it is for the render."""
    return event.type == "ESC" and event.value == "PRESS" and not bpy.app.is_job_running("RENDER")


class JobOperator(SceneOperator):
    """Denoise Shot, Composite Denoised and Denoise This Frame. A kind starts its job in `_start` and sums it up in `_outcome`."""

    # What is being done to the shot where no job runs, for messages; empty where nothing is.
    doing = ""
    _job: job.Job | None = None
    _timer: bpy.types.Timer | None = None
    # The workspaces whose status text is of this operator.
    _told_in: frozenset[str] = frozenset()

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """One job at a time."""
        running = job.current()
        doing = running.doing if running is not None else next((each.doing for each in _going_on if each.doing), "")
        if doing:
            cls.poll_message_set(messages.text("job_busy", doing=doing))
        return not doing

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Does the work and returns when it is done; for scripts."""
        if not self._begin(context):
            return {"CANCELLED"}
        context.window_manager.progress_begin(0, 1000)
        try:
            while not self._job.ended:
                try:
                    for event in self._job.poll():
                        line = self._job.line(event)
                        if line:
                            print(f"Hush: {line}", flush=True)
                    context.window_manager.progress_update(round(1000 * self._job.fraction))
                    time.sleep(TICK / 2)
                except KeyboardInterrupt:
                    if self._job.cancelled:
                        raise
                    self._job.cancel()
        finally:
            self._job.close()
            context.window_manager.progress_end()
        return self._finish(in_script=True)

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        """Does the work in the background."""
        if bpy.app.background or context.window is None:
            return self.execute(context)
        if not self._begin(context):
            return {"CANCELLED"}
        self._go_on(context)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Looks at the process now and then; every other event goes on to Blender."""
        if is_stop(event) and not self._job.cancelled:
            self._job.cancel()
            self._show(context)
            return {"RUNNING_MODAL"}
        if event.type != "TIMER":
            return {"PASS_THROUGH"}
        before = self._job.text, self._job.fraction
        self._job.poll()
        if self._job.ended:
            return self._ended(context)
        if before != (self._job.text, self._job.fraction):
            self._show(context)
        return {"PASS_THROUGH"}

    def cancel(self, context: bpy.types.Context) -> None:
        """Blender ends the operator, as when another file is opened."""
        self._hide(context)
        self._job.close()

    def _begin(self, context: bpy.types.Context) -> bool:
        """Starts the job; False where that is refused, which is reported."""
        scene = self.scene_of(context)
        if scene is None:
            return False
        try:
            self._job = self._start(context, scene)
        except Refusal as error:
            self.report({"ERROR"}, str(error))
            return False
        return True

    def _go_on(self, context: bpy.types.Context) -> None:
        context.window_manager.progress_begin(0, 1000)
        self._timer = context.window_manager.event_timer_add(TICK, window=context.window)
        context.window_manager.modal_handler_add(self)
        _going_on.append(self)

    def _ended(self, context: bpy.types.Context) -> set[str]:
        self._hide(context)
        return self._finish()

    def _show(self, context: bpy.types.Context) -> None:
        context.window_manager.progress_update(round(1000 * self._job.fraction))
        hint = "" if self._job.cancelled else "   Esc: stop"
        if context.workspace:
            context.workspace.status_text_set(f"Hush: {self._job.text} ({self._job.fraction:.0%}){hint}")
            self._told_in |= {context.workspace.name}
        refresh.redraw()

    def _hide(self, context: bpy.types.Context) -> None:
        if self._timer is not None:
            context.window_manager.event_timer_remove(self._timer)
            self._timer = None
        _going_on[:] = [each for each in _going_on if each is not self]
        context.window_manager.progress_end()
        for workspace in bpy.data.workspaces:
            if workspace.name in self._told_in:
                workspace.status_text_set(None)

    def _finish(self, *, in_script: bool = False) -> set[str]:
        result, reports = self._outcome()
        if in_script and result != "FINISHED":
            # Also where Ctrl-C stopped it: what comes next in the script must not take it for done.
            reports = [*reports[:-1], ("ERROR", reports[-1][1])]
        if not bpy.app.background:
            refresh.redraw()
        for level, text in reports:
            self.report({level}, text)
        return {result}


def register() -> None:
    """Nothing to add: each kind is registered by itself."""


def unregister() -> None:
    """Ends what goes on in a window, whose operators are about to go."""
    for each in list(_going_on):
        each.cancel(bpy.context)

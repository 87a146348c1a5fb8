# SPDX-FileCopyrightText: 2026 Hush authors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Composite Denoised: only the compositor over the frame range, without rendering again.

It runs in another process, on a copy of the scene in a file of its own. In the open file nothing is changed, not for a moment.
"""

import os
import shutil
import sys
from contextlib import suppress
from pathlib import Path
from typing import Any

import bpy
from bpy.props import BoolProperty

from .. import exr, messages, refresh, shot
from ..checks.scene import composite_problems
from ..jobs import background, job
from . import contents
from .verdicts import in_words


class CompositeJob(job.Job):
    """The process that composites. `done` are the frames with their states, `remarks` what is to be said of frames: key and reason.

    `how_to_render` says what to do about frames that are not rendered.
    """

    doing, does = "composited", "composites"

    def __init__(self, scene: bpy.types.Scene, what: contents.Contents, blend: Path, command: list[str]) -> None:
        self.contents = what
        self.how_to_render = shot.how_to_render(scene)
        self.done: dict[int, str] = {}
        self.remarks: dict[int, tuple[str, str]] = dict(what.refused)
        self._blend = blend
        self._folder = Path(what.work["folder"])
        self._had_folder = os.path.exists(self._folder)
        super().__init__(scene, command, {**what.work, "blend": str(blend)})

    def line(self, event: dict[str, Any]) -> str | None:
        """One for each frame."""
        if event.get("event") != "frame":
            return None
        if event["status"] == "composited":
            return f"frame {event['frame']} composited ({event['finished']} of {event['frames']})"
        return in_words({event["frame"]: (event["key"], event["reason"])}, self.how_to_render)[0]

    def _take(self, event: dict[str, Any]) -> None:
        super()._take(event)
        kind = event.get("event")
        if kind == "frame":
            self.fraction = event["finished"] / event["frames"]
            if event["status"] == "composited":
                self.done[event["frame"]] = event["state"]
            if event["key"]:
                self.remarks[event["frame"]] = (event["key"], event["reason"])
        if kind in ("start", "working", "frame") and not self.cancelled:
            one = "frame" in event
            now = messages.text("compositing", frame=event["frame"]) if one else messages.text("compositing_all", count=event["frames"])
            rest = self.seconds / self.fraction * (1 - self.fraction) if self.fraction else None
            self.text = now if rest is None else f"{now}, {job.left(rest)}"

    def _clean_up(self) -> None:
        contents.remove_copy(self._blend)
        shutil.rmtree(self.contents.work["aside"], ignore_errors=True)
        if not self._had_folder:
            # It goes where it is empty; a folder that does not is no reason to stop here.
            with suppress(OSError):
                self._folder.rmdir()


def start(scene: bpy.types.Scene, *, allow_stale: bool = False) -> CompositeJob:
    """Starts to composite a scene.

    Raises:
        Refusal: It cannot be composited, there is a job already, or the process cannot be started.
    """
    job.refuse_second()
    exr.forget()
    what = contents.make(scene, allow_stale=allow_stale)
    scripts = scripts_may_run()
    command = _command(scene, scripts=scripts)
    what.work |= {"module": "compositing.run", "path": _import_path(), "scripts": scripts}
    blend = contents.save_copy(scene, scripts=scripts)
    made = job.start(lambda: CompositeJob(scene, what, blend, command))
    made.warnings += [problem.text for problem in composite_problems(scene)]
    return made


def outcome(done: CompositeJob) -> tuple[str, list[tuple[str, str]]]:
    """What an ended job comes to: FINISHED or CANCELLED, and reports (level, text) of which the last one sums up."""
    reports = [("WARNING", text) for text in dict.fromkeys(done.warnings)]
    made = {frame: remark for frame, remark in done.remarks.items() if frame in done.done}
    reports += [("WARNING", text) for text in in_words(made, done.how_to_render)]
    left = {frame: remark for frame, remark in done.remarks.items() if frame not in done.done}
    refused = in_words(left, done.how_to_render)
    count, total = len(done.done), done.contents.total
    wrong = [*(messages.of_error(error) for error in done.errors), *refused]
    if done.cancelled and not done.errors:
        wrong.append(messages.text("composite_stopped", count=count))
        return "CANCELLED", [*reports, ("WARNING", ". ".join(wrong))]
    if wrong or count < total:
        wrong.append(messages.text("composite_some", count=count, total=total))
        return "CANCELLED", [*reports, ("ERROR", ". ".join(part.rstrip(".") for part in wrong))]
    text = messages.text("composite_done", count=count, clock=job.clock(done.seconds), folder=done.contents.work["folder"])
    return "FINISHED", [*reports, ("INFO", text)]


def scripts_may_run() -> bool:
    """Whether the process may run the file's Python: where this Blender would on opening it, and has refused none."""
    allowed = bpy.context.preferences.filepaths.use_scripts_auto_execute or bool({"-y", "--enable-autoexec"} & set(sys.argv))
    return bool(allowed) and not bpy.app.autoexec_fail


def _command(scene: bpy.types.Scene, *, scripts: bool) -> list[str]:
    """The same Blender without a window; where Blender is a module of Python, that Python."""
    binary = bpy.app.binary_path
    if not binary or not Path(binary).stem.lower().startswith("blender"):
        return job.command()
    threads = ["--threads", str(scene.render.threads)] if scene.render.threads_mode == "FIXED" else []
    run = "--enable-autoexec" if scripts else "--disable-autoexec"
    return [binary, "--background", "-noaudio", run, *threads, "--python-exit-code", "1", "--python", str(job.WORKER)]


def _import_path() -> list[str]:
    if bpy.app.binary_path:
        return job.import_path()
    # `import bpy` there is to find this one; its own scripts are two folders below it.
    return [*job.import_path(), str(Path(bpy.utils.resource_path("LOCAL")).parents[1])]


class HUSH_OT_composite_shot(background.JobOperator, bpy.types.Operator):
    """Run only the compositor over all frames, with the denoised images; nothing is rendered. Blender stays usable; Esc stops it"""

    bl_idname = "hush.composite_shot"
    bl_label = "Composite Denoised"
    bl_options = {"REGISTER"}

    allow_stale: BoolProperty(
        name="Allow Stale",
        description="Composite frames that are out of date with their old denoised image, and those not denoised with noise",
        default=False,
        options={"SKIP_SAVE"},
    )

    def _start(self, _context: bpy.types.Context, scene: bpy.types.Scene) -> CompositeJob:
        return start(scene, allow_stale=self.allow_stale)

    def _outcome(self) -> tuple[str, list[tuple[str, str]]]:
        refresh.request(now=True)
        return outcome(self._job)


register, unregister = bpy.utils.register_classes_factory((HUSH_OT_composite_shot,))

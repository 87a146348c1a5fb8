# SPDX-FileCopyrightText: 2026 Hush authors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Denoise Shot: the frames of the scene, or of files that are named, in the background or, in scripts, until they are done."""

import os
import re
import time
from pathlib import Path
from typing import Any

import bpy
from bpy.props import BoolProperty, StringProperty

from .. import compat, messages, paths, refresh, shot
from ..checks import check
from ..checks.scene import to_set_before_rendering
from ..jobs import background, job
from ..messages import Refusal

_LAST_DIGITS = re.compile(r"\d+(?=\D*$)")


def progress(scene: bpy.types.Scene) -> tuple[float, str] | None:
    """How far the scene's denoising is, 0…1, and in words; None where it is not being denoised."""
    running = job.current()
    return (running.fraction, running.text) if running and running.is_of(scene) else None


def runs(scene: bpy.types.Scene, source: str = "", target: str = "", *, overwrite: bool = False) -> list[dict[str, Any]]:
    """What the worker does, once for each sequence of files: `arguments` of `hush.denoise_sequence` and `warnings` to tell first.

    `source` and `target` are as in the operator.

    Raises:
        Refusal: The scene's settings or the paths cannot be used.
    """
    if not source:
        found = check.problems(scene, fresh=True)
        for key in ("linked", "engine", "save", "path", "layers", "folder", "library"):
            for problem in found:
                if problem.level == check.ERROR and problem.key == key and not (key == "folder" and target):
                    raise Refusal(problem.text)
        if not any(shot.example(pattern) for pattern in shot.frame_patterns(scene)):
            unrendered = [problem.text for problem in found if problem.key == "frames"]
            raise Refusal(". ".join([*to_set_before_rendering(scene), *unrendered]))
    sequences = _named(source) if source else [(pattern, list(shot.frame_range(scene))) for pattern in shot.frame_patterns(scene)]
    output = _folder(target) if target else _folder_of(sequences[0][0]) / "denoised" if source else shot.output_folder(scene)
    for inputs, _ in sequences:
        _check_output(inputs, output, target)
    made = []
    for inputs, frames in sequences:
        common, warnings = shot.settings(scene, shot.example(inputs))
        threads = scene.render.threads if scene.render.threads_mode == "FIXED" else None
        there = {"inputs": str(inputs), "output": str(output), "frames": frames, "overwrite": overwrite, "threads": threads}
        made.append({"arguments": {**there, **common}, "warnings": warnings})
    return made


def _named(source: str) -> list[tuple[Path, list[int] | None]]:
    """A folder, a pattern with #, one file, or a beginning of names as in the scene's output path."""
    path = Path(bpy.path.abspath(source))
    if os.path.isdir(path) or "#" in path.name:
        return [(path if os.path.isdir(path) or path.suffix else path.with_name(f"{path.name}.exr"), None)]
    numbered = shot.numbered(path.name)
    if numbered:
        # One frame; the ones beside it still help.
        pattern, frame = numbered
        return [(path.with_name(pattern), [frame])]
    if path.suffix.lower() == ".exr":
        return [(path, None)]
    pattern = path / "####.exr" if source.endswith(("/", "\\")) else path.with_name(f"{path.name}####.exr")
    return [(pattern, None)]


def _folder_of(inputs: Path) -> Path:
    return inputs if os.path.isdir(inputs) else inputs.parent


def _folder(target: str) -> Path:
    path = Path(bpy.path.abspath(target))
    return path.parent if _names_a_file(path) else path


def _names_a_file(path: Path) -> bool:
    return not os.path.isdir(path) and ("#" in path.name or path.suffix.lower() == ".exr")


def _check_output(inputs: Path, output: Path, target: str) -> None:
    folder = _folder_of(inputs)
    if paths.place_of_folder(folder) == paths.place_of_folder(output):
        raise Refusal(messages.text("folder_replaces", folder=folder, other=folder / "denoised"))
    name = Path(target).name if target and _names_a_file(Path(bpy.path.abspath(target))) else ""
    if name and not os.path.isdir(inputs) and _without_number(name) != _without_number(inputs.name):
        raise Refusal(messages.text("names_kept", file=inputs.name, name=name))
    wrong = check.why_not_writable(output)
    if wrong:
        raise Refusal(wrong)


def _without_number(name: str) -> str:
    return _LAST_DIGITS.sub("#", name.replace("#", "0"))


def start(scene: bpy.types.Scene, source: str = "", target: str = "", *, overwrite: bool = False) -> "DenoiseJob":
    """Starts to denoise; the arguments are those of `runs`.

    Raises:
        Refusal: The scene's settings or the paths cannot be used, there is a job already, or the process cannot be started.
    """
    job.refuse_second()
    todo = runs(scene, source, target, overwrite=overwrite)
    how = messages.text("how_missing") if source else shot.how_to_render(scene)
    return job.start(lambda: DenoiseJob(scene, todo, how))


class DenoiseJob(job.Job):
    """The worker that denoises; `results` are what `hush.denoise_sequence` returned for each run.

    `how_to_render` says what to do about frames that are not rendered.
    """

    doing, does = "denoised", "denoises"

    def __init__(self, scene: bpy.types.Scene, todo: list[dict[str, Any]], how_to_render: str) -> None:
        self.how_to_render = how_to_render
        self._runs = max(1, len(todo))
        self._frames, self._finished, self._in_frame = 1, 0, 0.0
        # Of this run: frames to compute and computed; of all: computed, and when the first one was begun.
        self._todo, self._here, self._computed, self._first = 0, 0, 0, 0.0
        super().__init__(scene, job.command(), {"module": "denoising.run", "path": job.import_path(), "runs": todo})

    def line(self, event: dict[str, Any]) -> str | None:
        """One for each frame."""
        kind = event.get("event")
        if kind == "start":
            skipped = event["frames"] - event["todo"]
            return messages.text("job_todo", count=event["todo"]) + (f", {skipped} there already" if skipped else "")
        if kind == "frame" and event["status"] == "denoised":
            helped = f" with {', '.join(map(str, event['neighbours']))}" if event["neighbours"] else ""
            return f"frame {event['frame']} denoised{helped} ({event['seconds']:.1f} s, {self.fraction:.0%})"
        if kind == "frame" and event["status"] == "failed":
            return f"frame {event['frame']} failed: {messages.of_error(event.get('reason') or 'failed')}"
        return None

    def _take(self, event: dict[str, Any]) -> None:
        kind, run = event.get("event"), event.get("run", 0)
        if event.get("message"):
            event["message"] = messages.of_error(event["message"])
        super()._take(event)
        if kind == "start":
            self._todo, self._here, self._in_frame = event.get("todo", 0), 0, 0.0
            self._finished, self._frames = 0, max(1, event.get("frames") or 1)
            self._show(run, messages.text("denoising_frames", count=self._todo))
        elif kind == "working":
            self._first = self._first or time.monotonic()
            self._in_frame = 0.0
            self._show(run, messages.text("denoising_frame", frame=event["frame"]))
        elif kind == "progress":
            self._in_frame = min(1.0, max(0.0, event.get("fraction") or 0.0))
            self._show(run, messages.text("denoising_frame", frame=event["frame"]))
        elif kind == "frame":
            computed = event.get("status") in ("denoised", "failed")
            self._here, self._computed, self._in_frame = self._here + computed, self._computed + computed, 0.0
            self._finished, self._frames = event.get("finished", 0), max(1, event.get("frames") or 1)
            if event.get("status") == "failed":
                reason = messages.of_error(event.get("reason") or "failed")
                self._bad.setdefault((run, event["frame"]), messages.text("frame_wrong", frame=event["frame"], reason=reason))
            self._show(run, self.text.partition(",")[0])

    def _show(self, run: int, now: str) -> None:
        """How much is done, and how long the rest takes as soon as a part of a frame is computed."""
        self.fraction = min(1.0, (run + (self._finished + self._in_frame) / self._frames) / self._runs)
        done = self._computed + self._in_frame
        # Runs that are not begun yet, such as another stereo view, are taken to be like this one.
        rest = max(0.0, self._todo - self._here - self._in_frame) + self._todo * (self._runs - run - 1)
        estimate = f", {job.left((time.monotonic() - self._first) / done * rest)}" if self._first and done > 0.05 else ""
        if not self.cancelled:
            self.text = now + estimate


def outcome(done: DenoiseJob) -> tuple[str, list[tuple[str, str]]]:
    """What an ended job comes to: FINISHED or CANCELLED, and reports (level, text) of which the last one sums up."""
    reports = [("WARNING", text) for text in dict.fromkeys(done.warnings)]
    results = done.results
    there = sum(result["written"] + result["skipped"] for result in results)
    written = sum(result["written"] for result in results)
    wanted = sum(result["frames"] for result in results)
    failed = sum(len(result["failed"]) for result in results)
    missing = sorted({frame for result in results for frame in _frames_of(result["missing"])})
    stopped = next((result["stopped"] for result in results if result["stopped"]), None)
    errors = done.errors
    if done.cancelled and not errors:
        text = messages.text("denoise_stopped", count=written)
        return "CANCELLED", [*reports, ("WARNING", text)]
    if errors or stopped or failed or missing or there < wanted or not results:
        unrendered = messages.text("unrendered", frames=missing, how=done.how_to_render) if missing else ""
        why = [errors[0] if errors else messages.of_error(stopped) if stopped else "", unrendered]
        more = messages.text("denoise_more", count=len(errors) - 1) if len(errors) > 1 else ""
        how_many = messages.text("denoise_some", there=there, wanted=wanted + len(missing)) if results else ""
        text = ". ".join(part.rstrip(".") for part in (*why, more, how_many) if part) or messages.text("denoise_nothing")
        return "CANCELLED", [*reports, ("ERROR", text)]
    degraded = sorted({frame for result in results for frame in result["degraded"]})
    if degraded:
        reports.append(("WARNING", messages.text("degraded", frames=degraded)))
    text = messages.text("denoise_done", count=written, clock=job.clock(done.seconds))
    if there > written:
        text = messages.text("denoise_kept", done=text, count=there - written)
    return "FINISHED", [*reports, ("INFO", text)]


def _frames_of(ranges: str) -> list[int]:
    """The frames that 3-5, 9 are."""
    found = re.findall(r"(-?\d+)(?:-(-?\d+))?", ranges)
    return [frame for first, last in found for frame in range(int(first), int(last or first) + 1)]


class HUSH_OT_denoise_shot(background.JobOperator, bpy.types.Operator):
    """Denoise the rendered frames of this scene into a folder beside them. Blender stays usable; Esc stops it"""

    bl_idname = "hush.denoise_shot"
    bl_label = "Denoise Shot"
    bl_options = {"REGISTER"}

    input_filepath: StringProperty(
        name="Input",
        description="Folder, pattern (frame_####.exr) or one frame to denoise. Empty: the frames of the scene",
        subtype="FILE_PATH",
        options={"SKIP_SAVE"} | compat.RELATIVE_PATH,
    )
    output_filepath: StringProperty(
        name="Output",
        description="Folder to write to; never that of the rendered frames. Empty: as the scene says, or a folder named denoised",
        subtype="FILE_PATH",
        options={"SKIP_SAVE"} | compat.RELATIVE_PATH,
    )
    overwrite: BoolProperty(
        name="Overwrite",
        description="Denoise every frame again, also over files that Hush did not write",
        default=False,
        options={"SKIP_SAVE"},
    )

    def _start(self, _context: bpy.types.Context, scene: bpy.types.Scene) -> "DenoiseJob":
        return start(scene, self.input_filepath, self.output_filepath, overwrite=self.overwrite)

    def _outcome(self) -> tuple[str, list[tuple[str, str]]]:
        check.forget()
        refresh.shot_changed()
        return outcome(self._job)


def register() -> None:
    """Adds the operator."""
    bpy.utils.register_class(HUSH_OT_denoise_shot)


def unregister() -> None:
    """Takes the operator away and stops what is being denoised."""
    job.close()
    bpy.utils.unregister_class(HUSH_OT_denoise_shot)

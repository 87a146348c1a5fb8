# SPDX-FileCopyrightText: 2026 Hush authors
# SPDX-License-Identifier: Apache-2.0
"""Denoise Shot: the frames of the scene, or of files that are named, in the background or, in scripts, until they are done."""

import re
import time
from pathlib import Path
from typing import Any

import bpy
from bpy.props import BoolProperty, StringProperty

from . import check, job, prepare, refresh, shot

_LAST_DIGITS = re.compile(r"\d+(?=\D*$)")
_TICK = 0.1


class DenoiseError(Exception):
    """Why nothing can be denoised."""


def progress(scene: bpy.types.Scene) -> tuple[float, str] | None:
    """How far the scene's denoising is, 0…1, and in words; None where it is not being denoised."""
    running = job.current()
    return (running.fraction, running.text) if running and running.scene_name == scene.name else None


def runs(scene: bpy.types.Scene, source: str = "", target: str = "", *, overwrite: bool = False) -> list[dict[str, Any]]:
    """The arguments of `hush.denoise_sequence`, once for each sequence of files; `source` and `target` as in the operator.

    Raises:
        DenoiseError: The scene's settings or the paths cannot be used.
    """
    if not source:
        serious = [problem for problem in check.problems(scene, fresh=True) if problem.level == check.ERROR]
        for key in ("linked", "engine", "save", "path", "layers", "folder", "library"):
            for problem in serious:
                if problem.key == key and not (key == "folder" and target):
                    raise DenoiseError(problem.text)
    try:
        sequences = _named(source) if source else [(pattern, list(shot.frame_range(scene))) for pattern in shot.frame_patterns(scene)]
        output = _folder(target) if target else _folder_of(sequences[0][0]) / "denoised" if source else shot.output_folder(scene)
    except shot.ShotError as error:
        raise DenoiseError(str(error)) from None
    for inputs, _ in sequences:
        _check_output(inputs, output, target)
    vectors = shot.vector_layer(scene)
    common = {
        "output": str(output),
        "lam": shot.lambda_keys(scene),
        "window": shot.window(scene),
        "layers": shot.layers(scene),
        "vector_layer": vectors,
        "aovs": ["all"] if scene.hush.use_light_passes else [],
        "keep_noisy": scene.hush.keep_noisy,
        "overwrite": overwrite,
        "threads": scene.render.threads if scene.render.threads_mode == "FIXED" else None,
    }
    return [{"inputs": str(inputs), "frames": frames, "example": _example(inputs), **common} for inputs, frames in sequences]


def _named(source: str) -> list[tuple[Path, list[int] | None]]:
    """A folder, a pattern with #, one file, or a beginning of names as in the scene's output path."""
    path = Path(bpy.path.abspath(source))
    if path.is_dir() or "#" in path.name:
        return [(path if path.is_dir() or path.suffix else path.with_name(f"{path.name}.exr"), None)]
    digits = _LAST_DIGITS.search(path.stem)
    if path.suffix.lower() == ".exr" and digits:
        # One frame; the ones beside it still help.
        name = f"{path.stem[: digits.start()]}{'#' * len(digits[0])}{path.stem[digits.end() :]}{path.suffix}"
        return [(path.with_name(name), [int(digits[0])])]
    if path.suffix.lower() == ".exr":
        return [(path, None)]
    pattern = path / "####.exr" if source.endswith(("/", "\\")) else path.with_name(f"{path.name}####.exr")
    return [(pattern, None)]


def _folder_of(inputs: Path) -> Path:
    return inputs if inputs.is_dir() else inputs.parent


def _folder(target: str) -> Path:
    path = Path(bpy.path.abspath(target))
    return path.parent if _names_a_file(path) else path


def _names_a_file(path: Path) -> bool:
    return not path.is_dir() and ("#" in path.name or path.suffix.lower() == ".exr")


def _check_output(inputs: Path, output: Path, target: str) -> None:
    folder = _folder_of(inputs)
    if folder.resolve() == output.resolve():
        advice = f"choose another folder, such as {folder / 'denoised'}"
        raise DenoiseError(f"The denoised frames would replace the rendered ones in {folder}: {advice}")
    name = Path(target).name if target and _names_a_file(Path(bpy.path.abspath(target))) else ""
    if name and not inputs.is_dir() and _without_number(name) != _without_number(inputs.name):
        raise DenoiseError(f"Denoised frames keep the names of the rendered ones ({inputs.name}), so {name} cannot be used: give a folder")
    wrong = check.why_not_writable(output)
    if wrong:
        raise DenoiseError(wrong)


def _without_number(name: str) -> str:
    return _LAST_DIGITS.sub("#", name.replace("#", "0"))


def _example(inputs: Path) -> str | None:
    """One of the files, to see which view layers they have."""
    name = "*.exr" if inputs.is_dir() else re.sub(r"#+", "*", inputs.name)
    return next((str(path) for path in sorted(_folder_of(inputs).glob(name)) if path.is_file() and path.stat().st_size), None)


def outcome(done: job.Job) -> tuple[str, list[tuple[str, str]]]:
    """What an ended job comes to: FINISHED or CANCELLED, and reports (level, text) of which the last one sums up."""
    reports = [("WARNING", text) for text in dict.fromkeys(done.warnings)]
    results = done.results
    there = sum(result["written"] + result["skipped"] for result in results)
    written = sum(result["written"] for result in results)
    wanted = sum(result["frames"] for result in results)
    failed = sum(len(result["failed"]) for result in results)
    missing = ", ".join(dict.fromkeys(result["missing"] for result in results if result["missing"]))
    stopped = next((result["stopped"] for result in results if result["stopped"]), None)
    errors = done.errors
    if done.cancelled and not errors:
        text = f"Denoising was stopped; {_frames(written)} denoised. Press Denoise Shot again to go on"
        return "CANCELLED", [*reports, ("WARNING", text)]
    if errors or stopped or failed or missing or there < wanted or not results:
        why = [errors[0] if errors else stopped or "", f"Frames {missing} are not rendered" if missing else ""]
        more = f"{len(errors) - 1} more errors" if len(errors) > 2 else "1 more error" if len(errors) == 2 else ""
        how_many = f"{there} of {wanted + _count(missing)} frames are denoised" if results else ""
        why = [part.replace("pass --overwrite", "call bpy.ops.hush.denoise_shot(overwrite=True)") for part in why]
        text = ". ".join(part.rstrip(".") for part in (*why, more, how_many) if part) or "Nothing was denoised"
        return "CANCELLED", [*reports, ("ERROR", text)]
    degraded = sorted({frame for result in results for frame in result["degraded"]})
    if degraded:
        reports.append(("WARNING", f"{check.in_words(degraded)} denoised without a neighbour whose file is bad"))
    kept = f", {_frames(there - written)} were there already" if there > written else ""
    return "FINISHED", [*reports, ("INFO", f"{_frames(written)} denoised in {job.clock(done.seconds)}{kept}")]


def _frames(count: int) -> str:
    return "1 frame" if count == 1 else f"{count} frames"


def _count(ranges: str) -> int:
    """How many frames 3-5, 9 are."""
    found = re.findall(r"(-?\d+)(?:-(-?\d+))?", ranges)
    return sum(int(last or first) - int(first) + 1 for first, last in found)


class HUSH_OT_denoise_shot(bpy.types.Operator):
    """Denoise the rendered frames of this scene into a folder beside them. Blender stays usable; Esc stops it"""

    bl_idname = "hush.denoise_shot"
    bl_label = "Denoise Shot"
    bl_options = {"REGISTER"}

    input_filepath: StringProperty(
        name="Input",
        description="Folder, pattern (frame_####.exr) or one frame to denoise. Empty: the frames of the scene",
        subtype="FILE_PATH",
        options={"SKIP_SAVE"},
    )
    output_filepath: StringProperty(
        name="Output",
        description="Folder to write to; never that of the rendered frames. Empty: as the scene says, or a folder named denoised",
        subtype="FILE_PATH",
        options={"SKIP_SAVE"},
    )
    overwrite: BoolProperty(
        name="Overwrite",
        description="Denoise every frame again, also over files that Hush did not write",
        default=False,
        options={"SKIP_SAVE"},
    )
    scene: StringProperty(name="Scene", description="Scene to denoise. Empty: the open one", options={"SKIP_SAVE"})

    _job: job.Job | None = None
    _timer: bpy.types.Timer | None = None

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """One shot at a time."""
        if job.current() is not None:
            cls.poll_message_set("A shot is being denoised; Esc stops it")
            return False
        return True

    def _begin(self, context: bpy.types.Context) -> bool:
        scene = prepare.scene_of(self, context)
        if scene is None:
            return False
        try:
            self._job = job.start(scene.name, runs(scene, self.input_filepath, self.output_filepath, overwrite=self.overwrite))
        except (DenoiseError, job.JobError) as error:
            self.report({"ERROR"}, str(error))
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Denoises and returns when it is done; for scripts."""
        if not self._begin(context):
            return {"CANCELLED"}
        context.window_manager.progress_begin(0, 1000)
        try:
            while not self._job.ended:
                try:
                    for event in self._job.poll():
                        _print(event, self._job)
                    context.window_manager.progress_update(round(1000 * self._job.fraction))
                    time.sleep(_TICK / 2)
                except KeyboardInterrupt:
                    if self._job.cancelled:
                        raise
                    self._job.cancel()
        finally:
            self._job.close()
            context.window_manager.progress_end()
        return self._finish()

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        """Denoises in the background."""
        if bpy.app.background or context.window is None:
            return self.execute(context)
        if not self._begin(context):
            return {"CANCELLED"}
        context.window_manager.progress_begin(0, 1000)
        self._timer = context.window_manager.event_timer_add(_TICK, window=context.window)
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Looks at the worker now and then; every other event goes on to Blender."""
        if event.type == "ESC" and event.value == "PRESS" and not self._job.cancelled:
            self._job.cancel()
            self._show(context)
            return {"RUNNING_MODAL"}
        if event.type != "TIMER":
            return {"PASS_THROUGH"}
        before = self._job.text, self._job.fraction
        self._job.poll()
        if self._job.ended:
            self._hide(context)
            return self._finish()
        if before != (self._job.text, self._job.fraction):
            self._show(context)
        return {"PASS_THROUGH"}

    def cancel(self, context: bpy.types.Context) -> None:
        """Blender ends the operator, as when another file is opened."""
        self._hide(context)
        self._job.close()

    def _show(self, context: bpy.types.Context) -> None:
        context.window_manager.progress_update(round(1000 * self._job.fraction))
        hint = "" if self._job.cancelled else "   Esc: stop"
        if context.workspace:
            context.workspace.status_text_set(f"Hush: {self._job.text} ({self._job.fraction:.0%}){hint}")
        refresh.redraw()

    def _hide(self, context: bpy.types.Context) -> None:
        if self._timer is not None:
            context.window_manager.event_timer_remove(self._timer)
            self._timer = None
        context.window_manager.progress_end()
        for workspace in bpy.data.workspaces:
            workspace.status_text_set(None)

    def _finish(self) -> set[str]:
        scene = bpy.data.scenes.get(self._job.scene_name)
        if scene is not None:
            check.forget()
            refresh.shot_changed(scene)
        if not bpy.app.background:
            refresh.redraw()
        result, reports = outcome(self._job)
        for level, text in reports:
            self.report({level}, text)
        return {result}


def _print(event: dict[str, Any], running: job.Job) -> None:
    """A line for each frame, for logs."""
    kind = event.get("event")
    if kind == "start":
        skipped = event["frames"] - event["todo"]
        print(f"Hush: {event['todo']} frames to denoise" + (f", {skipped} there already" if skipped else ""), flush=True)
    elif kind == "frame" and event["status"] == "denoised":
        helped = f" with {', '.join(map(str, event['neighbours']))}" if event["neighbours"] else ""
        took = f"{event['seconds']:.1f} s, {running.fraction:.0%}"
        print(f"Hush: frame {event['frame']} denoised{helped} ({took})", flush=True)
    elif kind == "frame" and event["status"] == "failed":
        print(f"Hush: frame {event['frame']} failed: {event.get('reason')}", flush=True)


def register() -> None:
    """Adds the operator."""
    bpy.utils.register_class(HUSH_OT_denoise_shot)


def unregister() -> None:
    """Takes the operator away and stops what is being denoised."""
    job.close()
    bpy.utils.unregister_class(HUSH_OT_denoise_shot)

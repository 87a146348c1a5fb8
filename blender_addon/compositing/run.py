# SPDX-FileCopyrightText: 2026 Hush authors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The frames of a composite, one after the other. Only for the process that composites: it opens another file.

Events: `start` (`frames`), `working` (`frame`), `warning` (`message`), and `frame` with its `status`: `composited`, `refused` or `failed`;
`state`, `key` and `reason` are those of `verdicts.Verdict`.
"""

import os
import shutil
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import bpy
import hush

from .. import exr, messages
from .tree import Files, FrameError, Stage
from .verdicts import Verdict, judge, together

Work = dict[str, Any]
_Judged = list[list[Verdict]]


def run(work: Work, tell: Callable[[dict[str, Any]], None], stopped: threading.Event) -> dict[str, Any]:
    """Opens the copy and composites the frames of the work, see `contents.make`, until `stopped`."""
    try:
        _composite(work, tell, stopped)
    finally:
        shutil.rmtree(work["aside"], ignore_errors=True)
    return {"stopped": stopped.is_set()}


def _composite(work: Work, tell: Callable[[dict[str, Any]], None], stopped: threading.Event) -> None:
    bpy.ops.wm.open_mainfile(filepath=work["blend"], load_ui=False, use_scripts=work["scripts"])
    # Both processes see to it that the copy goes: this one also where the other is gone.
    shutil.rmtree(os.path.dirname(work["blend"]), ignore_errors=True)
    warn = lambda text: tell({"event": "warning", "message": text})
    if bpy.app.autoexec_fail:
        warn(messages.text("composite_scripts"))
    scene = bpy.data.scenes[work["scene"]]
    Path(work["aside"]).mkdir(parents=True, exist_ok=True)
    stage = Stage(scene, work, warn)
    checks = [[hush.SequenceCheck() for _ in source["views"]] for source in work["sources"]]
    total = len(work["frames"])
    tell({"event": "start", "frames": total})
    for finished, frame in enumerate(work["frames"], 1):
        if stopped.is_set():
            return
        number = frame["frame"]
        tell({"event": "working", "frame": number})
        tell({"event": "frame", "frame": number, "finished": finished, "frames": total, **_frame(work, frame, scene, stage, checks)})


def _frame(work: Work, frame: Work, scene: bpy.types.Scene, stage: Stage, checks: list[list[Any]]) -> dict[str, Any]:
    """Composites a frame, its stereo views one by one where they have files of their own."""
    judged = _judge(work, frame, checks)
    verdict = together([each for views in judged for each in views])
    about = {"state": verdict.state, "key": verdict.key, "reason": verdict.reason}
    if not verdict.state:
        return {**about, "status": "refused"}
    made = []
    try:
        if stage.moves:
            scene.frame_set(frame["frame"])
        for index, view in enumerate(work["views"]):
            stage.turn_to([_files(work, views[index if len(views) > 1 else 0]) for views in judged], view)
            made.append((_render(scene, frame["frame"]), Path(work["folder"], frame["names"][index])))
        for aside, target in made:
            os.replace(aside, target)
    except (FrameError, OSError, RuntimeError) as error:
        return {"status": "failed", "key": "composite_failed", "reason": messages.of_error(error).removeprefix("Error: ")}
    return {**about, "status": "composited"}


def _judge(work: Work, frame: Work, checks: list[list[Any]]) -> _Judged:
    """What the frame is made from now, of each source and view."""
    judged: _Judged = []
    for source, files, askers in zip(work["sources"], frame["files"], checks, strict=True):
        rules = {"size": source["size"] and tuple(source["size"]), "others": source["others"], "allow_stale": work["allow_stale"]}
        judged.append([])
        for view, (rendered, denoised), asker in zip(source["views"], files, askers, strict=True):
            settings = dict(view["settings"])
            if isinstance(settings["lam"], dict):
                settings["lam"] = {int(key): value for key, value in settings["lam"].items()}
            checked = asker.check(view["inputs"], view["output"], frames=[frame["frame"]], **settings)["frames"][0]
            judged[-1].append(judge(checked, Path(rendered), Path(denoised), **rules))
    return judged


def _files(work: Work, verdict: Verdict) -> Files:
    """Where a node of Hush shows the denoised image over the render, that is the noisy file, as long as it is there."""
    layers = verdict.rendered if work["nodes"] and verdict.rendered else verdict.denoised
    return Files(layers, verdict.denoised)


def _render(scene: bpy.types.Scene, frame: int) -> Path:
    """Runs the compositor at a frame; returns the file that it wrote, whole."""
    scene.frame_start = scene.frame_end = frame
    aside = Path(scene.render.frame_path(frame=frame))
    aside.unlink(missing_ok=True)
    # An animation: single frames of scenes that are not open are composited with the images of their last frame.
    bpy.ops.render.render(animation=True, scene=scene.name)
    if not aside.is_file() or not aside.stat().st_size or (aside.suffix == ".exr" and exr.size_if_whole(aside) is None):
        raise FrameError("Blender did not write the file")
    return aside

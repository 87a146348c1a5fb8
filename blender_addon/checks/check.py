# SPDX-FileCopyrightText: 2026 Hush authors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Check Shot: what stands in the way of a good result, in words, with the fix where a button can do it."""

import time
from pathlib import Path

import bpy

from .. import messages, paragraph, prepare, shot, status
from ..messages import Refusal
from ..scene_operator import SceneOperator
from .files import RENDERED as RENDERED
from .files import file_problems
from .files import why_not_writable as why_not_writable
from .problem import ERROR, INFO, WARNING, Problem
from .scene import scene_problems

# What a problem's level looks like.
ICONS = {ERROR: "ERROR", WARNING: "QUESTION", INFO: "INFO"}
# The disk is looked at again after this many times what it took, so that a slow network drive is not asked all the time.
_REST, _LEAST_REST = 50.0, 3.0
_POPUP_WIDTH = 560
_seen: dict[int, tuple[object, float, list[Problem]]] = {}


def problems(scene: bpy.types.Scene, *, fresh: bool = False) -> list[Problem]:
    """All that is not right with a scene's shot, the worst first.

    What the disk says is remembered for some seconds, unless `fresh` is asked for.
    """
    return _sorted([*scene_problems(scene), *_file_problems(scene, fresh=fresh)])


def last_problems(scene: bpy.types.Scene) -> list[Problem]:
    """The same for drawing: what the disk said last, without a look at it."""
    return _sorted([*scene_problems(scene), *_seen.get(scene.session_uid, (None, 0.0, []))[2]])


def _sorted(found: list[Problem]) -> list[Problem]:
    return sorted(found, key=lambda problem: (ERROR, WARNING, INFO).index(problem.level))


def forget() -> None:
    """The next question looks at the disk."""
    _seen.clear()


def in_words(frames: list[int]) -> str:
    """Frames as "Frames 3-5, 9 are"."""
    return messages.text("frames_are", frames=frames)


def _file_problems(scene: bpy.types.Scene, *, fresh: bool) -> list[Problem]:
    try:
        patterns, output = shot.frame_patterns(scene), shot.output_folder(scene)
    except Refusal as error:
        found = [Problem("path", str(error), level=ERROR)]
        _seen[scene.session_uid] = (None, 0.0, found)
        return found
    key = _request(scene, patterns, output)
    known = _seen.get(scene.session_uid)
    if not fresh and known and known[0] == key and time.monotonic() < known[1]:
        return known[2]
    if fresh:
        status.forget()
    began = time.monotonic()
    try:
        found = list(file_problems(scene, patterns, output, shot.frame_range(scene), write=fresh))
    except OSError as error:
        found = [Problem("files", messages.text("files_unread", reason=messages.of_error(error)), level=ERROR)]
    took = time.monotonic() - began
    _seen[scene.session_uid] = (key, began + took + max(_LEAST_REST, _REST * took), found)
    return found


def _request(scene: bpy.types.Scene, patterns: list[Path], output: Path) -> object:
    """All that the answer depends on, but for the disk."""
    cycles = scene.render.engine == "CYCLES"
    layers = [(name, *prepare.missing_passes(scene.view_layers[name])) for name in shot.layers(scene) if cycles]
    return patterns, output, shot.frame_range(scene), layers, shot.settings(scene, None), shot.render_size(scene)


class HUSH_OT_check_shot(SceneOperator, bpy.types.Operator):
    """Look for what is missing to denoise this shot well"""

    bl_idname = "hush.check_shot"
    bl_label = "Check Shot"
    bl_options = {"REGISTER"}

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        """Shows the problems with their fixes."""
        scene = self.scene_of(context)
        if scene is None:
            return {"CANCELLED"}
        problems(scene, fresh=True)
        return context.window_manager.invoke_popup(self, width=_POPUP_WIDTH)

    def draw(self, context: bpy.types.Context) -> None:
        """A paragraph for each problem; a fixed one vanishes."""
        scene = bpy.data.scenes.get(self.scene) or context.scene
        found = last_problems(scene)
        self.layout.label(text=_summary(found), icon="ERROR" if found else "CHECKMARK")
        width = paragraph.popup_width(_POPUP_WIDTH)
        for problem in found:
            paragraph.draw_with_fix(self.layout, problem.text, width, icon=ICONS[problem.level], fix=problem.fix)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Reports the problems; cancelled, with an error, where the shot cannot be denoised so."""
        scene = self.scene_of(context)
        if scene is None:
            return {"CANCELLED"}
        found = problems(scene, fresh=True)
        for problem in found:
            if problem.level != ERROR:
                self.report({problem.level}, problem.text)
        errors = [problem.text for problem in found if problem.level == ERROR]
        if errors:
            self.report({"ERROR"}, ". ".join(errors))
            return {"CANCELLED"}
        self.report({"INFO"}, _summary(found))
        return {"FINISHED"}


def _summary(found: list[Problem]) -> str:
    serious = [problem for problem in found if problem.level != INFO]
    if not serious:
        return messages.text("ready")
    return messages.text("problems", count=len(serious))


def register() -> None:
    """Adds the operator."""
    bpy.utils.register_class(HUSH_OT_check_shot)


def unregister() -> None:
    """Takes the operator away."""
    bpy.utils.unregister_class(HUSH_OT_check_shot)
    forget()

# SPDX-FileCopyrightText: 2026 Hush authors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Keeps what panels and nodes show up to date: the disk is read and nodes are changed in a timer, never while drawing or rendering."""

import time
import traceback

import bpy

from . import messages, shot, status
from .checks import check
from .messages import Refusal
from .nodes import node

# How often the timer asks whether there is something to do, and how long the playhead must rest before a frame is read.
_TICK, _REST = 0.1, 0.15
# How often what is drawn is looked up, in seconds and in times of what the last look took.
_PERIOD, _TIMES = 1.0, 50.0
_problems: dict[int, list] = {}
_folders: dict[int, list[str]] = {}
_last = _took = 0.0
_wanted: float | None = None
_for_panels = False


def folders(scene: bpy.types.Scene) -> list[str]:
    """Where the frames are and go to, in words, as of the last look; none before the first one."""
    return _folders.get(scene.session_uid, [])


def problems(scene: bpy.types.Scene) -> list | None:
    """What `check.problems` said last; None before the first time."""
    return _problems.get(scene.session_uid)


def request(*, now: bool = False, nodes_only: bool = False) -> None:
    """Asks for a fresh look soon, or with `now` as soon as Blender rests. From any thread and while drawing: it only notes the time.

    With `nodes_only` what the panels tell is not looked up.
    """
    global _wanted, _for_panels
    _for_panels |= not nodes_only
    if now:
        _wanted = time.monotonic() + _REST
    elif _wanted is None:
        _wanted = max(time.monotonic(), _last + max(_PERIOD, _TIMES * _took))


def shot_changed() -> None:
    """After frames were rendered, denoised or deleted. The nodes follow once no render runs."""
    status.forget()
    request(now=True)


def _tick() -> float:
    global _wanted, _for_panels
    if _wanted is not None and time.monotonic() >= _wanted and not _is_busy():
        nodes_only = not _for_panels
        _wanted, _for_panels = None, False
        try:
            look(nodes_only=nodes_only)
        except Exception:
            # Blender ends a timer that raises, and nothing would be looked up any more.
            traceback.print_exc()
    return _TICK


def _is_busy() -> bool:
    """While frames are rendered nodes must not change, and while they are played there is no time to read any."""
    windows = bpy.context.window_manager.windows
    return bpy.app.is_job_running("RENDER") or any(window.screen.is_animation_playing for window in windows)


def look(*, nodes_only: bool = False) -> None:
    """Looks at the disk and at what the open scenes show; from the main thread."""
    global _last, _took
    began = time.monotonic()
    if nodes_only and not node.are_there():
        _last, _took = began, 0.0
        return
    changed = False
    scenes = list(dict.fromkeys(window.scene for window in bpy.context.window_manager.windows))
    for scene in () if nodes_only else scenes:
        before = status.last_known(scene)
        after = status.shot_status(scene)
        found = check.problems(scene)
        places = _places(scene)
        changed |= before != after or problems(scene) != found or folders(scene) != places
        _problems[scene.session_uid], _folders[scene.session_uid] = found, places
    before_nodes = _shown(scenes)
    node.sync(*scenes)
    _last = time.monotonic()
    _took = _last - began
    if changed or before_nodes != _shown(scenes):
        redraw()


def _places(scene: bpy.types.Scene) -> list[str]:
    try:
        sources = [messages.text("frames_from", path=path) for path in shot.frame_patterns(scene)]
        return [*sources, messages.text("frames_to", path=shot.output_folder(scene))]
    except Refusal as error:
        return [str(error)]


def _shown(scenes: list[bpy.types.Scene]) -> list[tuple[bool, str]]:
    return [(node.is_on(tree), node.why_off(tree)) for scene in scenes for tree in node.trees(scene)]


def redraw() -> None:
    """Draws the editors that show the shot anew."""
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            if area.type in {"PROPERTIES", "NODE_EDITOR"}:
                area.tag_redraw()


def forget() -> None:
    """Another file was opened."""
    _problems.clear()
    _folders.clear()
    check.forget()
    status.forget()


def register() -> None:
    """Starts the timer."""
    if not bpy.app.background:
        bpy.app.timers.register(_tick, first_interval=_TICK, persistent=True)


def unregister() -> None:
    """Stops the timer."""
    if bpy.app.timers.is_registered(_tick):
        bpy.app.timers.unregister(_tick)
    forget()

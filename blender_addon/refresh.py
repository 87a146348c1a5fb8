# SPDX-FileCopyrightText: 2026 Hush authors
# SPDX-License-Identifier: Apache-2.0
"""Keeps what panel and node draw up to date: the disk is read and nodes are changed in a timer, never while drawing."""

import time

import bpy

from . import check, node, status

_DELAY = 0.2
_PERIOD = 1.0
_problems: dict[int, list] = {}
_last = 0.0


def problems(scene: bpy.types.Scene) -> list | None:
    """What `check.problems` said last; None before the first time."""
    return _problems.get(scene.session_uid)


def request(*, now: bool = False) -> None:
    """Asks for a fresh look soon; from drawing, so it only sets a timer, and none where the last look was just now."""
    if bpy.app.background or bpy.app.timers.is_registered(_look):
        return
    if now or time.monotonic() - _last > _PERIOD:
        bpy.app.timers.register(_look, first_interval=_DELAY)


def shot_changed(scene: bpy.types.Scene) -> None:
    """After frames were rendered, denoised or deleted: the nodes show the files as they are now. From the main thread."""
    status.forget()
    node.sync(scene, reload=True)
    request(now=True)


def _look() -> None:
    global _last
    # While frames are rendered, nodes are not to change.
    if bpy.app.is_job_running("RENDER"):
        return
    changed = False
    for scene in {window.scene for window in bpy.context.window_manager.windows}:
        before = status.last_known(scene)
        after = status.shot_status(scene)
        found = check.problems(scene)
        changed |= before != after or _problems.get(scene.session_uid) != found
        _problems[scene.session_uid] = found
        node.sync(scene, reload=before is not None and before.done != after.done)
    _last = time.monotonic()
    if changed:
        redraw()


def redraw() -> None:
    """Draws the editors that show the shot anew."""
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            if area.type in {"PROPERTIES", "NODE_EDITOR"}:
                area.tag_redraw()


def forget() -> None:
    """Another file was opened."""
    _problems.clear()
    status.forget()


def unregister() -> None:
    """Stops the timer."""
    if bpy.app.timers.is_registered(_look):
        bpy.app.timers.unregister(_look)
    forget()

# SPDX-FileCopyrightText: 2026 Hush authors
# SPDX-License-Identifier: Apache-2.0
"""What happens by itself: nodes turn to the denoised or the incoming image at each frame, and find their files after loading."""

import bpy
from bpy.app.handlers import persistent

from . import exr, node, refresh

_rendering: set[int] = set()


@persistent
def load_post(*_: object) -> None:
    """Folders beside the .blend may have moved with it."""
    _rendering.clear()
    exr.forget()
    refresh.forget()
    for scene in bpy.data.scenes:
        node.sync(scene)


@persistent
def frame_change_pre(scene: bpy.types.Scene, *_: object) -> None:
    """Also called while a frame is rendered, for the frames beside it; those are not shown."""
    if not _rendering:
        node.switch(scene)


@persistent
def render_init(scene: bpy.types.Scene, *_: object) -> None:
    """From here on frames change for rendering."""
    _rendering.add(scene.session_uid)


@persistent
def render_pre(scene: bpy.types.Scene, *_: object) -> None:
    """The last chance before compositing. With a window, this is not the main thread: no node is rebuilt then."""
    if bpy.app.background:
        node.sync(scene)
    else:
        node.switch(scene)


@persistent
def render_end(scene: bpy.types.Scene, *_: object) -> None:
    """Complete or cancelled."""
    _rendering.clear()


@persistent
def undo_post(scene: bpy.types.Scene, *_: object) -> None:
    """Undo brings back the switches as they were at another frame."""
    node.switch(scene)


_HANDLERS = {
    "load_post": load_post,
    "frame_change_pre": frame_change_pre,
    "render_init": render_init,
    "render_pre": render_pre,
    "render_complete": render_end,
    "render_cancel": render_end,
    "undo_post": undo_post,
    "redo_post": undo_post,
}


def register() -> None:
    """Adds the handlers."""
    for name, function in _HANDLERS.items():
        getattr(bpy.app.handlers, name).append(function)


def unregister() -> None:
    """Takes the handlers and the timer away."""
    for name, function in _HANDLERS.items():
        handlers = getattr(bpy.app.handlers, name)
        if function in handlers:
            handlers.remove(function)
    refresh.unregister()
    _rendering.clear()

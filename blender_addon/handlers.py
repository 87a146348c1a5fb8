# SPDX-FileCopyrightText: 2026 Hush authors
# SPDX-License-Identifier: GPL-3.0-or-later
"""What happens by itself: nodes pass their input through in renders and saved files, and show frames in between.

Only what runs in the main thread changes nodes; a render's own thread writes a custom property at most, before Blender reads it.
"""

import bpy
from bpy.app.handlers import persistent

from . import refresh
from .nodes import node

_suspended: dict[str, int] = {}


@persistent
def load_post(*_: object) -> None:
    """A file that Blender saved by itself, as after a crash, may show a frame."""
    node.forget()
    refresh.forget()
    node.pass_through()
    refresh.request(now=True, nodes_only=True)


@persistent
def frame_change_post(*_: object) -> None:
    """The driver passes the new frame through at once; what is there for it is looked up when the playhead rests."""
    refresh.request(now=True, nodes_only=True)


@persistent
def depsgraph_update_post(*_: object) -> None:
    """A setting may have changed, by hand or by a script: what a node shows must follow, also where no panel is open."""
    refresh.request(now=node.settings_changed(), nodes_only=True)


@persistent
def undo_post(*_: object) -> None:
    """What was undone may have shown another frame."""
    node.pass_through()
    refresh.request(now=True, nodes_only=True)


@persistent
def render_init(*_: object) -> None:
    """What is being rendered is newer than any denoised file."""
    node.pass_through()


@persistent
def render_pre(scene: bpy.types.Scene, *_: object) -> None:
    """A frame rendered by itself is newer than its file."""
    if not bpy.app.background:
        node.frame_is_rendered(scene)


@persistent
def render_done(*_: object) -> None:
    """The nodes may show frames again."""
    refresh.request(now=True, nodes_only=True)


@persistent
def save_pre(*_: object) -> None:
    """A saved file shows no denoised frame, whoever opens it."""
    _suspended.update(node.suspend())


@persistent
def save_post(*_: object) -> None:
    """On the screen it goes on being shown."""
    if not bpy.app.background:
        node.resume(_suspended)
    _suspended.clear()


_HANDLERS = (
    ("load_post", load_post),
    ("frame_change_post", frame_change_post),
    ("depsgraph_update_post", depsgraph_update_post),
    ("undo_post", undo_post),
    ("redo_post", undo_post),
    ("render_init", render_init),
    ("render_pre", render_pre),
    ("render_complete", render_done),
    ("render_cancel", render_done),
    ("save_pre", save_pre),
    ("save_post", save_post),
    ("save_post_fail", save_post),
)


def register() -> None:
    """Adds the handlers and the timer."""
    for name, function in _HANDLERS:
        getattr(bpy.app.handlers, name).append(function)
    refresh.register()


def unregister() -> None:
    """Takes the handlers and the timer away."""
    for name, function in _HANDLERS:
        handlers = getattr(bpy.app.handlers, name)
        if function in handlers:
            handlers.remove(function)
    refresh.unregister()

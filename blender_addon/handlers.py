# SPDX-FileCopyrightText: 2026 Hush authors
# SPDX-License-Identifier: Apache-2.0
"""What happens by itself: nodes find their files after loading and before rendering."""

import bpy
from bpy.app.handlers import persistent

from . import node, refresh


@persistent
def load_post(*_: object) -> None:
    """Folders beside the .blend may have moved with it."""
    node.forget()
    refresh.forget()
    for scene in bpy.data.scenes:
        node.sync(scene)


@persistent
def render_init(scene: bpy.types.Scene, *_: object) -> None:
    """Frames may have been denoised since. With a window this is not the main thread; there the panel keeps the nodes fresh."""
    if bpy.app.background:
        node.sync(scene, fresh=True)


_HANDLERS = {"load_post": load_post, "render_init": render_init}


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

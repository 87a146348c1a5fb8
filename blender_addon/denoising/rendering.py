# SPDX-FileCopyrightText: 2026 Hush authors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Blender's own render of some frames of a scene, over what is there; the scene's settings are held for it and given back."""

import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from typing import Any

import bpy

from .. import messages
from ..messages import Refusal

_RUNS_OF_FRAMES = "frame_start" in bpy.ops.render.render.get_rna_type().properties
# Seconds without Blender's render after which it is over: where it gives up before the first frame, it calls no handler.
_SILENCE = 1.0


@contextmanager
def only(scene: bpy.types.Scene, first: int, last: int) -> Iterator[dict[str, Any]]:
    """The arguments with which Blender renders these frames only, also those that are there.

    For so long Overwrite is on and Placeholders are off, and before 5.0 the scene's range is set.
    """
    arguments: dict[str, Any] = {"animation": True, "scene": scene.name}
    wanted = [(scene.render, "use_overwrite", True), (scene.render, "use_placeholder", False)]
    if _RUNS_OF_FRAMES:
        arguments |= {"frame_start": first, "frame_end": last}
    else:
        wanted += [(scene, "frame_start", first), (scene, "frame_end", last)]
    before = [(owner, name, getattr(owner, name)) for owner, name, _ in wanted]
    try:
        for owner, name, value in wanted:
            setattr(owner, name, value)
        yield arguments
    finally:
        for owner, name, value in before:
            setattr(owner, name, value)


def _render_in_window(arguments: dict[str, Any]) -> set[str]:
    return bpy.ops.render.render("INVOKE_DEFAULT", **arguments)


class Rendering:
    """A render in a window, which ends in its own time. Ask `is_over` now and then; call `end` whatever became of it."""

    def __init__(self) -> None:
        self.stopped = False
        # Set by handlers, which are not called in the main thread.
        self._began = self._ended = False
        self._seen = 0.0
        self._held = ExitStack()

    @property
    def failed(self) -> bool:
        """Whether it is over without having come to an end."""
        return not self._ended

    def start(self, scene: bpy.types.Scene, first: int, last: int) -> None:
        """Has Blender begin.

        Raises:
            Refusal: It does not.
            RuntimeError: It does not, and says why.
        """
        for place, function in self._places():
            place.append(function)
        self._seen = time.monotonic()
        if "CANCELLED" in _render_in_window(self._held.enter_context(only(scene, first, last))):
            raise Refusal(messages.text("whole_no_start"))

    def is_over(self) -> bool:
        """Whether Blender renders no more. Gives the settings back as soon as Blender has its own copy of them."""
        if self._began:
            self._held.close()
        if bpy.app.is_job_running("RENDER"):
            self._seen = time.monotonic()
            return False
        return self._ended or time.monotonic() - self._seen > _SILENCE

    def stop(self) -> None:
        """Waits for it no longer."""
        self._ended = self.stopped = True

    def end(self) -> None:
        """Gives the settings back, and listens no more."""
        self._held.close()
        for place, function in self._places():
            if function in place:
                place.remove(function)

    def _pre(self, *_: object) -> None:
        self._began = True

    def _complete(self, *_: object) -> None:
        self._ended = True

    def _cancel(self, *_: object) -> None:
        self._ended = self.stopped = True

    def _places(self) -> list[tuple[list[Callable], Callable]]:
        handlers = bpy.app.handlers
        return [(handlers.render_pre, self._pre), (handlers.render_complete, self._complete), (handlers.render_cancel, self._cancel)]

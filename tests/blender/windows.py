"""For cases about operators that go on in a window, which a Blender in the background has not."""

from __future__ import annotations

from types import FunctionType, MethodType, SimpleNamespace

import bpy
import kit


class Window:
    """Stands in for Blender's window: what an operator would show and report."""

    def __init__(self) -> None:
        self.shown: list[str | None] = []
        self.reports: list[tuple[str, str]] = []
        self.removed = False
        nothing = lambda *_: None
        self.window_manager = SimpleNamespace(
            progress_begin=nothing, progress_update=nothing, progress_end=nothing, event_timer_remove=self.remove
        )
        self.workspace = SimpleNamespace(status_text_set=self.shown.append)
        self.scene = bpy.context.scene

    def remove(self, _timer: object) -> None:
        self.removed = True

    def operator(self, kind: type, **properties: object) -> SimpleNamespace:
        """An operator's own functions on an object that is not Blender's."""
        fake = SimpleNamespace(scene="", _timer=object(), **properties)
        for cls in reversed([cls for cls in kind.__mro__ if cls.__module__.startswith(kit.MODULE)]):
            for name, function in vars(cls).items():
                if isinstance(function, FunctionType):
                    setattr(fake, name, MethodType(function, fake))
        fake.report = lambda level, text: self.reports.append((*level, text))
        return fake

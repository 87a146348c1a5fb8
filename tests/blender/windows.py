"""For cases about operators that go on in a window, which a Blender in the background has not."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from types import FunctionType, MethodType, ModuleType, SimpleNamespace

import bpy
import kit


class _Instead:
    """Another object, but for what is put in its place."""

    def __init__(self, real: object, **instead: object) -> None:
        self._real = real
        vars(self).update(instead)

    def __getattr__(self, name: str) -> object:
        return getattr(self._real, name)


@contextmanager
def foreground(*modules: ModuleType, rendering: bool = False) -> Iterator[_Instead]:
    """These modules of the extension take Blender for one with a window; `is_job_running` of what is yielded may be set anew."""
    app = _Instead(bpy.app, background=False, is_job_running=lambda _: rendering)
    for module in modules:
        module.bpy = _Instead(bpy, app=app)
    try:
        yield app
    finally:
        for module in modules:
            module.bpy = bpy


class Window:
    """Stands in for Blender's window: what an operator would show and report."""

    def __init__(self) -> None:
        self.shown: list[str | None] = []
        self.reports: list[tuple[str, str]] = []
        self.removed = False
        self.window = object()
        nothing = lambda *_, **__: None
        self.window_manager = SimpleNamespace(
            progress_begin=nothing,
            progress_update=nothing,
            progress_end=nothing,
            event_timer_add=lambda *_, **__: object(),
            event_timer_remove=self.remove,
            modal_handler_add=nothing,
        )
        self.workspace = SimpleNamespace(name="Layout", status_text_set=self.shown.append)
        self.scene = bpy.context.scene

    def remove(self, _timer: object) -> None:
        self.removed = True

    def operator(self, kind: type, **properties: object) -> SimpleNamespace:
        """An operator's own functions and values on an object that is not Blender's."""
        fake = SimpleNamespace()
        for cls in reversed([cls for cls in kind.__mro__ if cls.__module__.startswith(kit.MODULE)]):
            for name, value in vars(cls).items():
                if isinstance(value, FunctionType):
                    setattr(fake, name, MethodType(value, fake))
                elif not name.startswith(("__", "bl_")):
                    setattr(fake, name, value)
        vars(fake).update({"scene": "", "_timer": object(), **properties})
        fake.report = lambda level, text: self.reports.append((*level, text))
        return fake

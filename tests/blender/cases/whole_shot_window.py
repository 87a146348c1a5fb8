"""Render and Denoise Shot in a window where Blender's render does not come to an end; nothing of it stays behind."""

from __future__ import annotations

import time
from collections.abc import Callable
from types import SimpleNamespace

import bpy
import kit
import windows

whole_shot, rendering, background = (kit.module(f"{name}") for name in ("denoising.whole_shot", "denoising.rendering", "jobs.background"))
denoise = kit.module("denoising.denoise")


def listeners() -> int:
    handlers = bpy.app.handlers
    return sum(len(place) for place in (handlers.render_pre, handlers.render_complete, handlers.render_cancel))


def settings(scene: bpy.types.Scene) -> tuple[object, ...]:
    return scene.frame_start, scene.frame_end, scene.render.use_overwrite, scene.render.use_placeholder


class Pressed:
    """The button pressed on a shot that lacks frame 3, and Blender's render that does what it is told here."""

    def __init__(self, name: str, render: Callable[[dict[str, object]], set[str]]) -> None:
        folder = kit.copy_of_shot(name)
        (folder / "frame_0003.exr").unlink()
        self.scene = kit.build_scene("plain", folder)
        self.scene.render.use_overwrite = False
        self.window = windows.Window()
        self.fake = self.window.operator(whole_shot.HUSH_OT_whole_shot, render_again=False)
        self._render = render

    def press(self, until: Callable[[], bool] = lambda: False, *, rendering_now: bool = False) -> set[str]:
        """Invokes it and lets its timer tick until it ends or `until` is true; then presses Esc if it goes on."""
        real, rendering._render_in_window = rendering._render_in_window, self._render
        try:
            with windows.foreground(whole_shot, rendering, rendering=rendering_now):
                result = self.fake.invoke(self.window, None)
                end = time.monotonic() + 20
                while result != {"CANCELLED"} and not until():
                    assert time.monotonic() < end, "it waits for ever"
                    result = self.fake.modal(self.window, SimpleNamespace(type="TIMER", value="PRESS"))
                    time.sleep(0.02)
                if result != {"CANCELLED"}:
                    assert self.fake.modal(self.window, SimpleNamespace(type="ESC", value="PRESS")) == {"RUNNING_MODAL"}
                    result = self.fake.modal(self.window, SimpleNamespace(type="TIMER", value="PRESS"))
        finally:
            rendering._render_in_window = real
        return result


def left_nothing(pressed: Pressed, before: tuple[object, ...], heard: int) -> None:
    assert pressed.window.removed, "its timer ticks on"
    assert settings(pressed.scene) == before and listeners() == heard
    assert not background._going_on and denoise.HUSH_OT_denoise_shot.poll(bpy.context)


def test_blender_raises() -> None:
    def fails(_: dict[str, object]) -> set[str]:
        raise RuntimeError("Error: Cannot render, no camera")

    heard = listeners()
    pressed = Pressed("raises", fails)
    before = settings(pressed.scene)
    assert pressed.press() == {"CANCELLED"}
    assert pressed.window.reports[-1] == ("ERROR", "Cannot render, no camera"), pressed.window.reports
    left_nothing(pressed, before, heard)


def test_blender_does_not_begin() -> None:
    heard = listeners()
    pressed = Pressed("cancelled", lambda _: {"CANCELLED"})
    before = settings(pressed.scene)
    assert pressed.press() == {"CANCELLED"} and "did not render" in pressed.window.reports[-1][1], pressed.window.reports
    left_nothing(pressed, before, heard)


def test_an_empty_render_region() -> None:
    """Blender gives up and calls neither render_complete nor render_cancel."""

    def gives_up(arguments: dict[str, object]) -> set[str]:
        # In a window it has begun before it says so.
        kit.refused(bpy.ops.render.render, **arguments)
        return {"RUNNING_MODAL"}

    heard = listeners()
    pressed = Pressed("region", gives_up)
    render = pressed.scene.render
    render.use_border, render.border_min_x, render.border_max_x = True, 0.5, 0.5
    before = settings(pressed.scene)
    assert pressed.press() == {"CANCELLED"}
    level, text = pressed.window.reports[-1]
    assert level == "ERROR" and "did not render" in text, text
    left_nothing(pressed, before, heard)


def test_esc_ends_the_wait() -> None:
    """Where Blender is asked and neither renders nor says anything."""
    heard = listeners()
    pressed = Pressed("silent", lambda _: {"RUNNING_MODAL"})
    before = settings(pressed.scene)
    assert pressed.press(until=lambda: pressed.fake._render is not None) == {"CANCELLED"}
    assert pressed.window.reports[-1][0] == "WARNING" and "stopped" in pressed.window.reports[-1][1], pressed.window.reports
    left_nothing(pressed, before, heard)


def test_no_other_job_while_blender_renders() -> None:
    pressed = Pressed("busy", lambda _: {"RUNNING_MODAL"})
    with windows.foreground(whole_shot, rendering, rendering=True):
        real, rendering._render_in_window = rendering._render_in_window, pressed._render
        try:
            pressed.fake.invoke(pressed.window, None)
            pressed.fake.modal(pressed.window, SimpleNamespace(type="TIMER", value="PRESS"))
            kit.refused(bpy.ops.hush.denoise_shot, "is being rendered")
        finally:
            rendering._render_in_window = real
            pressed.fake.cancel(pressed.window)
    assert bpy.ops.hush.denoise_shot.poll()


def test_switching_the_extension_off_ends_what_goes_on() -> None:
    heard = listeners()
    pressed = Pressed("off", lambda _: {"RUNNING_MODAL"})
    before, ended = settings(pressed.scene), []
    with windows.foreground(whole_shot, rendering, rendering=True):
        real, rendering._render_in_window = rendering._render_in_window, pressed._render
        try:
            pressed.fake.invoke(pressed.window, None)
            pressed.fake.modal(pressed.window, SimpleNamespace(type="TIMER", value="PRESS"))
        finally:
            rendering._render_in_window = real
        assert listeners() > heard
        cancel = pressed.fake.cancel
        pressed.fake.cancel = lambda _context: (ended.append(True), cancel(pressed.window))
        kit.disable()
    own = 3  # Hush's handlers of renders, which go with it
    assert ended and pressed.window.removed and settings(pressed.scene) == before and listeners() == heard - own
    kit.enable()


def test_the_status_text_of_others_stays() -> None:
    class Space:
        def __init__(self, name: str) -> None:
            self.name, self.said = name, []

        def status_text_set(self, text: str | None) -> None:
            self.said.append(text)

    ours, others = Space("Layout"), Space("Compositing")
    window = windows.Window()
    window.workspace = ours
    fake = window.operator(denoise.HUSH_OT_denoise_shot, _job=SimpleNamespace(text="Denoising", fraction=0.5, cancelled=False))
    background.bpy = SimpleNamespace(data=SimpleNamespace(workspaces=[ours, others]))
    try:
        fake._show(window)
        fake._hide(window)
    finally:
        background.bpy = bpy
    assert "Denoising" in ours.said[0] and ours.said[1:] == [None] and others.said == []

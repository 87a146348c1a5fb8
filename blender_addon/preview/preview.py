# SPDX-FileCopyrightText: 2026 Hush authors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Denoise This Frame: the current frame by the scene's settings, in the Image Editor, with before and after and what flickers."""

import os
import time
from pathlib import Path
from typing import Any

import bpy
from bpy.app.handlers import persistent
from bpy.props import BoolProperty, EnumProperty, FloatProperty

from .. import compat, messages, paragraph, shot
from ..checks.scene import to_set_before_rendering
from ..jobs import background
from ..messages import Refusal
from . import display
from .job import PreviewJob

# A slider that is dragged asks for many images; one is made when it rests this long.
_REST = 0.05
VIEWS = (
    ("WIPE", "Before and After", "As rendered on the left, denoised on the right"),
    ("DENOISED", "Denoised", "The denoised frame"),
    ("NOISY", "As Rendered", "The frame as Cycles rendered it"),
    ("FLICKER", "Flicker", "What changes from the frame before along the motion: as rendered on the left, denoised on the right"),
)
# How it is shown lives here and not in the file.
_view = {"view": 0, "wipe": 0.5}
_running: PreviewJob | None = None
_taken_out: list[bpy.types.SpaceImageEditor] = []


def view_of() -> tuple[str, float]:
    """How it is shown: the view, and where the wipe is."""
    return VIEWS[_view["view"]][0], _view["wipe"]


def _set_view(name: str, value: float) -> None:
    if _view[name] == value:
        return
    _view[name] = value
    if bpy.app.background:
        _refresh()
    elif not bpy.app.timers.is_registered(_refresh):
        bpy.app.timers.register(_refresh, first_interval=_REST)


def _refresh() -> None:
    display.update(*view_of())
    _redraw()


def arguments(scene: bpy.types.Scene, view_layer: str, *, flicker: bool = False) -> tuple[Path, list[float] | None, dict[str, Any]]:
    """The frame's file, the border, and the arguments of `hush.preview`.

    Raises:
        Refusal: The frame is not rendered, or the scene's paths cannot be used.
    """
    frame = scene.frame_current
    pattern = shot.frame_patterns(scene)[0]
    file = shot.frame_file(pattern, frame)
    if not os.path.isfile(file):
        unrendered = messages.text("preview_unrendered", frame=frame, file=file, how=shot.how_to_render(scene))
        raise Refusal(". ".join([*to_set_before_rendering(scene), unrendered]))
    render, layers = scene.render, shot.layers(scene)
    border = [render.border_min_x, render.border_min_y, render.border_max_x, render.border_max_y] if render.use_border else None
    return (
        file,
        border,
        {
            "inputs": str(pattern),
            "frame": frame,
            "lam": shot.lambda_at(scene, frame),
            **shot.lambda_mask(scene),
            "window": shot.window(scene),
            "second_pass": bool(scene.hush.second_pass),
            "flicker": flicker,
            "layers": [view_layer] if view_layer in layers else layers[:1],
            "vector_layer": shot.vector_layer(scene),
            "threads": render.threads if render.threads_mode == "FIXED" else None,
        },
    )


def in_words(result: dict[str, Any]) -> str:
    """What was done, in a sentence."""
    helped = result["neighbours"]
    key = "preview_helped" if helped else "preview_alone"
    return messages.text(key, frame=result["frame"], frames=helped, seconds=result["seconds"], lam=result["lam"])


def notes(result: dict[str, Any]) -> list[str]:
    """What is odd about the frames, in the words of the buttons."""
    return list(dict.fromkeys(messages.sentence(messages.of_error(note)) for note in result["notes"]))


class HUSH_OT_preview_frame(background.JobOperator, bpy.types.Operator):
    """Denoise the current frame, or its render region, with the scene's settings and show it in the Image Editor. Nothing is saved"""

    bl_idname = "hush.preview_frame"
    bl_label = "Denoise This Frame"
    bl_options = {"REGISTER"}

    flicker: BoolProperty(
        name="Flicker",
        description="Also denoise the frame before, to show what changes along the motion; takes twice as long",
        default=False,
        options={"SKIP_SAVE"},
    )

    _job: PreviewJob | None = None
    _editor: bpy.types.SpaceImageEditor | None = None
    _scene_name = ""
    # The colour space of the scene's files, and so of the preview.
    _space = ""

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """One at a time."""
        if _running is not None:
            cls.poll_message_set("A frame is being denoised; Esc stops it")
            return False
        return True

    def _start(self, context: bpy.types.Context, scene: bpy.types.Scene) -> PreviewJob:
        global _running
        layer = context.view_layer.name if context.view_layer and scene == context.scene else ""
        self._scene_name, self._editor, self._space = scene.name, display.editor(context), compat.file_space(scene)
        _running = PreviewJob(scene, *arguments(scene, layer, flicker=self.flicker))
        return _running

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Denoises and returns when it is done; for scripts."""
        if not self._begin(context):
            return {"CANCELLED"}
        try:
            while not self._job.ended:
                self._job.poll()
                time.sleep(background.TICK / 4)
        except KeyboardInterrupt:
            self._drop()
            self.report({"ERROR"}, messages.text("preview_stopped"))
            return {"CANCELLED"}
        return self._finish()

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Looks at the worker now and then; every other event goes on to Blender."""
        if background.is_stop(event):
            self._hide(context)
            self._drop()
            self.report({"INFO"}, messages.text("preview_stopped"))
            return {"CANCELLED"}
        if event.type != "TIMER":
            return {"PASS_THROUGH"}
        self._job.poll()
        if self._job.ended:
            self._hide(context)
            return self._finish()
        self._show(context)
        return {"PASS_THROUGH"}

    def cancel(self, context: bpy.types.Context) -> None:
        """Blender ends the operator, as when another file is opened."""
        self._hide(context)
        self._drop()

    def _drop(self) -> None:
        global _running
        self._job.close()
        _running = None

    def _finish(self) -> set[str]:
        global _running
        done, _running = self._job, None
        if done.result is None:
            done.discard()
            self.report({"ERROR"}, done.error or messages.text("preview_stopped"))
            return {"CANCELLED"}
        if self.flicker:
            _view["view"] = len(VIEWS) - 1
        elif VIEWS[_view["view"]][0] == "FLICKER":
            _view["view"] = 0
        editor = self._editor if self._editor in display.editors() else None
        display.show(display.Shown(self._scene_name, done.folder, done.result, self._space), *view_of(), editor)
        for text in notes(done.result):
            self.report({"WARNING"}, text)
        text = in_words(done.result)
        self.report({"INFO"}, text if editor is not None else messages.text("preview_choose", done=text, image=display.NAME))
        _redraw()
        return {"FINISHED"}


class HUSH_OT_end_preview(bpy.types.Operator):
    """Take the image Hush Preview away; the Image Editor shows what it showed before"""

    bl_idname = "hush.end_preview"
    bl_label = "End Preview"
    bl_options = {"REGISTER"}

    def execute(self, _context: bpy.types.Context) -> set[str]:
        """Leaves the file as it was."""
        if not display.end():
            return {"CANCELLED"}
        _redraw()
        return {"FINISHED"}


class IMAGE_PT_hush(bpy.types.Panel):
    """The dial, the button, and how the preview is shown."""

    bl_label = "Hush Preview"
    bl_space_type = "IMAGE_EDITOR"
    bl_region_type = "UI"
    bl_category = "Hush"

    def draw(self, context: bpy.types.Context) -> None:
        """The scene's settings first: they are those of Denoise Shot too."""
        layout, scene = self.layout, context.scene
        layout.prop(scene.hush, "lam", slider=True)
        layout.prop(scene.hush, "window")
        column = layout.column(align=True)
        column.operator("hush.preview_frame", icon="IMAGE_DATA").flicker = False
        column.operator("hush.preview_frame", text="With Flicker").flicker = True
        if scene.render.use_border:
            layout.label(text=messages.text("preview_region"), icon="BORDERMOVE")
        if _running is not None:
            layout.progress(factor=_running.fraction, text=messages.text("preview_running"), type="BAR")
        shown = display.current()
        if shown is None or display.image() is None:
            return
        window_manager, result = context.window_manager, shown.result
        column = layout.column(align=True)
        column.prop(window_manager, "hush_preview_view", text="")
        if view_of()[0] in ("WIPE", "FLICKER"):
            column.prop(window_manager, "hush_preview_wipe", slider=True)
        column, width = layout.column(align=True), paragraph.width(context)
        about = {name: result[name] for name in ("frame", "lam", "window", "seconds")}
        paragraph.draw(column, messages.text("preview_about", **about), width)
        if result["change"] is not None:
            paragraph.draw(column, messages.text("preview_change", change=result["change"]), width)
        if view_of()[0] == "FLICKER":
            known = result["change"] is not None
            scale = messages.text("preview_scale", most=display.MOST_CHANGE)
            paragraph.draw(column, scale if known else messages.text("preview_no_flicker"), width)
        for text in notes(result):
            paragraph.draw(column, text, width, icon="QUESTION")
        layout.operator("hush.end_preview", icon="X")


def _redraw() -> None:
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "IMAGE_EDITOR":
                area.tag_redraw()


@persistent
def save_pre(*_: object) -> None:
    """The image never gets into a saved file."""
    _taken_out[:] = display.take_out()


@persistent
def save_post(*_: object) -> None:
    """After saving the artist still sees it."""
    display.put_back(*view_of(), _taken_out)
    _taken_out.clear()


@persistent
def load_pre(*_: object) -> None:
    """Another file knows nothing of it."""
    display.forget()


@persistent
def undone(*_: object) -> None:
    """Undo and redo may bring back an image that was taken away, and take one away that is shown."""
    display.remove_strays()
    if display.current() is not None and display.image() is None:
        display.end()


_HANDLERS = {
    "save_pre": save_pre,
    "save_post": save_post,
    "save_post_fail": save_post,
    "load_pre": load_pre,
    "load_post": undone,
    "undo_post": undone,
    "redo_post": undone,
}
_CLASSES = (HUSH_OT_preview_frame, HUSH_OT_end_preview, IMAGE_PT_hush)


def register() -> None:
    """Adds the operators, the panel and what takes the image away before saving."""
    for cls in _CLASSES:
        bpy.utils.register_class(cls)
    bpy.types.WindowManager.hush_preview_view = EnumProperty(
        name="View",
        description="What the image Hush Preview shows",
        items=VIEWS,
        get=lambda _: _view["view"],
        set=lambda _, value: _set_view("view", value),
    )
    bpy.types.WindowManager.hush_preview_wipe = FloatProperty(
        name="Wipe",
        description="Left of this place is the frame as rendered",
        min=0.0,
        max=1.0,
        subtype="FACTOR",
        get=lambda _: _view["wipe"],
        set=lambda _, value: _set_view("wipe", value),
    )
    for name, function in _HANDLERS.items():
        if hasattr(bpy.app.handlers, name):
            getattr(bpy.app.handlers, name).append(function)


def unregister() -> None:
    """Takes all of it away, the image too."""
    global _running
    if bpy.app.timers.is_registered(_refresh):
        bpy.app.timers.unregister(_refresh)
    if _running is not None:
        _running.close()
        _running = None
    display.end()
    for name, function in _HANDLERS.items():
        handlers = getattr(bpy.app.handlers, name, [])
        if function in handlers:
            handlers.remove(function)
    del bpy.types.WindowManager.hush_preview_wipe
    del bpy.types.WindowManager.hush_preview_view
    for cls in reversed(_CLASSES):
        bpy.utils.unregister_class(cls)

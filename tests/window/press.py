"""The steps of an artist in a window, one after the other; run.py starts it in Blender. Every step waits for what it yields."""

from __future__ import annotations

import importlib
import json
import os
import shutil
import subprocess
import time
import traceback
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from pathlib import Path
from types import ModuleType

import bpy
import numpy as np

ABOUT = json.loads(os.environ["HUSH_WINDOW"])
WORK, PICTURES = Path(ABOUT["work"]), Path(ABOUT["pictures"])
SHOT = WORK / "render"
FRAMES = 8
HUSH = "bl_ext.user_default.hush"
LONGEST = 600.0
DRAWN: Counter[str] = Counter()
Steps = Iterator[float | Callable[[], bool]]


def module(name: str) -> ModuleType:
    return importlib.import_module(f"{HUSH}.{name}")


def window() -> bpy.types.Window:
    return bpy.context.window_manager.windows[0]


def area(kind: str) -> bpy.types.Area:
    return next(each for each in window().screen.areas if each.type == kind)


def over(kind: str) -> AbstractContextManager[object]:
    """The context of the main region of an editor of this kind."""
    place = area(kind)
    return bpy.context.temp_override(window=window(), area=place, region=next(each for each in place.regions if each.type == "WINDOW"))


def press(operator: Callable, kind: str = "PROPERTIES", **arguments: object) -> set[str]:
    """As a button in an editor does."""
    with over(kind):
        return operator("INVOKE_DEFAULT", **arguments)


def escape() -> None:
    """The key, over the editor in the middle."""
    place = area("IMAGE_EDITOR")
    at = {"x": place.x + place.width // 3, "y": place.y + place.height // 2}
    for value in ("PRESS", "RELEASE"):
        window().event_simulate(type="ESC", value=value, **at)


def workspace(name: str) -> Steps:
    window().workspace = bpy.data.workspaces[name]
    yield 1.0
    area("PROPERTIES").spaces[0].context = "RENDER"
    for each in window().screen.areas:
        if each.type in ("IMAGE_EDITOR", "NODE_EDITOR"):
            each.spaces[0].show_region_ui = True
            yield 1.0
            next(region for region in each.regions if region.type == "UI").active_panel_category = "Hush"
    yield 1.0


def picture(name: str, wait: float = 2.0) -> Steps:
    """Of the whole screen, by ImageMagick where it is there: Blender's own is black without a graphics card."""
    before = sum(DRAWN.values())
    for each in window().screen.areas:
        each.tag_redraw()
    yield wait
    assert sum(DRAWN.values()) > before, "no panel of Hush was drawn"
    if shutil.which("import"):
        subprocess.run(["import", "-window", "root", PICTURES / f"{name}.png"], check=True)


def idle() -> bool:
    return module("jobs.job").current() is None and not bpy.app.is_job_running("RENDER")


def written(folder: Path) -> int:
    return len(list(folder.glob("frame_*.exr")))


def counted(panel: type[bpy.types.Panel]) -> Callable:
    """Its `draw`, which is counted."""
    real = panel.draw

    def draw(self: bpy.types.Panel, context: bpy.types.Context) -> None:
        real(self, context)
        DRAWN[panel.__name__] += 1

    return draw


def open_panel() -> Steps:
    bpy.context.preferences.view.show_splash = False
    bpy.context.preferences.view.render_display_type = "NONE"
    # Open, and in sight, for the pictures: an artist opens it and scrolls there.
    panel = module("panel")
    for each in (panel.RENDER_PT_hush_folders, panel.RENDER_PT_hush_settings, panel.RENDER_PT_hush):
        bpy.utils.unregister_class(each)
    panel.RENDER_PT_hush.bl_options = set()
    for each in (panel.RENDER_PT_hush, panel.NODE_PT_hush, module("preview.preview").IMAGE_PT_hush):
        each.draw = counted(each)
    for each in (panel.RENDER_PT_hush, panel.RENDER_PT_hush_settings, panel.RENDER_PT_hush_folders):
        bpy.utils.register_class(each)
    yield from workspace("Rendering")
    with over("PROPERTIES"):
        for _ in range(13):
            bpy.ops.view2d.scroll_down()
    yield 4.0
    yield from picture("unprepared")


def check_and_prepare() -> Steps:
    press(bpy.ops.hush.check_shot)
    yield from picture("check_shot")
    escape()
    yield 1.0
    assert bpy.ops.hush.prepare_shot() == {"FINISHED"}
    assert not [each for each in module("checks.check").problems(bpy.context.scene, fresh=True) if each.key != "frames"]
    bpy.ops.wm.save_mainfile()


def render() -> Steps:
    press(bpy.ops.render.render, animation=True)
    yield lambda: bpy.app.is_job_running("RENDER")
    yield idle
    yield lambda: module("status").shot_status(bpy.context.scene).rendered == FRAMES


def denoise_until_esc() -> Steps:
    assert press(bpy.ops.hush.denoise_shot) == {"RUNNING_MODAL"}
    yield lambda: written(SHOT / "denoised") >= 1
    yield from picture("denoising", wait=0.3)
    assert not idle()
    escape()
    yield idle
    assert 1 <= written(SHOT / "denoised") < FRAMES, "Esc came too late, or not at all"
    assert not list((SHOT / "denoised").glob(".*.part"))


def denoise_the_rest() -> Steps:
    press(bpy.ops.hush.denoise_shot)
    yield lambda: written(SHOT / "denoised") == FRAMES
    yield idle
    yield lambda: module("status").shot_status(bpy.context.scene).done == FRAMES


def preview() -> Steps:
    import hush

    scene, dirty = bpy.context.scene, bpy.data.is_dirty
    scene.frame_set(4)
    press(bpy.ops.hush.preview_frame, "IMAGE_EDITOR", flicker=False)
    yield lambda: "Hush Preview" in bpy.data.images
    yield idle
    shown = bpy.data.images["Hush Preview"]
    assert area("IMAGE_EDITOR").spaces[0].image == shown and shown.use_view_as_render
    wanted = hush.preview(SHOT / "frame_####.exr", 4)
    made = np.array(shown.pixels[:]).reshape(270, 480, 4)[::-1]
    assert np.allclose(made[:, 240:, :3], wanted["denoised"][:, 240:, :3], atol=1e-6)
    assert np.allclose(made[:, :240, :3], wanted["noisy"][:, :240, :3], atol=1e-6)
    with over("IMAGE_EDITOR"):
        bpy.ops.image.view_zoom_ratio(ratio=1.6)
    yield from picture("preview")
    assert bpy.ops.hush.end_preview() == {"FINISHED"}
    assert "Hush Preview" not in bpy.data.images and bpy.data.is_dirty == dirty


def node_and_composite() -> Steps:
    yield from workspace("Compositing")
    scene = bpy.context.scene
    assert press(bpy.ops.hush.add_node, "NODE_EDITOR") == {"FINISHED"}
    tree = module("compat").compositor_tree(scene)
    node = next(each for each in tree.nodes if each.bl_idname == "CompositorNodeGroup")
    viewer = tree.nodes.new("CompositorNodeViewer")
    viewer.location = node.location.x + 300, node.location.y + 60
    module("compat").output_node(tree).location = node.location.x + 300, node.location.y - 120
    tree.links.new(node.outputs[0], viewer.inputs[0])
    scene.frame_set(5)
    yield lambda: module("nodes.node").is_on(node.node_tree)
    with over("NODE_EDITOR"):
        bpy.ops.node.view_all()
    yield from picture("node")
    press(bpy.ops.hush.composite_shot, "NODE_EDITOR")
    yield lambda: not idle()
    yield idle
    assert written(SHOT / "composited") == FRAMES


def out_of_date() -> Steps:
    yield from workspace("Rendering")
    bpy.context.scene.hush.lam = 4.0
    yield lambda: module("status").shot_status(bpy.context.scene).stale == FRAMES
    yield 4.0
    yield from picture("out_of_date")


def end() -> Steps:
    assert len(DRAWN) == 3, DRAWN
    yield 0.0


CASES = (open_panel, check_and_prepare, render, denoise_until_esc, denoise_the_rest, preview, node_and_composite, out_of_date, end)


class Player:
    """Plays the cases from a timer, so that Blender's own loop goes on between the steps."""

    def __init__(self) -> None:
        self.left = list(CASES)
        self.results: list[dict[str, object]] = []
        self.steps: Steps | None = None
        self.wait: Callable[[], bool] | None = None
        self.began = self.since = 0.0

    def tick(self) -> float | None:
        try:
            return self._go_on()
        except BaseException:  # noqa: BLE001 - whatever it is, it is the result
            self._finish(traceback.format_exc())
            os._exit(1)

    def _go_on(self) -> float | None:
        if self.steps is None:
            self.steps, self.began = self.left[0](), time.monotonic()
        if self.wait is not None and not self.wait():
            assert time.monotonic() - self.since < LONGEST, "it waits in vain"
            return 0.1
        self.wait = None
        # A timer's context has no window by itself.
        with bpy.context.temp_override(window=window()):
            step = next(self.steps, None)
        if step is None:
            self._finish("")
            self.left.pop(0)
            self.steps = None
            if not self.left:
                os._exit(0)
            return 0.1
        if callable(step):
            self.wait, self.since = step, time.monotonic()
            return 0.1
        return step

    def _finish(self, error: str) -> None:
        self.results.append({"name": self.left[0].__name__, "seconds": time.monotonic() - self.began, "error": error})
        (WORK / "results.json").write_text(json.dumps(self.results))


bpy.app.timers.register(Player().tick, first_interval=3.0, persistent=True)

"""The look that Hush takes now and then: nothing on the disk ends it, and it changes no node while Blender renders."""

from __future__ import annotations

import errno
import os
import shutil
import time
from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace

import bpy
import frames
import kit
import windows

check, files, node, refresh, status = (kit.module(name) for name in ("checks.check", "checks.files", "nodes.node", "refresh", "status"))


def after(seconds: float) -> float | None:
    """What the timer says once it has had something to do for so long."""
    refresh.request(now=True)
    time.sleep(seconds)
    return refresh._tick()


def levels(scene: bpy.types.Scene) -> list[str]:
    return [f"{each.level} {each.text}" for each in check.problems(scene, fresh=True)]


def test_a_name_that_is_too_long() -> None:
    scene = kit.build_scene()
    scene.render.filepath = f"/tmp/{'x' * 260}/frame_####"
    refresh.look()
    assert any("not rendered yet" in text for text in levels(scene)), levels(scene)
    kit.refused(bpy.ops.hush.denoise_shot)
    kit.refused(bpy.ops.hush.preview_frame, "not rendered")


def test_a_folder_that_may_not_be_looked_into() -> None:
    closed = kit.folder("closed")
    (closed / "in").mkdir()
    scene = kit.build_scene("plain", closed / "in")
    is_root = os.geteuid() == 0
    closed.chmod(0o700 if is_root else 0)
    if is_root:
        os.seteuid(65534)
    try:
        refresh.look()
        assert any(text.startswith("ERROR") and "closed" in text for text in levels(scene)), levels(scene)
        told = kit.refused(bpy.ops.hush.denoise_shot, "closed")
        assert "Traceback" not in told, told
    finally:
        if is_root:
            os.seteuid(0)
        closed.chmod(0o700)


def test_what_vanishes_under_the_look() -> None:
    folder = kit.copy_of_shot("vanishing")
    scene = kit.build_scene("plain", folder)
    real = shutil.disk_usage

    def gone(*_: object) -> object:
        raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), str(folder))

    shutil.disk_usage = gone
    try:
        assert not [text for text in levels(scene) if text.startswith("ERROR")], levels(scene)
    finally:
        shutil.disk_usage = real
    real, files._space = files._space, gone
    try:
        assert any("No such file" in text for text in levels(scene) if text.startswith("ERROR")), levels(scene)
    finally:
        files._space = real


def test_the_timer_goes_on_after_an_error() -> None:
    real = refresh.look

    def fails(**_: object) -> None:
        raise OSError("the network drive is gone")

    refresh.look = fails
    try:
        assert after(0.2) == refresh._TICK
    finally:
        refresh.look = real


def test_nodes_wait_for_the_render() -> None:
    """A job that ends while Blender renders: the node follows when it is over."""
    shot: Path = kit.copy_of_shot("rendering")
    scene, made = frames.scene_with_node(shot)
    frames.denoise(scene)
    scene.frame_set(2)
    denoise = kit.module("denoising.denoise")
    with windows.foreground(refresh, denoise, rendering=True) as app:
        running = denoise.start(scene)
        kit.ended(running)
        window = windows.Window()
        window.operator(denoise.HUSH_OT_denoise_shot, _job=running)._outcome()
        assert not node.is_on(made.node_tree), "it was changed at once"
        time.sleep(0.2)
        refresh._tick()
        assert not node.is_on(made.node_tree), "it was changed while Blender renders"
        app.is_job_running = lambda _: False
        refresh._tick()
    assert node.is_on(made.node_tree), "it was not changed afterwards"


def test_a_panel_writes_nothing() -> None:
    """Whether a folder can be written to is only tried where a button is pressed."""
    scene, written = kit.build_scene("plain", kit.copy_of_shot("unwritten")), []
    real, files.tempfile = files.tempfile, SimpleNamespace(TemporaryFile=lambda **named: written.append(named) or nullcontext())
    try:
        check.forget()
        refresh.look()
        assert not written, written
        check.problems(scene, fresh=True)
        assert written
    finally:
        files.tempfile = real


def test_without_a_node_a_change_costs_no_look() -> None:
    scene = kit.build_scene("plain", kit.copy_of_shot("without"))
    real, looked = node.sync, []
    node.sync = lambda *scenes: looked.append(scenes)
    try:
        refresh.look(nodes_only=True)
        assert not looked
        node.new(kit.module("compat").ensure_compositor_tree(scene))
        refresh.look(nodes_only=True)
        assert looked
    finally:
        node.sync = real

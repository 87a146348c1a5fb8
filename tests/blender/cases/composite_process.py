"""The process that composites: stopped, killed, without Blender, with a binary, and in a window."""

from __future__ import annotations

import json
import os
import shutil
import signal
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import bpy
import fingerprint
import kit
from composites import (
    HALF,
    combined,
    composite,
    denoised_scene,
    job,
    plain,
    refused,
    tree_of,
    untouched,
)
from windows import Window

TIME_LIMIT = 600.0


def test_a_frame_that_cannot_be_written_is_told_and_the_others_are_there() -> None:
    scene, folder = denoised_scene("unwritable")
    tree_of(scene, node=True)
    (folder / "composited" / "frame_0002.exr").mkdir(parents=True)
    refused("Frame 2 could not be composited", "2 of 3")
    assert kit.files(folder / "composited") == ["frame_0001.exr", "frame_0003.exr"]
    (folder / "composited" / "frame_0002.exr").rmdir()
    assert untouched() == {"FINISHED"}


def test_a_process_that_is_killed_is_told() -> None:
    scene, folder = denoised_scene("killed")
    tree_of(scene, node=True)
    before = fingerprint.take()
    running = composite.start(scene)
    assert not bpy.ops.hush.composite_shot.poll() and not bpy.ops.hush.denoise_shot.poll()
    os.kill(running._process.pid, signal.SIGKILL)
    result, reports = composite.outcome(kit.ended(running))
    assert result == "CANCELLED" and reports[-1][0] == "ERROR" and "killed" in reports[-1][1], reports
    assert not list(Path(bpy.app.tempdir).glob("hush-composite-*")) and not list((folder).glob("composited/.hush*"))
    assert not fingerprint.changes(before, fingerprint.take())
    assert untouched() == {"FINISHED"}


def test_the_process_ends_with_blender() -> None:
    scene, folder = denoised_scene("orphan")
    tree_of(scene, node=True)
    blend = kit.folder("orphan-file") / "shot.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(blend))
    told = kit.blender(
        f"""
import importlib, os, sys, bpy
bpy.ops.wm.open_mainfile(filepath=sys.argv[1])
running = importlib.import_module("{kit.MODULE}.compositing.composite").start(bpy.data.scenes["Scene"])
print("worker", running._process.pid, running._blend, flush=True)
os._exit(0)
""",
        blend,
    )
    worker, copy = told.split("worker ")[1].split()[:2]
    until = time.monotonic() + 30
    while Path(f"/proc/{worker}").exists() and "Z" not in Path(f"/proc/{worker}/stat").read_text(encoding="utf-8").split()[2]:
        assert time.monotonic() < until, "the process goes on without Blender"
        time.sleep(0.1)
    assert not Path(copy).exists() and not list((folder).glob("composited/.hush*"))


def test_blender_itself_is_started_where_it_is_one() -> None:
    """A stand-in for the binary, which does what Blender's options ask for."""
    scene, folder = denoised_scene("binary", frames=2)
    tree_of(scene, node=True)
    binary = kit.folder("binary-bin") / "blender"
    said = binary.parent / "arguments"
    script = f"""#!{sys.executable}
import json, runpy, sys
json.dump(sys.argv[1:], open({str(said)!r}, "w"))
print("Blender 0.0 (hash)", flush=True)
print("123")
sys.path.insert(0, {str(Path(bpy.utils.resource_path("LOCAL")).parents[1])!r})
import bpy
runpy.run_path(sys.argv[sys.argv.index("--python") + 1], run_name="__main__")
"""
    binary.write_text(script)
    binary.chmod(0o755)
    before = bpy.app.binary_path
    try:
        bpy.app.binary_path = str(binary)
        assert untouched() == {"FINISHED"}
    finally:
        bpy.app.binary_path = before
    given = json.loads(said.read_text())
    assert given[0] == "--background" and "--disable-autoexec" in given and given[given.index("--threads") + 1] == "2", given
    assert kit.files(folder / "composited") == ["frame_0001.exr", "frame_0002.exr"]


def operator(window: Window) -> SimpleNamespace:
    return window.operator(composite.HUSH_OT_composite_shot, allow_stale=False)


def run(window: Window, stop_when: Path | None = None) -> set[str]:
    """The timer until the operator ends; Esc once a file is there."""
    fake, before = operator(window), fingerprint.take()
    assert fake._begin(window)
    until = time.monotonic() + 60
    while time.monotonic() < until:
        if stop_when is not None and stop_when.exists():
            assert fake.modal(window, SimpleNamespace(type="ESC", value="PRESS")) == {"RUNNING_MODAL"}
            stop_when = None
        result = fake.modal(window, SimpleNamespace(type="TIMER", value="PRESS"))
        if result != {"PASS_THROUGH"}:
            changed = fingerprint.changes(before, fingerprint.take())
            assert not changed, changed
            return result
        time.sleep(0.005)
    raise AssertionError("the operator does not end")


def long_scene(name: str) -> tuple[bpy.types.Scene, Path]:
    """Sixty frames, so that there is time to stop it."""
    folder = kit.folder(name)
    for number in range(60):
        shutil.copy(kit.shot() / f"frame_{number % 5 + 1:04d}.exr", folder / f"frame_{number + 1:04d}.exr")
    scene = kit.build_scene("plain", folder)
    scene.frame_end = 60
    scene.hush.window = "0"
    assert bpy.ops.hush.denoise_shot() == {"FINISHED"}
    tree_of(scene, node=True)
    return scene, folder


def test_in_a_window_it_is_shown_and_esc_stops_after_the_frame_in_hand() -> None:
    scene, folder = long_scene("window")
    window = Window()
    result = run(window, stop_when=folder / "composited" / "frame_0002.exr")
    made = kit.files(folder / "composited")
    assert result == {"CANCELLED"} and "stopped" in window.reports[-1][1] and 2 <= len(made) < 60, (result, window.reports, made)
    assert any("Compositing frame" in str(text) for text in window.shown), window.shown
    for name in made:
        kit.assert_close(plain(folder / "composited" / name), combined(folder / "denoised" / name), HALF, name)
    scene.frame_end = 3
    window = Window()
    assert run(window) == {"FINISHED"} and "3 frames composited" in window.reports[-1][1], window.reports


def test_another_file_may_be_opened_or_the_scene_removed_meanwhile() -> None:
    scene, folder = denoised_scene("meanwhile")
    tree_of(scene, node=True)
    running = composite.start(scene)
    scene.name = "Renamed"
    bpy.ops.wm.read_homefile(use_empty=True)
    result, reports = composite.outcome(kit.ended(running))
    assert result == "FINISHED" and len(kit.files(folder / "composited")) == 3, reports
    scene, folder = denoised_scene("closed")
    tree_of(scene, node=True)
    window = Window()
    fake = operator(window)
    assert fake._begin(window)
    fake.cancel(window)
    assert job.current() is None and fake._job._process.poll() is not None
    assert not list(folder.glob("composited/.hush*")) and not list(Path(bpy.app.tempdir).glob("hush-composite-*"))

"""No stale frame: whatever a denoised frame was made from changes, the node passes its input through and says why."""

from __future__ import annotations

import os
import shutil
import time
from collections.abc import Callable
from pathlib import Path

import bpy
import frames
import kit
import numpy as np

TIME_LIMIT = 400.0


def prepared(name: str) -> tuple[Path, bpy.types.Scene, bpy.types.NodeTree]:
    shot = kit.copy_of_shot(name)
    scene, node = frames.scene_with_node(shot)
    frames.denoise(scene)
    frames.assert_same(frames.shown(scene, 3), frames.denoised(shot, 3), "current")
    return shot, scene, node.node_tree


def render_again(file: Path) -> None:
    """As another render would: other pixels, another time."""
    kit.rewrite(file, lambda name, pixels: pixels * np.float32(1.25) if ".Combined." in name and name[-1] in "RGB" else pixels)
    stat = file.stat()
    os.utime(file, ns=(stat.st_atime_ns, stat.st_mtime_ns + 5_000_000_000))


def truncate(file: Path) -> None:
    file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])


def test_inputs_that_change() -> None:
    changes: dict[str, tuple[Callable[[Path], None], str]] = {
        "rendered again": (lambda shot: render_again(shot / "frame_0003.exr"), "the render changed"),
        "a frame beside it rendered again": (lambda shot: render_again(shot / "frame_0002.exr"), "a frame beside it changed"),
        "truncated": (lambda shot: truncate(shot / "frame_0003.exr"), "damaged"),
        "missing": (lambda shot: (shot / "frame_0003.exr").unlink(), "gone"),
    }
    for what, (change, words) in changes.items():
        shot, scene, tree = prepared("changed")
        change(shot)
        frames.assert_incoming(frames.shown(scene, 3), what)
        why = kit.module("nodes.node").why_off(tree)
        assert words in why or words == "damaged" and "changed" in why, (what, why)
        told = {problem.text for problem in kit.module("checks.check").problems(scene, fresh=True) if problem.key == "stale"}
        assert any("3" in text and "Denoise Shot" in text for text in told), (what, told)
        kit.module("status").forget()
        assert kit.module("status").shot_status(scene).done < 5


def test_settings_that_change() -> None:
    changes = {
        "lam": (5.0, "λ"),
        "window": ("1", "Window"),
        "use_light_passes": (True, "Light Passes"),
        "keep_noisy": (True, "Keep Noisy Image"),
        "second_pass": (True, "Second Pass"),
    }
    shot, scene, tree = prepared("settings")
    for name, (value, words) in changes.items():
        before = getattr(scene.hush, name)
        setattr(scene.hush, name, value)
        frames.assert_incoming(frames.shown(scene, 3), name)
        assert words in kit.module("nodes.node").why_off(tree), (name, kit.module("nodes.node").why_off(tree))
        setattr(scene.hush, name, before)
        frames.assert_same(frames.shown(scene, 3), frames.denoised(shot, 3), f"{name} put back")


def test_lambda_keys_count_frame_by_frame() -> None:
    shot, scene, _ = prepared("keys")
    for frame, value in ((1, 1.0), (3, 1.0), (4, 9.0)):
        scene.hush.lam = value
        scene.keyframe_insert("hush.lam", frame=frame)
    frames.assert_same(frames.shown(scene, 2), frames.denoised(shot, 2), "frame 2")
    frames.assert_incoming(frames.shown(scene, 4), "frame 4")


def test_denoised_files_that_are_not_right() -> None:
    """Damaged, written by another program, or not by Hush at all; none of them is opened."""
    spoil: dict[str, Callable[[Path], None]] = {
        "empty": lambda file: file.write_bytes(b""),
        "header only": lambda file: file.write_bytes(file.read_bytes()[: file.stat().st_size // 20]),
        "half": truncate,
        "almost whole": lambda file: file.write_bytes(file.read_bytes()[: file.stat().st_size * 98 // 100]),
        "no picture": lambda file: file.write_bytes(b"no picture" * 1000),
        "the noisy file": lambda file: shutil.copy(file.parents[1] / file.name, file),
    }
    for what, change in spoil.items():
        shot, scene, tree = prepared("spoilt")
        change(shot / "denoised" / "frame_0003.exr")
        frames.assert_incoming(frames.shown(scene, 3), what)
        assert not kit.module("nodes.node").is_on(tree), what
    shot, scene, tree = prepared("strange")
    for file in (shot / "denoised").glob("*.json"):
        file.unlink()
    frames.assert_incoming(frames.shown(scene, 3), "without the manifest")
    assert "Hush" in kit.module("nodes.node").why_off(tree)


def test_another_resolution() -> None:
    shot, scene, tree = prepared("resolution")
    scene.render.resolution_percentage = 50
    kit.module("nodes.node").sync(scene)
    assert not kit.module("nodes.node").is_on(tree)
    assert "96 × 54" in kit.module("nodes.node").why_off(tree) and "48 × 27" in kit.module("nodes.node").why_off(tree)
    status = kit.module("status").shot_status(scene)
    assert status.done == 0 and "denoised at 96 × 54, the scene renders 48 × 27" in status.text, status
    scene.render.use_border = scene.render.use_crop_to_border = True
    kit.module("nodes.node").sync(scene)
    assert kit.module("nodes.node").is_on(tree), "with a border any size may be right"


def test_a_frame_that_was_rendered_by_itself() -> None:
    """After F12 the picture in front of the artist is newer than the file, until the file is written."""
    shot, scene, tree = prepared("by-itself")
    node = kit.module("nodes.node")
    scene.frame_set(3)
    # As in a window; in the background, frames are not remembered.
    node.frame_is_rendered(scene)
    frames.render(scene, 3, kit.folder("out"))
    frames.assert_incoming(frames.shown(scene, 3), "after F12")
    assert "newer than its file" in node.why_off(tree)
    frames.assert_same(frames.shown(scene, 2), frames.denoised(shot, 2), "another frame")
    frames.assert_incoming(frames.shown(scene, 3), "back at the frame")
    render_again(shot / "frame_0003.exr")
    frames.assert_incoming(frames.shown(scene, 3), "rendered into the file")
    assert "the render changed" in node.why_off(tree)
    frames.denoise(scene)
    frames.assert_same(frames.shown(scene, 3), frames.denoised(shot, 3), "denoised again")


def test_a_look_finds_what_changed() -> None:
    """As the timer does: new frames are shown without anything else being done."""
    shot = kit.copy_of_shot("looks")
    scene, node = frames.scene_with_node(shot)
    refresh = kit.module("refresh")
    assert [window.scene for window in bpy.context.window_manager.windows] == [scene]
    scene.frame_set(1)
    refresh.look()
    assert refresh.problems(scene) is not None and not kit.module("nodes.node").is_on(node.node_tree)
    frames.denoise(scene)
    refresh.look()
    assert kit.module("nodes.node").is_on(node.node_tree)
    scene.hush.lam = 7.0
    refresh.look()
    assert not kit.module("nodes.node").is_on(node.node_tree)


def test_the_timer_follows_what_happens() -> None:
    """A change of the frame, of a setting, and the end of a render each have the node looked at, when Blender rests."""
    shot, scene, tree = prepared("timer")
    refresh, node = kit.module("refresh"), kit.module("nodes.node")
    busy = [False]
    real, refresh._is_busy = refresh._is_busy, lambda: busy[0]

    def rest() -> None:
        time.sleep(refresh._REST + 0.05)
        refresh._tick()

    try:
        rest()
        scene.frame_set(2)
        assert kit.module("nodes.inside").shown_frame(tree) != 2
        busy[0] = True
        rest()
        assert kit.module("nodes.inside").shown_frame(tree) != 2, "nothing is changed while frames are rendered or played"
        busy[0] = False
        rest()
        assert kit.module("nodes.inside").shown_frame(tree) == 2
        scene.hush.lam = 12.0
        bpy.context.view_layer.update()
        rest()
        assert not node.is_on(tree), "a setting changed by a script"
        scene.hush.lam = 1.0
        frames.render(scene, 2, kit.folder("out"))
        assert not node.is_on(tree)
        rest()
        assert node.is_on(tree), "after the render"
    finally:
        refresh._is_busy = real


def test_the_disk_is_not_asked_all_the_time() -> None:
    shot, scene, _ = prepared("rest")
    status = kit.module("status")
    asked = []
    real = status._ask
    status._ask = lambda *arguments: asked.append(1) or real(*arguments)
    try:
        for _ in range(5):
            assert status.shot_status(scene).done == 5
        assert len(asked) <= 1, asked
        scene.hush.lam = 2.0
        assert status.shot_status(scene).done == 0, "a setting counts at once"
    finally:
        status._ask = real

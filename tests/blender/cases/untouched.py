"""No operator changes the artist's file but those that are asked to: all of bpy.data before and after, in success and in every failure."""

from __future__ import annotations

import os
import shutil
import signal
import sys
import time
from collections.abc import Callable
from pathlib import Path

import bpy
import composites
import fingerprint
import kit

TIME_LIMIT = 900.0
compat, composite, contents, denoise, job = (
    kit.module(name) for name in ("compat", "compositing.composite", "compositing.contents", "denoising.denoise", "jobs.job")
)
# Their purpose is a change that the artist asked for. The whole way begins with Prepare Shot; after that it is as the others.
ASKED = {"prepare_shot", "undo_prepare", "add_node", "fix"}
ROUNDS = 10


def rich_file(name: str, *, denoised: bool = True) -> tuple[bpy.types.Scene, Path]:
    """A saved file with something of everything that an add-on may harm, and the folder of its frames."""
    folder = kit.folder(name)
    for frame in (1, 2):
        shutil.copy(kit.shot() / f"frame_{frame:04d}.exr", folder)
    library = kit.folder(f"{name}-library") / "library.blend"
    shared = bpy.data.node_groups.new("Shared", "CompositorNodeTree")
    for direction in ("INPUT", "OUTPUT"):
        shared.interface.new_socket("Image", in_out=direction, socket_type="NodeSocketColor")
    shared.links.new(shared.nodes.new("NodeGroupInput").outputs[0], shared.nodes.new("NodeGroupOutput").inputs[0])
    bpy.data.libraries.write(str(library), {shared})
    scene = kit.build_scene("plain", folder)
    scene.frame_end = 2
    with bpy.data.libraries.load(str(library), link=True) as (_, wanted):
        wanted.node_groups = ["Shared"]
    tree = compat.ensure_compositor_tree(scene)
    layers = next(each for each in tree.nodes if each.bl_idname == "CompositorNodeRLayers")
    ours, linked, blur = tree.nodes.new("CompositorNodeGroup"), tree.nodes.new("CompositorNodeGroup"), tree.nodes.new("CompositorNodeBlur")
    ours.node_tree, linked.node_tree = composites.hush_group(), bpy.data.node_groups["Shared", str(library)]
    tree.links.new(layers.outputs["Image"], ours.inputs[0])
    tree.links.new(ours.outputs[0], linked.inputs[0])
    tree.links.new(linked.outputs[0], compat.output_node(tree).inputs[0])
    tree.links.new(ours.outputs[0], blur.inputs[0])
    blur.inputs["Size"].keyframe_insert("default_value", frame=1)
    scene["note"] = "of the artist"
    scene.driver_add("hush.lam").driver.expression = "1 + 0"
    for collection, kind in ((bpy.data.actions, "Walk"), (bpy.data.materials, "Spare"), (bpy.data.worlds, "Night")):
        collection.new(kind)
    bpy.data.images.new("Sketch", 8, 8)
    bpy.data.texts.new("Notes").use_fake_user = True
    other = bpy.data.scenes.new("Other")
    other.render.filepath = str(kit.folder(f"{name}-other") / "frame_####")
    bpy.ops.wm.save_as_mainfile(filepath=str(kit.folder(f"{name}-file") / "shot.blend"))
    if denoised:
        assert bpy.ops.hush.denoise_shot() == {"FINISHED"}
    fingerprint.take()
    return scene, folder


def same(before: fingerprint.Fingerprint, what: str) -> None:
    changed = fingerprint.changes(before, fingerprint.take())
    assert not changed, f"{what}: {changed[:20]}"
    left = [path.name for path in Path(bpy.app.tempdir).glob("hush-*")]
    assert not left, f"{what} leaves {left}"


def run(name: str, **arguments: object) -> str:
    """Runs an operator; what it says where it fails."""
    try:
        getattr(bpy.ops.hush, name)(**arguments)
    except RuntimeError as error:
        return str(error)
    return ""


def test_every_operator_whether_it_can_do_its_work_or_not() -> None:
    names = [name for name in dir(bpy.ops.hush) if not name.startswith("_")]
    assert set(names) > ASKED, names
    tried = set()
    for denoised in (False, True):
        scene, _ = rich_file(f"every-{denoised}", denoised=denoised)
        bpy.ops.hush.prepare_shot()
        for name in sorted(set(names) - ASKED):
            if not getattr(bpy.ops.hush, name).poll() or (name == "whole_shot" and not denoised):
                continue
            before = fingerprint.take()
            said = run(name)
            tried.add(name)
            if name == "preview_frame":
                # Its image is what was asked for, and this takes it away.
                bpy.ops.hush.end_preview()
            same(before, f"{name}, denoised: {denoised} ({said})")
    # All but those that are for a preview that is open.
    assert tried >= {"check_shot", "composite_shot", "denoise_shot", "preview_frame", "whole_shot"}, tried


def test_saved_reopened_and_purged_ten_times() -> None:
    _, folder = rich_file("rounds")
    for number in range(ROUNDS):
        scene = bpy.context.scene
        before = fingerprint.take()
        for name in ("check_shot", "denoise_shot", "composite_shot"):
            said = run(name)
            assert not said or name == "check_shot", said
            same(before, f"round {number}, {name}")
        bpy.ops.wm.save_mainfile()
        bpy.ops.wm.open_mainfile(filepath=bpy.data.filepath)
        if number == 0:
            # Purging is the artist's: what it takes away once is not there any more.
            bpy.ops.outliner.orphans_purge(do_local_ids=True, do_linked_ids=True, do_recursive=True)
            purged = {key for key in fingerprint.take() if "/" in key}
        bpy.ops.outliner.orphans_purge(do_local_ids=True, do_linked_ids=True, do_recursive=True)
        now = {key for key in fingerprint.take() if "/" in key}
        assert now == purged, (now - purged, purged - now)
        scene = bpy.context.scene
        assert sum(len(each.links) for each in bpy.data.node_groups if each.get("hush_form")) == 1 and scene.get("note") == "of the artist"
    assert len(kit.files(folder / "composited")) == 2


def no_folder(*_: object, **__: object) -> str:
    raise OSError(28, "No space left on device")


def gone_folder(*_: object, **__: object) -> str:
    place = kit.folder("gone")
    place.rmdir()
    return str(place)


def failing(owner: object, name: str, value: object) -> Callable[[], str]:
    """Composites with one part of it broken."""

    def broken() -> str:
        real = getattr(owner, name)
        setattr(owner, name, value)
        try:
            return run("composite_shot")
        finally:
            setattr(owner, name, real)

    return broken


def script(text: str) -> Callable[..., list[str]]:
    """A process that does this in place of compositing."""
    return lambda *_, **__: [sys.executable, "-c", text]


def test_compositing_that_fails_at_any_step() -> None:
    scene, folder = rich_file("steps")
    target = folder / "composited"
    before = fingerprint.take()
    steps = {
        "No space left": failing(contents.tempfile, "mkdtemp", no_folder),
        "cannot be saved": failing(contents.tempfile, "mkdtemp", gone_folder),
        "cannot be started": failing(composite, "_command", lambda *_, **__: ["/nowhere/blender"]),
        "exit code 3": failing(composite, "_command", script("import sys; sys.stdin.readline(); sys.exit(3)")),
        "killed": failing(composite, "_command", script("import os; os.kill(os.getpid(), 9)")),
        "before its time": failing(composite, "_command", script("print('{\"event\": 1}', '[]', 'x', sep='\\n')")),
    }
    for words, step in steps.items():
        said = step()
        assert words in said, f"{words!r} is not in {said!r}"
        same(before, words)
        assert not target.exists(), f"{words}: left {list(target.iterdir())}"
    for words, place in {"Nothing can be written": "/proc/x", "is a file": str(folder / "frame_0001.exr" / "x")}.items():
        scene.hush.composite_folder = place
        now = fingerprint.take()
        assert words in run("composite_shot")
        same(now, words)
    scene.hush.composite_folder = ""
    before = fingerprint.take()
    (folder / "denoised" / "frame_0002.exr").rename(folder / "aside.exr")
    assert "not denoised" in run("composite_shot")
    same(before, "a file is missing")
    (folder / "aside.exr").rename(folder / "denoised" / "frame_0002.exr")
    assert run("composite_shot") == ""
    same(before, "after all of it")


def test_jobs_that_are_stopped_or_killed() -> None:
    scene, _ = rich_file("stopped")
    starts = {"composite": lambda: composite.start(scene), "denoise": lambda: denoise.start(scene, overwrite=True)}
    ends = {
        "cancelled": lambda running: running.cancel(),
        "killed": lambda running: os.kill(running._process.pid, signal.SIGKILL),
        "closed": lambda running: running.close(),
    }
    for kind, start in starts.items():
        for how, end in ends.items():
            before = fingerprint.take()
            running = start()
            same_now = fingerprint.changes(before, fingerprint.take())
            assert not same_now, f"{kind} is running: {same_now[:20]}"
            end(running)
            until = time.monotonic() + 60
            while not running.ended:
                assert time.monotonic() < until, f"{kind}, {how}: does not end"
                running.poll()
                time.sleep(0.01)
            same(before, f"{kind}, {how}")

"""Saved, opened, copied, appended, linked, purged: the file keeps working, and shows no denoised frame where Hush does not ask."""

from __future__ import annotations

import os
from pathlib import Path

import bpy
import frames
import kit
import numpy as np

TIME_LIMIT = 400.0
OPEN = """\
import sys, bpy, kit, frames
from pathlib import Path
import numpy as np
blend, out = sys.argv[1:]
bpy.ops.wm.open_mainfile(filepath=blend)
for frame in (1, 2):
    image = frames.render(bpy.context.scene, frame, Path(out))
    np.save(f"{out}/{frame}.npy", image)
"""
# Without the extension there is nothing of it to restore the output format with.
PLAIN = OPEN.replace("import sys, bpy, kit, frames", "import sys, bpy, kit, plain as frames")


def saved(name: str, frame: int = 2) -> tuple[Path, bpy.types.Scene, Path]:
    """A shot and a .blend beside it, saved while the node shows a frame."""
    shot = kit.copy_of_shot(name)
    scene, _ = frames.scene_with_node(shot)
    frames.denoise(scene)
    scene.hush.lam, blend = 1.0, shot / "shot.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(blend), compress=False)
    scene.hush.input_folder = "//"
    frames.assert_same(frames.shown(scene, frame), frames.denoised(shot, frame), "before saving")
    bpy.ops.wm.save_mainfile(compress=False)
    return shot, scene, blend


def opened(blend: Path, *, enabled: bool, python: Path | None = None) -> list[np.ndarray]:
    """Frames 1 and 2 as a fresh Blender renders them."""
    out = kit.folder("opened")
    kit.blender(OPEN if enabled else PLAIN, blend, out, enabled=enabled, python=python)
    return [np.load(out / f"{frame}.npy") for frame in (1, 2)]


def trees() -> list[bpy.types.NodeTree]:
    return [tree for tree in bpy.data.node_groups if "hush_form" in tree]


def test_a_saved_file_shows_no_frame_in_any_blender() -> None:
    """Neither here nor in newer versions, with the extension off; the driver of 4.2's Switch means nothing to 5.2."""
    _, _, blend = saved("without")
    for image in opened(blend, enabled=False):
        frames.assert_incoming(image)
    pythons = Path(os.environ["HUSH_TEST_VENVS"]).glob("bpy-*/bin/python")
    versions = {tuple(map(int, python.parents[1].name.removeprefix("bpy-").split("."))): python for python in pythons}
    assert bpy.app.version in versions, versions
    for version, python in sorted(versions.items()):
        if version > bpy.app.version:
            for image in opened(blend, enabled=False, python=python):
                frames.assert_incoming(image, f"in {version}")


def test_with_the_extension_it_is_off_until_it_is_asked() -> None:
    shot, _, blend = saved("with")
    for image in opened(blend, enabled=True):
        frames.assert_incoming(image)
    bpy.ops.wm.open_mainfile(filepath=str(blend))
    scene = bpy.context.scene
    frames.assert_same(frames.shown(scene, 2), frames.denoised(shot, 2), "asked again")


def test_saving_takes_it_off_and_puts_it_back() -> None:
    shot, scene, _ = saved("back")
    frames.shown(scene, 2)
    (tree,) = trees()
    node = kit.module("nodes.node")
    before = node.suspend()
    assert before and not node.is_on(tree)
    with frames.without_handlers():
        frames.assert_incoming(frames.render(scene, 2, kit.folder("out")), "suspended")
    node.resume(before)
    with frames.without_handlers():
        frames.assert_same(frames.render(scene, 2, kit.folder("out")), frames.denoised(shot, 2), "resumed")


def test_a_file_that_blender_saved_by_itself() -> None:
    """Automatic saves ask no handler: such a file is made harmless when it is opened and when it is rendered."""
    _, scene, blend = saved("auto")
    frames.shown(scene, 2)
    with frames.without_handlers():
        bpy.ops.wm.save_as_mainfile(filepath=str(blend))
    for image in opened(blend, enabled=True):
        frames.assert_incoming(image)
    with frames.without_handlers("load_post"):
        bpy.ops.wm.open_mainfile(filepath=str(blend))
    assert kit.module("nodes.node").is_on(trees()[0]), "the file should have been saved with a frame"
    frames.assert_incoming(frames.render(bpy.context.scene, 2, kit.folder("out")))
    frames.shown(bpy.context.scene, 2)
    with frames.without_handlers():
        bpy.ops.wm.save_as_mainfile(filepath=str(blend))
    bpy.ops.wm.open_mainfile(filepath=str(blend))
    assert not kit.module("nodes.node").is_on(trees()[0]), "opening the file should have taken it off"


def test_moved_with_its_frames() -> None:
    shot, _, blend = saved("before")
    moved = kit.folder("moved") / "elsewhere"
    shot.rename(moved)
    bpy.ops.wm.open_mainfile(filepath=str(moved / blend.name))
    frames.assert_same(frames.shown(bpy.context.scene, 1), frames.denoised(moved, 1), "moved")


def test_saved_without_the_extension_it_comes_back() -> None:
    shot, _, blend = saved("through")
    kit.blender(
        "import sys, bpy\nbpy.ops.wm.open_mainfile(filepath=sys.argv[1])\nbpy.ops.wm.save_mainfile()",
        blend,
        enabled=False,
    )
    bpy.ops.wm.open_mainfile(filepath=str(blend))
    frames.assert_same(frames.shown(bpy.context.scene, 2), frames.denoised(shot, 2), "afterwards")


def test_saved_opened_and_purged_ten_times() -> None:
    shot, scene, blend = saved("purged")

    def blocks() -> list[tuple[str, int]]:
        return [(each.name, each.users) for kind in ("node_groups", "images", "actions") for each in getattr(bpy.data, kind)]

    before = None
    for _ in range(10):
        bpy.ops.wm.open_mainfile(filepath=str(blend))
        bpy.ops.outliner.orphans_purge(do_recursive=True)
        bpy.data.orphans_purge()
        scene = bpy.context.scene
        frames.assert_same(frames.shown(scene, 2), frames.denoised(shot, 2), "purged")
        bpy.data.orphans_purge()
        now = [each for each in blocks() if each[0] not in ("Render Result", "Viewer Node")]
        before = before or now
        assert now == before, (now, before)
        frames.assert_incoming(frames.render(scene, 2, kit.folder("out")), "rendered")
        bpy.ops.wm.save_mainfile()


def test_copies() -> None:
    """A copied node shares the tree; a copied tree is one of its own; copied scenes show their frames."""
    shot, scene, _ = saved("copied")
    (node,) = kit.module("nodes.node").nodes(scene)
    copy = node.id_data.nodes.new("CompositorNodeGroup")
    copy.node_tree = node.node_tree
    assert len(list(kit.module("nodes.node").nodes(scene))) == 2 and len(kit.module("nodes.node").trees(scene)) == 1
    frames.assert_same(frames.shown(scene, 2), frames.denoised(shot, 2), "shared")
    node.node_tree = node.node_tree.copy()
    assert len(kit.module("nodes.node").trees(scene)) == 2
    assert bpy.ops.hush.fix(key="node", scene=scene.name) == {"FINISHED"}
    assert all(kit.module("nodes.inside").is_sound(tree) for tree in kit.module("nodes.node").trees(scene))
    frames.assert_same(frames.shown(scene, 1), frames.denoised(shot, 1), "copied")
    frames.assert_same(frames.shown(scene, 2), frames.denoised(shot, 2), "copied, another frame")
    for kind in ("LINK_COPY", "FULL_COPY"):
        assert bpy.ops.scene.new(type=kind) == {"FINISHED"}
        made = bpy.context.scene
        assert made != scene
        frames.assert_same(frames.shown(made, 2), frames.denoised(shot, 2), kind)
        frames.assert_incoming(frames.render(made, 2, kit.folder("out")), kind)


def test_deleted_it_is_gone_after_saving() -> None:
    _, scene, blend = saved("deleted")
    (node,) = kit.module("nodes.node").nodes(scene)
    node.id_data.nodes.remove(node)
    bpy.ops.wm.save_mainfile()
    bpy.ops.wm.open_mainfile(filepath=str(blend))
    bpy.data.orphans_purge()
    assert trees() == [] and not [image for image in bpy.data.images if image.name.startswith("Temporal")]


def test_appended() -> None:
    shot, _, blend = saved("appended")
    for kind in ("scenes", "node_groups"):
        bpy.ops.wm.read_homefile(use_empty=True)
        with bpy.data.libraries.load(str(blend), link=False) as (there, here):
            setattr(here, kind, [name for name in getattr(there, kind) if kind == "scenes" or name.startswith("Temporal")])
        (tree,) = trees()
        assert kit.module("nodes.inside").is_sound(tree) and not kit.module("nodes.node").is_on(tree), kind
        if kind == "scenes":
            scene = next(scene for scene in bpy.data.scenes if kit.module("nodes.node").trees(scene))
            scene.hush.input_folder = str(shot)
            bpy.context.window.scene = scene
            frames.assert_same(frames.shown(scene, 2), frames.denoised(shot, 2), kind)
            frames.assert_incoming(frames.render(scene, 2, kit.folder("out")), kind)


def test_linked_it_passes_through_and_is_left_alone() -> None:
    shot, _, blend = saved("library")
    bpy.ops.wm.read_homefile(use_empty=True)
    bpy.context.scene.name = "Local"
    with bpy.data.libraries.load(str(blend), link=True) as (there, here):
        here.scenes = there.scenes
    linked = next(scene for scene in bpy.data.scenes if scene.library)
    linked_frame = linked.frame_current
    node = kit.module("nodes.node")
    node.sync(linked)
    (tree,) = node.trees(linked)
    assert not node.is_on(tree) and "is linked from" in node.why_off(tree)
    assert kit.module("status").shot_status(linked).total == 5
    assert kit.module("shot").output_folder(linked) == shot / "denoised"
    assert linked.frame_current == linked_frame
    node.suspend()
    bpy.ops.wm.save_as_mainfile(filepath=str(kit.folder("links") / "links.blend"))
    # A linked node in a compositor of this file.
    bpy.ops.wm.read_homefile(use_empty=True)
    with bpy.data.libraries.load(str(blend), link=True) as (there, here):
        here.node_groups = [name for name in there.node_groups if name.startswith("Temporal")]
    scene = bpy.context.scene
    parent = kit.module("compat").ensure_compositor_tree(scene)
    user = parent.nodes.new("CompositorNodeGroup")
    (user.node_tree,) = trees()
    node.sync(scene)
    assert "is linked from" in node.why_off(user.node_tree)
    assert not any(problem.key == "node" for problem in kit.module("checks.check").problems(scene, fresh=True))


def test_switched_off_it_passes_through() -> None:
    shot, scene, blend = saved("switched")
    scene.hush.input_folder = str(shot)
    for _ in range(3):
        frames.assert_same(frames.shown(scene, 2), frames.denoised(shot, 2), "on")
        kit.disable()
        try:
            import plain

            frames.assert_incoming(plain.render(scene, 2, kit.folder("out")), "off")
            bpy.ops.wm.save_as_mainfile(filepath=str(blend))
        finally:
            kit.enable()
    frames.assert_same(frames.shown(scene, 2), frames.denoised(shot, 2), "on again")


def test_undone() -> None:
    """Undo brings back what the node showed before, which may be old by now."""
    _, scene, _ = saved("undone")
    frames.shown(scene, 2)
    bpy.ops.ed.undo_push(message="shown")
    bpy.context.scene.hush.lam = 3.0
    bpy.ops.ed.undo_push(message="another λ")
    assert bpy.ops.ed.undo() == {"FINISHED"}
    scene = bpy.context.scene
    with frames.without_handlers():
        frames.assert_incoming(frames.render(scene, 2, kit.folder("out")), "undone")

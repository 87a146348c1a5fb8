"""Composite Denoised takes only frames that are current and the scene's own, and says why it refuses the others."""

from __future__ import annotations

import shutil

import bpy
import kit
from composites import (
    HALF,
    combined,
    compat,
    composite,
    contents,
    denoised_scene,
    plain,
    refused,
    rendered_again,
    tree_of,
    untouched,
)

TIME_LIMIT = 600.0


def test_composite_before_denoise_deletes_nothing() -> None:
    """Bug 2: every unassigned action and image was deleted."""
    folder = kit.copy_of_shot("undenoised")
    scene = kit.build_scene("plain", folder)
    tree_of(scene, node=True)
    bpy.data.actions.new("Walk")
    bpy.data.images.new("Sketch", 8, 8)
    refused("press Denoise Shot first")
    refused("press Denoise Shot first", allow_stale=True)
    assert "Walk" in bpy.data.actions and "Sketch" in bpy.data.images
    assert not (folder / "composited").exists()


def test_frames_that_are_not_current_are_refused() -> None:
    """Bug 3: old denoised frames were taken for current."""
    scene, folder = denoised_scene("stale")
    tree_of(scene, node=True)
    scene.hush.window = "0"
    assert bpy.ops.hush.denoise_shot() == {"FINISHED"}
    rendered_again(folder, "frame_0002.exr")
    refused("Frame 2 is out of date", "Press Denoise Shot", "2 of 3 frames composited")
    assert kit.files(folder / "composited") == ["frame_0001.exr", "frame_0003.exr"]
    shutil.copy(kit.shot() / "frame_0002.exr", folder)
    assert bpy.ops.hush.denoise_shot() == {"FINISHED"}
    assert untouched() == {"FINISHED"}
    (folder / "frame_0003.exr").write_bytes((folder / "frame_0003.exr").read_bytes()[:20000])
    refused("rame 3", "2 of 3")
    (folder / "frame_0003.exr").unlink()
    refused("rame 3", "2 of 3")
    shutil.copy(kit.shot() / "frame_0003.exr", folder)
    assert bpy.ops.hush.denoise_shot() == {"FINISHED"}
    (folder / "denoised" / "frame_0001.exr").unlink()
    refused("Frame 1 is not denoised: press Denoise Shot", "2 of 3")
    scene.hush.lam = 8.0
    refused("out of date", "λ")
    scene.hush.lam = 1.0
    scene.frame_end = 4
    refused("Frame 1 is not denoised", "Frame 4 is not rendered: press Render Animation", "2 of 4")


def test_a_frame_that_changes_before_its_turn_is_refused() -> None:
    scene, folder = denoised_scene("changing")
    tree_of(scene, node=True)
    made = contents.make(scene, allow_stale=False)
    assert len(made.work["frames"]) == 3
    real, contents.make = contents.make, lambda *_, **__: made
    try:
        (folder / "denoised" / "frame_0003.exr").unlink()
        refused("Frame 3 is not denoised", "2 of 3")
    finally:
        contents.make = real


def test_stale_frames_where_they_are_allowed() -> None:
    for node in (False, True):
        scene, folder = denoised_scene(f"allowed-{node}")
        tree_of(scene, node=node)
        scene.hush.window = "0"
        assert bpy.ops.hush.denoise_shot() == {"FINISHED"}
        rendered_again(folder, "frame_0002.exr")
        (folder / "denoised" / "frame_0003.exr").unlink()
        running = composite.start(scene, allow_stale=True)
        result, reports = composite.outcome(kit.ended(running))
        assert result == "FINISHED", reports
        told = " ".join(text for level, text in reports if level == "WARNING")
        assert "Frame 2 is out of date" in told and "old denoised image" in told and "Frame 3 is not denoised" in told, reports
        old, noisy = folder / "denoised" / "frame_0002.exr", folder / "frame_0003.exr"
        kit.assert_close(plain(folder / "composited" / "frame_0002.exr"), combined(old), HALF, "frame 2")
        kit.assert_close(plain(folder / "composited" / "frame_0003.exr"), combined(noisy), HALF, "frame 3")
        assert bpy.ops.hush.composite_shot(allow_stale=True) == {"FINISHED"}
        scene.frame_end = 5
        refused("Frames 4-5 are not rendered", "3 of 5", allow_stale=True)


def test_two_scenes_with_one_output_path() -> None:
    """Bug 9: the other scene's smaller frames were pasted."""
    scene, folder = denoised_scene("one-path", frames=2)
    tree_of(scene, node=True)
    other = scene.copy()
    other.name = "Other"
    refused("was rendered by scene Scene", scene="Other")
    other.render.resolution_percentage = 50
    refused("96 × 54", "48 × 27", scene="Other")
    assert not (folder / "composited").exists()
    assert untouched(scene="Scene") == {"FINISHED"}


def test_a_new_scene_that_got_the_old_name() -> None:
    """Without a camera it rendered nothing: the frames are the renamed scene's."""
    scene, folder = denoised_scene("old-name", frames=1)
    tree_of(scene, node=True)
    scene.name = "Shot"
    other = bpy.data.scenes.new("Scene")
    other.view_layers[0].update()  # from Blender 5.2 on a new one has no layer collection until somebody looks
    assert untouched() == {"FINISHED"}
    other.camera = scene.camera
    refused("was rendered by scene Scene", "another name")


def test_a_node_may_show_another_scene() -> None:
    scene, folder = denoised_scene("shown", frames=2)
    other = bpy.data.scenes.new("Comp")
    other.render.resolution_x, other.render.resolution_y, other.render.resolution_percentage = 96, 54, 100
    target = kit.folder("shown-comp")
    other.frame_start, other.frame_end, other.render.filepath = 1, 2, str(target / "comp_####")
    bpy.context.window.scene = other
    assert bpy.ops.hush.add_node() == {"FINISHED"}
    nodes = compat.compositor_tree(other).nodes
    next(each for each in nodes if getattr(each, "node_tree", None)).node_tree.hush.scene = scene
    next(each for each in nodes if each.bl_idname == "CompositorNodeRLayers").scene = scene
    assert untouched() == {"FINISHED"}
    assert kit.files(target / "composited") == ["comp_0001.exr", "comp_0002.exr"]
    for frame in (1, 2):
        made, wanted = target / "composited" / f"comp_{frame:04d}.exr", folder / "denoised" / f"frame_{frame:04d}.exr"
        kit.assert_close(plain(made), combined(wanted), HALF, made.name)
    rendered_again(folder, "frame_0001.exr")
    refused("out of date")


def test_what_is_refused() -> None:
    scene, folder = denoised_scene("refused", frames=1)
    refused("no compositor nodes", "Add Temporal Denoise Node")
    tree_of(scene)
    for taken in (folder, folder / "denoised"):
        scene.hush.composite_folder = str(taken)
        refused("choose another folder")
    scene.hush.composite_folder = "/proc/x"
    refused("Nothing can be written")
    scene.hush.composite_folder = ""
    shutil.rmtree(folder / "denoised")
    refused("press Denoise Shot")
    assert kit.files(folder) == ["frame_0001.exr"]

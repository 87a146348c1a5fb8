"""Composite Denoised writes what the compositor makes of the denoised frames, and only of those that are current."""

from __future__ import annotations

import importlib
import json
import os
import shutil
import signal
import sys
import time
from pathlib import Path
from types import MethodType, SimpleNamespace

import bpy
import fingerprint
import kit
import numpy as np
import OpenEXR

TIME_LIMIT = 900.0
compat, composite, composite_plan, job = (
    importlib.import_module(f"{kit.MODULE}.{name}") for name in ("compat", "composite", "composite_plan", "job")
)
# Composited frames are half float.
HALF = 2e-3


def denoised_scene(name: str, frames: int = 3) -> tuple[bpy.types.Scene, Path]:
    """A scene whose frames are rendered and denoised, and their folder."""
    folder = kit.folder(name)
    for frame in range(1, frames + 1):
        shutil.copy(kit.shot() / f"frame_{frame:04d}.exr", folder)
    scene = kit.build_scene("plain", folder)
    scene.frame_end = frames
    assert bpy.ops.hush.denoise_shot() == {"FINISHED"}
    return scene, folder


def hush_group() -> bpy.types.NodeTree:
    """The group of a node of Hush: passes its input through."""
    group = bpy.data.node_groups.new("Temporal Denoise", "CompositorNodeTree")
    group["hush_form"] = "test"
    for direction in ("INPUT", "OUTPUT"):
        group.interface.new_socket("Image", in_out=direction, socket_type="NodeSocketColor")
    group.links.new(group.nodes.new("NodeGroupInput").outputs[0], group.nodes.new("NodeGroupOutput").inputs[0])
    return group


def tree_of(scene: bpy.types.Scene, *, node: bool = False) -> tuple[bpy.types.NodeTree, bpy.types.Node, bpy.types.NodeSocket]:
    """A compositor tree, its Render Layers node and the socket of the result, connected through a node of Hush if asked."""
    tree = compat.ensure_compositor_tree(scene)
    layers = next(each for each in tree.nodes if each.bl_idname == "CompositorNodeRLayers")
    result = compat.output_node(tree).inputs[0]
    if node:
        ours = tree.nodes.new("CompositorNodeGroup")
        ours.node_tree = hush_group()
        tree.links.new(layers.outputs["Image"], ours.inputs[0])
        tree.links.new(ours.outputs[0], result)
    return tree, layers, result


def combined(path: Path) -> np.ndarray:
    return kit.layer(path, "ViewLayer.Combined", "RGBA")


def plain(path: Path) -> np.ndarray:
    """Pixels of a file with a single image."""
    return np.stack([kit.channels(path)[component] for component in "RGBA"], -1)


def untouched(**arguments: object) -> set[str]:
    """Runs Composite Denoised, and looks that the open file is as it was, also where it is refused."""
    before = fingerprint.take()
    try:
        return bpy.ops.hush.composite_shot(**arguments)
    finally:
        changed = fingerprint.changes(before, fingerprint.take())
        assert not changed, changed
        left = [path.name for path in Path(bpy.app.tempdir).glob("hush-composite-*")]
        assert not left, f"copies are left: {left}"


def refused(*words: str, **arguments: object) -> str:
    """What the error says, with these words in it."""
    try:
        untouched(**arguments)
    except RuntimeError as error:
        assert all(word in str(error) for word in words), error
        return str(error)
    raise AssertionError(f"was not refused, should say {words!r}")


def rendered_again(folder: Path, name: str) -> None:
    """A frame is rendered again, with other light."""
    kit.rewrite(folder / name, lambda channel, pixels: pixels * 2 if ".Combined." in channel else pixels)


def test_the_denoised_frames_reach_the_output() -> None:
    for node in (False, True):
        scene, folder = denoised_scene(f"plain-{node}")
        tree_of(scene, node=node)
        # Rendering one frame with that many samples would take minutes.
        scene.cycles.samples = 200000
        noisy = {path.name: path.read_bytes() for path in folder.glob("*.exr")}
        began = time.monotonic()
        assert untouched() == {"FINISHED"}
        assert time.monotonic() - began < 30, "Cycles rendered"
        assert {path.name: path.read_bytes() for path in folder.glob("*.exr")} == noisy
        assert kit.files(folder / "composited") == sorted(noisy)
        for name in noisy:
            made = plain(folder / "composited" / name)
            kit.assert_close(made, combined(folder / "denoised" / name), HALF, f"{name}, with the node: {node}")
            kit.assert_differs(made, combined(folder / name), 0.005)


def test_the_node_as_it_is_added() -> None:
    scene, folder = denoised_scene("added")
    assert bpy.ops.hush.add_node() == {"FINISHED"}
    assert untouched() == {"FINISHED"}
    for name in kit.files(folder / "composited"):
        kit.assert_close(plain(folder / "composited" / name), combined(folder / "denoised" / name), HALF, name)
    assert len(kit.files(folder / "composited")) == 3


# Opens a file and puts a node of a class of its own between Render Layers and the output.
WITH_OWN_CLASS = """
import sys, bpy
bpy.ops.wm.open_mainfile(filepath=sys.argv[1])

class Node(bpy.types.CompositorNodeCustomGroup):
    bl_idname, bl_label = sys.argv[2], sys.argv[3]

    def init(self, context):
        self.node_tree = bpy.data.node_groups.new(".Inner", "CompositorNodeTree")
        for direction in ("INPUT", "OUTPUT"):
            self.node_tree.interface.new_socket("Image", in_out=direction, socket_type="NodeSocketColor")

bpy.utils.register_class(Node)
scene = bpy.context.scene
tree = scene.compositing_node_group if bpy.app.version >= (5, 0) else scene.node_tree
node, (link,) = tree.nodes.new(sys.argv[2]), tree.links
source, target = link.from_socket, link.to_socket
tree.links.new(source, node.inputs[0])
tree.links.new(node.outputs[0], target)
bpy.ops.wm.save_mainfile()
bpy.utils.unregister_class(Node)
"""


def with_own_class(name: str, idname: str, label: str) -> Path:
    """Opens a file, with denoised frames in the folder that is returned, whose compositor has a node that this Blender does not know."""
    scene, folder = denoised_scene(name)
    tree_of(scene)
    blend = kit.folder(f"{name}-file") / "shot.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(blend))
    kit.blender(WITH_OWN_CLASS, blend, idname, label, enabled=False)
    bpy.ops.wm.open_mainfile(filepath=str(blend))
    return folder


def test_the_node_of_the_first_form_is_replaced_too() -> None:
    folder = with_own_class("first-form", "HushTemporalDenoiseNode", "Temporal Denoise")
    assert untouched() == {"FINISHED"}
    assert len(kit.files(folder / "composited")) == 3
    for name in kit.files(folder / "composited"):
        kit.assert_close(plain(folder / "composited" / name), combined(folder / "denoised" / name), HALF, name)


def test_a_node_that_only_the_other_process_does_not_know_is_refused() -> None:
    folder = with_own_class("stranger", "StrangersNode", "Stranger")
    plan = composite_plan.make(bpy.context.scene, allow_stale=False)
    assert [each.split(" › ")[1] for each in plan.work["undefined"]] == ["Stranger"]
    plan.work["undefined"] = []
    real, composite_plan.make = composite_plan.make, lambda *_, **__: plan
    try:
        refused("Stranger", "add-on")
    finally:
        composite_plan.make = real
    assert not (folder / "composited").exists()


def test_saved_reopened_and_purged_ten_times() -> None:
    """Bug 1: the node lost its links, and all frames were black."""
    scene, folder = denoised_scene("rounds", frames=2)
    tree_of(scene, node=True)
    bpy.data.actions.new("Walk")
    blend = kit.folder("rounds-file") / "shot.blend"
    for number in range(10):
        assert untouched() == {"FINISHED"}
        for name in ("frame_0001.exr", "frame_0002.exr"):
            made = plain(folder / "composited" / name)
            kit.assert_close(made, combined(folder / "denoised" / name), HALF, f"round {number}: {name}")
            (folder / "composited" / name).unlink()
        bpy.ops.wm.save_as_mainfile(filepath=str(blend))
        bpy.ops.wm.open_mainfile(filepath=str(blend))
        bpy.ops.outliner.orphans_purge(do_local_ids=True, do_linked_ids=True, do_recursive=True)
        (ours,) = [each for each in compat.compositor_tree(bpy.context.scene).nodes if getattr(each, "node_tree", None)]
        assert ours.outputs[0].is_linked and ours.inputs[0].is_linked and len(ours.node_tree.links) == 1


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
    refused("Frame 1 is not denoised", "Frame 4 is not rendered", "2 of 4")


def test_a_frame_that_changes_before_its_turn_is_refused() -> None:
    scene, folder = denoised_scene("changing")
    tree_of(scene, node=True)
    plan = composite_plan.make(scene, allow_stale=False)
    assert len(plan.work["frames"]) == 3
    real, composite_plan.make = composite_plan.make, lambda *_, **__: plan
    try:
        (folder / "denoised" / "frame_0003.exr").unlink()
        refused("Frame 3 is not denoised", "2 of 3")
    finally:
        composite_plan.make = real


def test_stale_frames_where_they_are_allowed() -> None:
    for node in (False, True):
        scene, folder = denoised_scene(f"allowed-{node}")
        tree_of(scene, node=node)
        scene.hush.window = "0"
        assert bpy.ops.hush.denoise_shot() == {"FINISHED"}
        rendered_again(folder, "frame_0002.exr")
        (folder / "denoised" / "frame_0003.exr").unlink()
        running = composite.start(scene, allow_stale=True)
        result, reports = composite.outcome(ended(running))
        assert result == "FINISHED", reports
        told = " ".join(text for level, text in reports if level == "WARNING")
        assert "Frame 2 is out of date" in told and "old denoised image" in told and "Frame 3 is not denoised" in told, reports
        old, noisy = folder / "denoised" / "frame_0002.exr", folder / "frame_0003.exr"
        kit.assert_close(plain(folder / "composited" / "frame_0002.exr"), combined(old), HALF, "frame 2")
        kit.assert_close(plain(folder / "composited" / "frame_0003.exr"), combined(noisy), HALF, "frame 3")
        assert bpy.ops.hush.composite_shot(allow_stale=True) == {"FINISHED"}
        scene.frame_end = 5
        refused("Frames 4-5 are not rendered", "3 of 5", allow_stale=True)


def ended(running: object) -> object:
    """The job, at its end."""
    until = time.monotonic() + 60
    while not running.ended:
        assert time.monotonic() < until, "the process does not end"
        running.poll()
        time.sleep(0.01)
    return running


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


def test_names_are_those_of_the_rendered_frames() -> None:
    """Bug 11: rendered 0001.exr, composited render0001.exr."""
    folder = kit.folder("slash") / "render"
    folder.mkdir()
    for frame in (1, 2):
        shutil.copy(kit.shot() / f"frame_{frame:04d}.exr", folder / f"{frame:04d}.exr")
    scene = kit.build_scene("plain")
    scene.render.filepath = f"{folder}/"
    scene.frame_end = 2
    tree_of(scene, node=True)
    assert bpy.ops.hush.denoise_shot() == {"FINISHED"}
    assert untouched() == {"FINISHED"}
    assert kit.files(folder / "composited") == ["0001.exr", "0002.exr"]
    scene.hush.composite_format = "PNG"
    assert untouched() == {"FINISHED"}
    assert kit.files(folder / "composited") == ["0001.exr", "0001.png", "0002.exr", "0002.png"]


def test_other_passes_come_from_the_files() -> None:
    for name, channel in (("Alpha", "ViewLayer.Combined.A"), ("Depth", "ViewLayer.Depth.Z"), ("Position", "ViewLayer.Position.X")):
        scene, folder = denoised_scene(f"pass-{name}", frames=1)
        tree, layers, result = tree_of(scene)
        tree.links.new(layers.outputs[name], result)
        assert bpy.ops.hush.composite_shot() == {"FINISHED"}
        expected = np.minimum(kit.channels(folder / "frame_0001.exr")[channel], 65504)
        made = np.minimum(kit.channels(folder / "composited" / "frame_0001.exr")["R"], 65504)
        assert expected.max() > 0.5
        assert np.allclose(made, expected, rtol=2e-3, atol=2e-3), f"{name}: {made.max()} instead of {expected.max()}"


def test_cryptomatte_gives_the_same_matte_as_rendering() -> None:
    scene = kit.build_scene("plain", kit.folder("matte"))
    folder = Path(scene.render.filepath).parent
    scene.frame_end = 1
    scene.view_layers[0].use_pass_cryptomatte_object = True
    bpy.ops.render.render(animation=True)
    assert bpy.ops.hush.denoise_shot() == {"FINISHED"}
    tree, layers, result = tree_of(scene)
    matte = tree.nodes.new("CompositorNodeCryptomatteV2")
    matte.source, matte.scene = "RENDER", scene
    matte.layer_name = "ViewLayer.CryptoObject"
    matte.matte_id = "Cube"
    tree.links.new(layers.outputs["Image"], matte.inputs["Image"])
    tree.links.new(matte.outputs["Matte"], result)
    assert untouched() == {"FINISHED"}
    assert matte.source == "RENDER"
    made = kit.channels(folder / "composited" / "frame_0001.exr")["R"]
    names = [f"ViewLayer.CryptoObject0{level}.{letter}" for level in (0, 1) for letter in "rgba"]
    levels = kit.channels(folder / "frame_0001.exr")
    values = {name[-3:]: levels[name] for name in names}
    ids = np.concatenate([values[key].ravel() for key in ("0.r", "0.b", "1.r", "1.b")]).view(np.uint32)
    cover = np.concatenate([values[key].ravel() for key in ("0.g", "0.a", "1.g", "1.a")])
    # The cube is what covers some hundred pixels but not most of them.
    sums = {key: cover[ids == key].sum() for key in np.unique(ids) if key}
    assert any(abs(made.sum() - total) < 0.01 * total for total in sums.values()), (made.sum(), sums)
    assert 50 < made.sum() < 0.5 * made.size


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
    result, reports = composite.outcome(ended(running))
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
running = importlib.import_module("{kit.MODULE}.composite").start(bpy.data.scenes["Scene"])
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


def test_folder_and_format() -> None:
    scene, _ = denoised_scene("png", frames=2)
    tree_of(scene, node=True)
    target = kit.folder("png-out")
    scene.hush.composite_folder, scene.hush.composite_format = str(target), "PNG"
    assert untouched() == {"FINISHED"}
    assert kit.files(target) == ["frame_0001.png", "frame_0002.png"]


def file_output(tree: bpy.types.NodeTree, folder: Path, name: str) -> bpy.types.Node:
    """A File Output node that writes an EXR image to folder/name####.exr."""
    node = tree.nodes.new("CompositorNodeOutputFile")
    if hasattr(node, "base_path"):
        node.base_path = str(folder)
        node.format.file_format = "OPEN_EXR"
        node.file_slots[0].path = name
    else:
        node.directory, node.file_name = str(folder), name
        compat.use_multilayer(node.format)
        node.file_output_items.new("RGBA", "Image")
    node.format.color_depth = "32"
    return node


def test_file_output_nodes_write_but_never_over_the_frames() -> None:
    scene, folder = denoised_scene("outputs", frames=2)
    tree, layers, _ = tree_of(scene)
    elsewhere = kit.folder("outputs-elsewhere")
    good, bad = file_output(tree, elsewhere, "extra_"), file_output(tree, folder, "frame_")
    for node in (good, bad):
        tree.links.new(layers.outputs["Image"], node.inputs[0])
    noisy = {path.name: path.read_bytes() for path in folder.glob("*.exr")}
    assert untouched() == {"FINISHED"}
    assert {path.name: path.read_bytes() for path in folder.glob("*.exr")} == noisy, "noisy frames were written over"
    assert kit.files(elsewhere) == ["extra_0001.exr", "extra_0002.exr"]
    planes = kit.channels(elsewhere / "extra_0002.exr")
    red = next(plane for name, plane in planes.items() if name.split(".")[-1] == "R")
    kit.assert_close(red, kit.channels(folder / "denoised" / "frame_0002.exr")["ViewLayer.Combined.R"], HALF)


def test_a_pass_that_the_files_lack_is_told() -> None:
    scene, _ = denoised_scene("lacking", frames=1)
    scene.view_layers[0].use_pass_mist = True
    tree, layers, result = tree_of(scene)
    tree.links.new(layers.outputs["Mist"], result)
    state, reports = composite.outcome(ended(composite.start(scene)))
    assert state == "FINISHED" and any("Mist" in text for _, text in reports), reports
    assert layers.outputs["Mist"].is_linked and result.links[0].from_node == layers


def test_rendering_works_as_before_afterwards() -> None:
    scene, folder = denoised_scene("afterwards", frames=1)
    tree_of(scene)
    assert bpy.ops.hush.composite_shot() == {"FINISHED"}
    wanted = combined(folder / "frame_0001.exr")
    (folder / "frame_0001.exr").unlink()
    bpy.ops.render.render(animation=True)
    kit.assert_close(combined(folder / "frame_0001.exr"), wanted, 1e-4)


def test_views_with_files_of_their_own() -> None:
    folder = kit.folder("stereo")
    for frame, view in ((1, "L"), (1, "R"), (2, "L"), (2, "R")):
        # The right view is another picture.
        shutil.copy(kit.shot() / f"frame_{frame + 2 * (view == 'R'):04d}.exr", folder / f"frame_{frame:04d}_{view}.exr")
    scene = kit.build_scene("plain", folder)
    scene.render.use_multiview = True
    scene.render.image_settings.views_format = "INDIVIDUAL"
    scene.frame_end = 2
    assert bpy.ops.hush.denoise_shot() == {"FINISHED"}
    for node in (False, True):
        tree_of(scene, node=node)
        assert bpy.ops.hush.composite_shot() == {"FINISHED"}
        names = kit.files(folder / "composited")
        assert names == [f"frame_000{frame}_{view}.exr" for frame in (1, 2) for view in "LR"]
        for name in names:
            made = plain(folder / "composited" / name)
            kit.assert_close(made, combined(folder / "denoised" / name), HALF, f"{name}, with the node: {node}")
        shutil.rmtree(folder / "composited")


class Window:
    """Stands in for Blender's window: what the operator would show and report."""

    def __init__(self, scene: bpy.types.Scene) -> None:
        nothing = lambda *_: None
        self.shown: list[str | None] = []
        self.reports: list[tuple[str, str]] = []
        self.window_manager = SimpleNamespace(
            progress_begin=nothing, progress_update=nothing, progress_end=nothing, event_timer_remove=nothing
        )
        self.workspace = SimpleNamespace(status_text_set=self.shown.append)
        self.scene = scene

    def operator(self) -> SimpleNamespace:
        """The operator's own functions on an object that is not Blender's."""
        fake = SimpleNamespace(scene="", allow_stale=False, _timer=object())
        for name in ("_begin", "_show", "_hide", "_finish", "_outcome", "_ended", "modal", "cancel"):
            setattr(fake, name, MethodType(getattr(composite.HUSH_OT_composite_shot, name), fake))
        fake.report = lambda level, text: self.reports.append((*level, text))
        return fake

    def run(self, stop_when: Path | None = None) -> set[str]:
        """The timer until the operator ends; Esc once a file is there."""
        fake, before = self.operator(), fingerprint.take()
        assert fake._begin(self)
        until = time.monotonic() + 60
        while time.monotonic() < until:
            if stop_when is not None and stop_when.exists():
                assert fake.modal(self, SimpleNamespace(type="ESC", value="PRESS")) == {"RUNNING_MODAL"}
                stop_when = None
            result = fake.modal(self, SimpleNamespace(type="TIMER", value="PRESS"))
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
    window = Window(scene)
    result = window.run(stop_when=folder / "composited" / "frame_0002.exr")
    made = kit.files(folder / "composited")
    assert result == {"CANCELLED"} and "stopped" in window.reports[-1][1] and 2 <= len(made) < 60, (result, window.reports, made)
    assert any("Compositing frame" in str(text) for text in window.shown), window.shown
    for name in made:
        kit.assert_close(plain(folder / "composited" / name), combined(folder / "denoised" / name), HALF, name)
    scene.frame_end = 3
    window = Window(scene)
    assert window.run() == {"FINISHED"} and "3 frames composited" in window.reports[-1][1], window.reports


def test_another_file_may_be_opened_or_the_scene_removed_meanwhile() -> None:
    scene, folder = denoised_scene("meanwhile")
    tree_of(scene, node=True)
    running = composite.start(scene)
    scene.name = "Renamed"
    bpy.ops.wm.read_homefile(use_empty=True)
    result, reports = composite.outcome(ended(running))
    assert result == "FINISHED" and len(kit.files(folder / "composited")) == 3, reports
    scene, folder = denoised_scene("closed")
    tree_of(scene, node=True)
    window = Window(scene)
    fake = window.operator()
    assert fake._begin(window)
    fake.cancel(window)
    assert job.current() is None and fake._job._process.poll() is not None
    assert not list(folder.glob("composited/.hush*")) and not list(Path(bpy.app.tempdir).glob("hush-composite-*"))


def test_views_in_one_file() -> None:
    scene = kit.build_scene("plain", kit.folder("stereo-in-one"))
    folder = Path(scene.render.filepath).parent
    scene.render.use_multiview = True
    scene.camera.data.stereo.interocular_distance = 1.0
    scene.render.image_settings.views_format = "MULTIVIEW"
    scene.frame_end = 1
    bpy.ops.render.render(animation=True)
    assert bpy.ops.hush.denoise_shot() == {"FINISHED"}
    tree_of(scene)
    if not compat.READS_VIEWS_OF_ONE_FILE:
        refused("Individual")
        return
    assert bpy.ops.hush.composite_shot() == {"FINISHED"}
    made, wanted = (red_of_views(folder / place / "frame_0001.exr") for place in ("composited", "denoised"))
    kit.assert_differs(wanted["left"], wanted["right"], 0.01)
    for view in ("left", "right"):
        kit.assert_close(made[view], wanted[view], HALF, view)


def red_of_views(path: Path) -> dict[str, np.ndarray]:
    """The image's red channel of each view; of one part with channels for all views, or of a part for each."""
    found = {}
    for part in OpenEXR.File(str(path), separate_channels=True).parts:
        for name, channel in part.channels.items():
            words = name.split(".")
            if words[-1] == "R" and ("Combined" in words or "ViewLayer" not in words):
                view = part.header.get("view") or ("right" if "right" in words else "left")
                found[view] = channel.pixels.astype(np.float32)
    return found

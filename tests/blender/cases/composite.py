"""Composite Denoised writes what the compositor makes of the denoised frames, and leaves the file as it was."""

from __future__ import annotations

import importlib
import shutil
import time
from pathlib import Path
from types import MethodType, SimpleNamespace
from typing import Any

import bpy
import kit
import numpy as np
import OpenEXR

compat = importlib.import_module(f"{kit.MODULE}.compat")
composite = importlib.import_module(f"{kit.MODULE}.composite")
NODE = "HushTemporalDenoiseNode"
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


def tree_of(scene: bpy.types.Scene, *, node: bool = False) -> tuple[bpy.types.NodeTree, bpy.types.Node, bpy.types.NodeSocket]:
    """A compositor tree, its Render Layers node and the socket of the result, connected through a Temporal Denoise node if asked."""
    tree = compat.ensure_compositor_tree(scene)
    layers = next(each for each in tree.nodes if each.bl_idname == "CompositorNodeRLayers")
    result = compat.output_node(tree).inputs[0]
    if node:
        ours = tree.nodes.new(NODE)
        tree.links.new(layers.outputs["Image"], ours.inputs[0])
        tree.links.new(ours.outputs[0], result)
    return tree, layers, result


def state(scene: bpy.types.Scene) -> dict[str, Any]:
    """What Composite Denoised might leave changed."""
    tree = compat.compositor_tree(scene)
    render = scene.render
    simple = {"BOOLEAN", "INT", "FLOAT", "STRING", "ENUM"}

    def values(owner: Any) -> dict[str, str]:  # noqa: ANN401 (any Blender struct)
        return {item.identifier: repr(getattr(owner, item.identifier)) for item in owner.bl_rna.properties if item.type in simple}

    kinds = ("scenes", "node_groups", "images", "actions")
    return {
        "data": {kind: sorted({each.name for each in getattr(bpy.data, kind)} - {"Render Result"}) for kind in kinds},
        "nodes": sorted((each.name, each.mute) for each in tree.nodes),
        "links": sorted((each.from_node.name, each.from_socket.name, each.to_node.name, each.to_socket.name) for each in tree.links),
        "render": values(render),
        "image": values(render.image_settings),
        "hush": values(scene.hush),
        "frames": (scene.frame_start, scene.frame_end, scene.frame_step, scene.frame_current),
        "open": bpy.context.scene.name,
    }


def assert_same(scene: bpy.types.Scene, before: dict[str, Any]) -> None:
    now = state(scene)
    assert now == before, [(key, before[key], now[key]) for key in before if now[key] != before[key]]


def combined(path: Path) -> np.ndarray:
    return kit.layer(path, "ViewLayer.Combined", "RGBA")


def plain(path: Path) -> np.ndarray:
    """Pixels of a file with a single image."""
    return np.stack([kit.channels(path)[component] for component in "RGBA"], -1)


def refused(words: str) -> None:
    try:
        bpy.ops.hush.composite_shot()
    except RuntimeError as error:
        assert words in str(error), error
    else:
        raise AssertionError(f"was not refused, should say {words!r}")


def test_the_denoised_frames_reach_the_output() -> None:
    for node in (False, True):
        scene, folder = denoised_scene(f"plain-{node}")
        tree_of(scene, node=node)
        # Rendering one frame with that many samples would take minutes.
        scene.cycles.samples = 200000
        before = state(scene)
        noisy = {path.name: path.read_bytes() for path in folder.glob("*.exr")}
        began = time.monotonic()
        assert bpy.ops.hush.composite_shot() == {"FINISHED"}
        assert time.monotonic() - began < 30, "Cycles rendered"
        assert_same(scene, before)
        assert {path.name: path.read_bytes() for path in folder.glob("*.exr")} == noisy
        assert kit.files(folder / "composited") == sorted(noisy)
        for name in noisy:
            made = plain(folder / "composited" / name)
            kit.assert_close(made, combined(folder / "denoised" / name), HALF, f"{name}, with the node: {node}")
            kit.assert_differs(made, combined(folder / name), 0.005)


def test_a_frame_that_is_not_denoised_comes_out_noisy() -> None:
    for node in (False, True):
        scene, folder = denoised_scene(f"fallback-{node}")
        (folder / "denoised" / "frame_0002.exr").unlink()
        tree_of(scene, node=node)
        assert bpy.ops.hush.composite_shot() == {"FINISHED"}
        kit.assert_close(plain(folder / "composited" / "frame_0002.exr"), combined(folder / "frame_0002.exr"), HALF, "frame 2")
        third = combined(folder / "denoised" / "frame_0003.exr")
        kit.assert_close(plain(folder / "composited" / "frame_0003.exr"), third, HALF, f"frame 3, node: {node}")


def test_noisy_frames_may_be_gone() -> None:
    scene, folder = denoised_scene("thrown-away")
    (folder / "frame_0002.exr").unlink()
    tree_of(scene, node=True)
    assert bpy.ops.hush.composite_shot() == {"FINISHED"}
    kit.assert_close(plain(folder / "composited" / "frame_0002.exr"), combined(folder / "denoised" / "frame_0002.exr"), HALF)
    (folder / "denoised" / "frame_0002.exr").unlink()
    refused("Frame 2 is neither rendered nor denoised")


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
    before = state(scene)
    assert bpy.ops.hush.composite_shot() == {"FINISHED"}
    assert_same(scene, before)
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


def test_an_exception_leaves_everything_as_it_was() -> None:
    scene, folder = denoised_scene("exception")
    tree_of(scene, node=True)
    before = state(scene)
    real = composite.Stage.composite

    def fails(self: composite.Stage, frame: int) -> str:
        if frame == 2:
            raise KeyError("in the middle")
        return real(self, frame)

    composite.Stage.composite = fails
    try:
        refused("in the middle")
    finally:
        composite.Stage.composite = real
    assert_same(scene, before)
    assert kit.files(folder / "composited") == ["frame_0001.exr"]
    (folder / "composited" / "frame_0002.exr").mkdir()
    refused("Frame 2")
    assert_same(scene, before)
    (folder / "composited" / "frame_0002.exr").rmdir()
    assert bpy.ops.hush.composite_shot() == {"FINISHED"}


def test_what_is_refused() -> None:
    scene, folder = denoised_scene("refused", frames=1)
    refused("no compositor nodes")
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
    assert bpy.ops.hush.composite_shot() == {"FINISHED"}
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
    before = state(scene)
    assert bpy.ops.hush.composite_shot() == {"FINISHED"}
    assert_same(scene, before)
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
    with composite.Stage(scene) as stage:
        assert any("Mist" in text for text in stage.warnings), stage.warnings
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


def in_a_window(scene: bpy.types.Scene, stop_after: int | None = None) -> tuple[set[str], list[tuple[str, str]]]:
    """What the operator does at the ticks of a window's timer, with Esc after some of them; result and reports."""
    kind, nothing, reports = composite.HUSH_OT_composite_shot, lambda *_: None, []
    manager = SimpleNamespace(progress_begin=nothing, progress_update=nothing, progress_end=nothing, event_timer_remove=nothing)
    window = SimpleNamespace(window_manager=manager, workspace=SimpleNamespace(status_text_set=nothing), scene=scene)
    fake = SimpleNamespace(scene="", _timer=object(), report=lambda level, text: reports.append((*level, text)))
    for name in ("_begin", "_some", "_count", "_hide", "_finish", "modal"):
        setattr(fake, name, MethodType(getattr(kind, name), fake))
    fake._begin(window)
    fake.scene = scene.name
    before = state(scene)
    for tick in range(100):
        key = "ESC" if tick == stop_after else "TIMER"
        result = fake.modal(window, SimpleNamespace(type=key, value="PRESS"))
        assert_same(scene, before)
        if result != {"RUNNING_MODAL"}:
            return result, reports
    raise AssertionError("the operator does not end")


def test_in_a_window_the_scene_is_itself_between_ticks() -> None:
    scene, folder = denoised_scene("window")
    tree_of(scene, node=True)
    composite._AT_A_TIME, before = 0.0, composite._AT_A_TIME
    try:
        result, reports = in_a_window(scene, stop_after=2)
        assert result == {"CANCELLED"} and "2 of 3" in reports[-1][1], (result, reports)
        assert len(kit.files(folder / "composited")) == 2
        result, reports = in_a_window(scene)
    finally:
        composite._AT_A_TIME = before
    assert result == {"FINISHED"} and "3 frames composited" in reports[-1][1], (result, reports)
    assert len(kit.files(folder / "composited")) == 3


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
        refused("Views Format Individual")
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

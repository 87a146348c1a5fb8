"""Composite Denoised writes what the compositor makes of the denoised frames, and leaves the open file as it was."""

from __future__ import annotations

import shutil
import time
from pathlib import Path

import bpy
import kit
import numpy as np
import OpenEXR
from composites import (
    HALF,
    combined,
    compat,
    composite,
    contents,
    denoised_scene,
    plain,
    refused,
    tree_of,
    untouched,
)

TIME_LIMIT = 600.0


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
    link = elsewhere.with_name("outputs-link")
    link.symlink_to(folder)
    good, bad, through = file_output(tree, elsewhere, "extra_"), file_output(tree, folder, "frame_"), file_output(tree, link, "frame_")
    for node in (good, bad, through):
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
    state, reports = composite.outcome(kit.ended(composite.start(scene)))
    assert state == "FINISHED" and any("Mist" in text for _, text in reports), reports
    assert layers.outputs["Mist"].is_linked and result.links[0].from_node == layers


def test_images_that_are_not_saved_are_refused() -> None:
    """Their pixels are in no file, and so not in the copy that is composited."""
    scene, folder = denoised_scene("painted", frames=1)
    tree, layers, result = tree_of(scene)
    mask = bpy.data.images.new("Mask", 96, 54, float_buffer=True)
    mask.pixels = [0.5, 0.25, 0.125, 1.0] * (96 * 54)
    shown = tree.nodes.new("CompositorNodeImage")
    shown.image = mask
    over = tree.nodes.new("CompositorNodeAlphaOver")
    images = [socket for socket in over.inputs if socket.type == "RGBA"]
    tree.links.new(layers.outputs["Image"], images[0])
    tree.links.new(shown.outputs["Image"], images[1])
    tree.links.new(over.outputs["Image"], result)
    refused("Mask", "not saved")
    assert not (folder / "composited").exists()
    shown.mute = True
    tree.links.new(layers.outputs["Image"], result)
    assert untouched() == {"FINISHED"}
    shown.mute = False
    tree.links.new(over.outputs["Image"], result)
    mask.pack()
    assert untouched() == {"FINISHED"}
    made = plain(folder / "composited" / "frame_0001.exr")
    kit.assert_close(made[..., :3], np.broadcast_to(np.float32([0.5, 0.25, 0.125]), (54, 96, 3)), HALF, "the packed mask")


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


def test_file_output_nodes_with_templates() -> None:
    """`{blend_dir}` is the folder of the artist's file, not of its copy; what is filled in does not get around the guard."""
    if bpy.app.version < (5, 0):
        return
    scene, folder = denoised_scene("templates", frames=1)
    blend = kit.folder("templates-file") / "shot.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(blend))
    tree, layers, _ = tree_of(scene)
    good, bad = file_output(tree, Path("{blend_dir}/extra_{node_name}"), "{scene_name}_"), file_output(tree, folder, "frame_")
    scene.name = folder.name
    bad.directory = str(folder.parent / "{scene_name}")
    for node in (good, bad):
        tree.links.new(layers.outputs["Image"], node.inputs[0])
    noisy = (folder / "frame_0001.exr").read_bytes()
    state, reports = composite.outcome(kit.ended(composite.start(scene)))
    assert state == "FINISHED" and any(bad.name in text and "replace" in text for _, text in reports), reports
    assert (folder / "frame_0001.exr").read_bytes() == noisy, "the noisy frame was written over"
    assert kit.files(blend.parent) == [f"extra_{good.name}/{scene.name}_0001.exr", "shot.blend"]


def test_a_folder_beside_a_file_that_is_not_saved() -> None:
    scene, _ = denoised_scene("unsaved", frames=1)
    tree_of(scene)
    scene.hush.composite_folder = "//composited"
    refused("not saved yet")


def test_what_is_left_in_the_folder_of_the_copy_is_no_trouble() -> None:
    place = kit.folder("copy")
    (place / "inner").mkdir()
    (place / "inner" / "file").write_text("x")
    (place / "shot.blend").write_text("x")
    contents.remove_copy(place / "shot.blend")
    assert not place.exists()


def test_files_in_another_colour_space() -> None:
    """Output › Color Management: the frames are read in the space they were written in, and the composite is written in it again."""
    scene, folder = denoised_scene("space", frames=1)
    tree_of(scene, node=True)
    settings = scene.render.image_settings
    settings.color_management, settings.linear_colorspace_settings.name = "OVERRIDE", "ACEScg"
    assert untouched() == {"FINISHED"}
    name = "frame_0001.exr"
    kit.assert_close(plain(folder / "composited" / name)[..., :3], combined(folder / "denoised" / name)[..., :3], HALF, name)

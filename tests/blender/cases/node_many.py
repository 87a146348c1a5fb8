"""Several nodes, scenes, groups and views: each shows its own frames, and nothing is left behind."""

from __future__ import annotations

import shutil
from pathlib import Path

import bpy
import frames
import kit
import numpy as np


def inside() -> list[bpy.types.NodeTree]:
    return [tree for tree in bpy.data.node_groups if tree.name.startswith(".Hush")]


def output(scene: bpy.types.Scene) -> bpy.types.NodeSocket:
    compat = frames.module("compat")
    return compat.output_node(compat.compositor_tree(scene)).inputs[0]


def test_deleting_a_node_takes_its_insides_along() -> None:
    shot = kit.copy_of_shot("delete")
    frames.make_denoised(shot, [1, 2])
    _, node = frames.scene_with_node(shot)
    assert len(inside()) == 1 and len(bpy.data.actions) == 1 + 2, (inside(), list(bpy.data.actions))
    node.id_data.nodes.remove(node)
    assert inside() == []
    assert len(bpy.data.actions) == 2


def test_each_node_has_insides_of_its_own() -> None:
    shot = kit.copy_of_shot("several")
    frames.make_denoised(shot, [1, 2])
    scene, first = frames.scene_with_node(shot)
    second = first.id_data.nodes.new(first.bl_idname)
    assert first.node_tree != second.node_tree
    frames.module("node").sync(scene)
    first.id_data.links.new(second.outputs[0], output(scene))
    kit.assert_close(frames.composite(scene, 2, kit.folder("out")), frames.picture(2), 1e-5)
    assert len({node.node_tree.animation_data.action for node in (first, second)}) == 2


def test_a_copied_tree_has_insides_of_its_own() -> None:
    shot = kit.copy_of_shot("copied")
    frames.make_denoised(shot, [1, 2])
    scene, first = frames.scene_with_node(shot)
    copy = scene.copy()
    if frames.BLENDER_5:
        copy.compositing_node_group = scene.compositing_node_group.copy()
    frames.module("node").sync(copy)
    (second,) = frames.module("node").nodes(copy)
    assert second != first and second.node_tree != first.node_tree
    assert second.node_tree.animation_data.action != first.node_tree.animation_data.action
    first.id_data.nodes.remove(first)
    kit.assert_close(frames.composite(copy, 2, kit.folder("out")), frames.picture(2), 1e-5)


def test_scenes_show_their_own_frames() -> None:
    shots = [kit.copy_of_shot("left"), kit.copy_of_shot("right")]
    for base, shot in zip((10.0, 50.0), shots, strict=True):
        frames.make_denoised(shot, [1, 2], base)
    one, _ = frames.scene_with_node(shots[0])
    two = one.copy()
    if frames.BLENDER_5:
        two.compositing_node_group = one.compositing_node_group.copy()
    two.hush.input_folder = str(shots[1])
    for scene, base in ((one, 10.0), (two, 50.0), (one, 10.0)):
        kit.assert_close(frames.composite(scene, 2, kit.folder("out")), frames.picture(2, base), 1e-5, scene.name)


def test_scenes_that_share_their_nodes() -> None:
    """One compositor tree, or one group in two trees: the scene that is rendered decides."""
    shots = [kit.copy_of_shot("shared-left"), kit.copy_of_shot("shared-right")]
    for base, shot in zip((10.0, 50.0), shots, strict=True):
        frames.make_denoised(shot, [1, 2], base)
    one, node = frames.scene_with_node(shots[0])
    compat = frames.module("compat")
    group = bpy.data.node_groups.new("Shared", "CompositorNodeTree")
    group.interface.new_socket("Image", in_out="INPUT", socket_type="NodeSocketColor")
    group.interface.new_socket("Image", in_out="OUTPUT", socket_type="NodeSocketColor")
    inner = group.nodes.new(node.bl_idname)
    group.links.new(group.nodes.new("NodeGroupInput").outputs[0], inner.inputs[0])
    group.links.new(inner.outputs[0], group.nodes.new("NodeGroupOutput").inputs[0])
    tree = compat.compositor_tree(one)
    user = tree.nodes.new("CompositorNodeGroup")
    user.node_tree = group
    source = node.inputs[0].links[0].from_socket
    tree.nodes.remove(node)
    tree.links.new(source, user.inputs[0])
    tree.links.new(user.outputs[0], output(one))
    two = one.copy()
    two.hush.input_folder = str(shots[1])
    for scene, base in ((one, 10.0), (two, 50.0), (one, 10.0)):
        kit.assert_close(frames.composite(scene, 2, kit.folder("out")), frames.picture(2, base), 1e-5, scene.name)


def test_a_scene_for_compositing_only() -> None:
    shot = kit.copy_of_shot("elsewhere")
    frames.make_denoised(shot, [1, 2])
    rendered, node = frames.scene_with_node(shot)
    comp = bpy.data.scenes.new("Comp")
    comp.render.resolution_x, comp.render.resolution_y = 96, 54
    tree = frames.module("compat").ensure_compositor_tree(comp)
    shown = tree.nodes.new(node.bl_idname)
    shown.source_scene = rendered
    tree.links.new(shown.outputs[0], output(comp))
    comp.camera = rendered.camera
    kit.assert_close(frames.composite(comp, 2, kit.folder("out")), frames.picture(2), 1e-5)


def test_view_layers() -> None:
    """The node shows the view layer it is told to; the motion vectors' one is not among them."""
    shot = kit.copy_of_shot("layers", "blur")
    frames.make_denoised(shot, [1])

    def change(name: str, pixels: np.ndarray) -> np.ndarray:
        return np.full_like(pixels, 99.0) if name.startswith("Vectors.Combined.") else pixels

    kit.rewrite(shot / "denoised" / "frame_0001.exr", change)
    scene = kit.build_scene("blur")
    scene.hush.input_folder = str(shot)
    bpy.ops.hush.add_node()
    (node,) = frames.module("node").nodes(scene)
    node.view_layer = scene.view_layers[0].name
    kit.assert_close(frames.composite(scene, 1, kit.folder("out")), frames.picture(1), 1e-5)
    node.view_layer = "Vectors"
    assert np.allclose(frames.composite(scene, 1, kit.folder("out")), 99.0)
    node.view_layer = "No Such Layer"
    image = frames.composite(scene, 1, kit.folder("out"))
    assert 0.01 < image.max() < 9, "a view layer that the files lack should pass the image through"


def stereo(name: str, views_format: str) -> tuple[bpy.types.Scene, Path]:
    """A stereo shot of one frame. The denoised files have the rendered ones' pixels plus 20."""
    shot = kit.folder(name)
    scene = kit.build_scene(render_to=shot)
    scene.camera.data.stereo.interocular_distance = 2.0
    scene.render.use_multiview = True
    scene.render.image_settings.views_format = views_format
    scene.frame_end = 1
    bpy.ops.render.render(animation=True)
    (shot / "denoised").mkdir()
    for file in shot.glob("*.exr"):
        shutil.copy(file, shot / "denoised")
        kit.rewrite(shot / "denoised" / file.name, lambda name, p: p + 20 if ".Combined" in name and not name.endswith("A") else p)
    scene.hush.input_folder = str(shot)
    bpy.ops.hush.add_node()
    return scene, shot


def check_stereo(scene: bpy.types.Scene) -> None:
    """Each view of the composite is that view's rendered image plus 20."""
    (node,) = frames.module("node").nodes(scene)
    tree = node.id_data
    out = kit.folder("shown")
    frames.composite(scene, 1, out, view="_L")
    target = output(scene)
    source = target.links[0].from_socket
    tree.links.new(node.inputs[0].links[0].from_socket, target)
    plain = kit.folder("plain")
    frames.composite(scene, 1, plain, view="_L")
    tree.links.new(source, target)
    images = {}
    for view in "LR":
        shown, rendered = (kit.channels(folder / f"result_1_{view}.exr")["R"] for folder in (out, plain))
        kit.assert_close(shown, rendered + 20, 1e-3, view)
        images[view] = rendered
    kit.assert_differs(images["L"], images["R"], 0.005, "the views")


def test_stereo_views_in_files_of_their_own() -> None:
    scene, shot = stereo("individual", "INDIVIDUAL")
    assert sorted(path.name for path in (shot / "denoised").iterdir()) == ["frame_0001_L.exr", "frame_0001_R.exr"]
    check_stereo(scene)


def test_stereo_views_in_one_file() -> None:
    scene, shot = stereo("one-file", "MULTIVIEW")
    assert [path.name for path in (shot / "denoised").iterdir()] == ["frame_0001.exr"]
    check_stereo(scene)

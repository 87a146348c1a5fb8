"""Several nodes, scenes, groups, view layers and views."""

from __future__ import annotations

from pathlib import Path

import bpy
import frames
import kit
import numpy as np


def output(scene: bpy.types.Scene) -> bpy.types.NodeSocket:
    compat = kit.module("compat")
    return compat.output_node(compat.compositor_tree(scene)).inputs[0]


def two_shots(name: str) -> tuple[list[Path], bpy.types.Scene, bpy.types.Node]:
    """Two shots that differ, the first one's scene with its node."""
    shots = [kit.copy_of_shot(f"{name}-one"), kit.copy_of_shot(f"{name}-two")]
    for file in shots[1].glob("*.exr"):
        kit.rewrite(file, lambda name, pixels: pixels * np.float32(2) if ".Combined." in name and name[-1] in "RGB" else pixels)
    scene, node = frames.scene_with_node(shots[0])
    frames.denoise(scene)
    return shots, scene, node


def copied(scene: bpy.types.Scene, shot: Path) -> bpy.types.Scene:
    made = scene.copy()
    made.hush.input_folder = str(shot)
    frames.denoise(made)
    return made


def test_each_node_has_a_tree_and_an_image_of_its_own() -> None:
    shot = kit.copy_of_shot("several")
    scene, first = frames.scene_with_node(shot)
    second = kit.module("nodes.node").new(first.id_data)
    frames.put_in(scene, second)
    images = [node.node_tree.nodes["Denoised Frame"].image for node in (first, second)]
    assert first.node_tree != second.node_tree and images[0] != images[1]
    frames.denoise(scene)
    first.id_data.links.new(second.outputs[0], output(scene))
    frames.assert_same(frames.shown(scene, 2), frames.denoised(shot, 2), "the second node")


def test_scenes_with_their_own_nodes() -> None:
    shots, one, node = two_shots("own")
    two = copied(one, shots[1])
    if frames.BLENDER_5:
        two.compositing_node_group = one.compositing_node_group.copy()
    (copy,) = kit.module("nodes.node").nodes(two)
    copy.node_tree = node.node_tree.copy()
    # The image is shared at first, and one image cannot show two frames.
    frames.assert_incoming(frames.shown(two, 2), "copied")
    (problem,) = (each for each in kit.module("checks.check").problems(two, fresh=True) if each.key == "node")
    assert bpy.ops.hush.fix(**problem.fix[1]) == {"FINISHED"}
    for scene, shot in ((one, shots[0]), (two, shots[1]), (one, shots[0])):
        frames.assert_same(frames.shown(scene, 2), frames.denoised(shot, 2), scene.name)


def test_scenes_that_share_a_node() -> None:
    """The same frames: shown in both. Other frames: passed through, until the node is told whose."""
    shots, one, node = two_shots("shared")
    module, tree = kit.module("nodes.node"), node.node_tree
    two = copied(one, shots[0])
    for scene in (one, two):
        frames.assert_same(frames.shown(scene, 2), frames.denoised(shots[0], 2), scene.name)
    two.hush.input_folder = str(shots[1])
    frames.denoise(two)
    for scene in (one, two):
        frames.assert_incoming(frames.shown(scene, 2), scene.name)
        assert one.name in module.why_off(tree) and two.name in module.why_off(tree), module.why_off(tree)
    tree.hush.scene = two
    for scene in (one, two):
        frames.assert_same(frames.shown(scene, 2), frames.denoised(shots[1], 2), scene.name)
    # Both in windows, at other frames: the first one counts.
    tree.hush.scene = one
    one.frame_set(2)
    two.frame_set(3)
    module.sync(one, two)
    assert kit.module("nodes.inside").shown_frame(tree) == 2


def test_a_node_inside_a_group() -> None:
    shot = kit.copy_of_shot("grouped")
    scene, node = frames.scene_with_node(shot)
    group = bpy.data.node_groups.new("Shared", "CompositorNodeTree")
    for direction in ("INPUT", "OUTPUT"):
        group.interface.new_socket("Image", in_out=direction, socket_type="NodeSocketColor")
    inner = group.nodes.new("CompositorNodeGroup")
    inner.node_tree = node.node_tree
    group.links.new(group.nodes.new("NodeGroupInput").outputs[0], inner.inputs[0])
    group.links.new(inner.outputs[0], group.nodes.new("NodeGroupOutput").inputs[0])
    node.node_tree = group
    assert list(kit.module("nodes.node").nodes(scene)) == [inner]
    frames.denoise(scene)
    frames.assert_same(frames.shown(scene, 2), frames.denoised(shot, 2), "in a group")
    frames.assert_incoming(frames.render(scene, 2, kit.folder("out")), "in a group, rendered")


def test_a_scene_for_compositing_only() -> None:
    shot = kit.copy_of_shot("elsewhere")
    rendered, node = frames.scene_with_node(shot)
    frames.denoise(rendered)
    comp = bpy.data.scenes.new("Comp")
    comp.render.resolution_x, comp.render.resolution_y = 96, 54
    tree = kit.module("compat").ensure_compositor_tree(comp)
    shown = kit.module("nodes.node").new(tree)
    shown.node_tree.hush.scene = rendered
    frames.put_in(comp, shown)
    tree.links.new(shown.outputs[0], output(comp))
    comp.camera = rendered.camera
    frames.assert_same(frames.shown(comp, 2), frames.denoised(shot, 2), "Comp")


def test_view_layers() -> None:
    """The node shows the view layer it is told to; the motion vectors' one is not among them."""
    shot = kit.copy_of_shot("layers", "blur")
    scene, node = frames.scene_with_node(shot, "blur")
    frames.denoise(scene)
    tree = node.node_tree
    for name in (scene.view_layers[0].name, "Vectors"):
        tree.hush.view_layer = name
        frames.assert_same(frames.shown(scene, 2), frames.denoised(shot, 2, name), name)
    kit.assert_differs(frames.denoised(shot, 2, "Vectors"), frames.denoised(shot, 2, scene.view_layers[0].name), 1e-4)
    tree.hush.view_layer = "No Such Layer"
    frames.assert_incoming(frames.shown(scene, 2), "a view layer that the files lack")
    assert "No Such Layer" in kit.module("nodes.node").why_off(tree)


def test_stereo_passes_through() -> None:
    shot = kit.copy_of_shot("stereo")
    scene, node = frames.scene_with_node(shot)
    frames.denoise(scene)
    frames.assert_same(frames.shown(scene, 2), frames.denoised(shot, 2), "without stereo")
    scene.render.use_multiview = True
    kit.module("nodes.node").sync(scene)
    assert not kit.module("nodes.node").is_on(node.node_tree)
    assert "Composite Denoised" in kit.module("nodes.node").why_off(node.node_tree)


def test_the_node_goes_between_what_was_linked() -> None:
    """Everything that took the rendered image takes the node's; a second time there is nothing to do."""
    scene = kit.build_scene()
    tree = kit.module("compat").ensure_compositor_tree(scene)
    viewer = tree.nodes.new("CompositorNodeViewer")
    (layers,) = (node for node in tree.nodes if node.bl_idname == "CompositorNodeRLayers")
    tree.links.new(layers.outputs["Image"], viewer.inputs[0])
    before = {link.to_node for link in layers.outputs["Image"].links}
    assert bpy.ops.hush.add_node() == {"FINISHED"}
    (node,) = kit.module("nodes.node").nodes(scene)
    assert viewer in before and node.inputs[0].links[0].from_socket == layers.outputs["Image"]
    assert {link.to_node for link in node.outputs[0].links} == before
    assert {link.to_node for link in layers.outputs["Image"].links} == {node}
    assert bpy.ops.hush.add_node() == {"CANCELLED"}


def test_a_compositor_that_is_switched_off_stays_off() -> None:
    """Before Blender 5, which has no Use Nodes."""
    scene = kit.build_scene()
    assert bpy.ops.hush.add_node() == {"FINISHED"}
    if bpy.app.version >= (5, 0):
        return
    before = len(scene.node_tree.nodes)
    scene.use_nodes = False
    kit.refused(bpy.ops.hush.add_node, "Use Nodes")
    assert not scene.use_nodes and len(scene.node_tree.nodes) == before
    scene.use_nodes = True
    assert bpy.ops.hush.add_node() == {"CANCELLED"} and len(scene.node_tree.nodes) == before


def straight(scene: bpy.types.Scene) -> bpy.types.NodeTree:
    """The scene's compositor with Render Layers straight to the output: of itself Blender 4.5 has a reroute and a viewer besides."""
    compat = kit.module("compat")
    tree = compat.ensure_compositor_tree(scene)
    tree.nodes.clear()
    layers = tree.nodes.new("CompositorNodeRLayers")
    layers.scene = scene
    tree.links.new(layers.outputs["Image"], compat.output_node(tree).inputs[0])
    return tree


def test_a_scene_that_composites_another_keeps_its_links() -> None:
    """The node goes behind the other scene's Render Layers and shows that scene."""
    rendered = kit.build_scene()
    comp = bpy.data.scenes.new("Comp")
    tree = straight(comp)
    (layers,) = (each for each in tree.nodes if each.bl_idname == "CompositorNodeRLayers")
    layers.scene = rendered
    blur = tree.nodes.new("CompositorNodeBlur")
    tree.links.new(layers.outputs["Image"], blur.inputs[0])
    tree.links.new(blur.outputs[0], output(comp))
    with bpy.context.temp_override(scene=comp):
        assert bpy.ops.hush.add_node() == {"FINISHED"}
    (node,) = kit.module("nodes.node").nodes(comp)
    assert output(comp).links[0].from_node == blur, "the composite is cut off"
    assert node.inputs[0].links[0].from_node == layers and [link.to_node for link in node.outputs[0].links] == [blur]
    assert node.node_tree.hush.scene == rendered


def test_without_render_layers_no_link_is_replaced() -> None:
    scene = kit.build_scene()
    tree = kit.module("compat").ensure_compositor_tree(scene)
    for each in [each for each in tree.nodes if each.bl_idname == "CompositorNodeRLayers"]:
        tree.nodes.remove(each)
    shown = tree.nodes.new("CompositorNodeImage")
    shown.image = bpy.data.images.new("Plate", 8, 8)
    tree.links.new(shown.outputs["Image"], output(scene))
    assert bpy.ops.hush.add_node() == {"FINISHED"}
    assert output(scene).links[0].from_node == shown
    (node,) = kit.module("nodes.node").nodes(scene)
    assert not node.outputs[0].is_linked and not node.inputs[0].is_linked


def test_muted_links_stay_muted() -> None:
    scene = kit.build_scene()
    tree = straight(scene)
    output(scene).links[0].is_muted = True
    assert bpy.ops.hush.add_node() == {"FINISHED"}
    (node,) = kit.module("nodes.node").nodes(scene)
    assert node.outputs[0].links[0].is_muted and not node.inputs[0].links[0].is_muted and node.id_data == tree


def test_a_library_override_is_left_alone() -> None:
    """Nodes that are added to one are gone when the file is opened again."""
    if not frames.BLENDER_5:
        return
    library = kit.folder("override") / "library.blend"
    tree = bpy.data.node_groups.new("Comp", "CompositorNodeTree")
    bpy.data.libraries.write(str(library), {tree})
    scene = kit.build_scene()
    with bpy.data.libraries.load(str(library), link=True) as (_, into):
        into.node_groups = ["Comp"]
    override = into.node_groups[0].override_create()
    if override is None:
        # Blender 5.3 makes none of node groups.
        return
    scene.compositing_node_group = override
    kit.refused(bpy.ops.hush.add_node, "linked from another file")
    assert not scene.compositing_node_group.nodes

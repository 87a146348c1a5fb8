"""Compositors of several view layers: each denoised, one that is off, light passes beside the node, and what is denoised once more."""

from __future__ import annotations

from pathlib import Path

import bpy
import composites
import kit
import numpy as np

TIME_LIMIT = 600.0
check, compat, flow, node = (kit.module(name) for name in ("checks.check", "compat", "nodes.flow", "nodes.node"))


def two_layers(name: str, *, render: bool = True) -> tuple[bpy.types.Scene, Path, list[bpy.types.Node]]:
    """A scene of one frame whose view layers Back and Front are put over each other, its folder, and the Render Layers of both."""
    folder = kit.folder(name)
    scene = kit.build_scene("plain", folder)
    scene.render.resolution_x, scene.render.resolution_y, scene.frame_end = 48, 27, 1
    scene.render.film_transparent = True
    back = scene.view_layers[0]
    back.name = "Back"
    front = scene.view_layers.new("Front")
    for layer in (back, front):
        layer.cycles.denoising_store_passes = layer.use_pass_vector = layer.use_pass_z = True
        layer.use_pass_diffuse_direct = layer.use_pass_diffuse_indirect = layer.use_pass_diffuse_color = True
    if render:
        bpy.ops.render.render(animation=True)
    tree, first, result = composites.tree_of(scene)
    first.layer = "Back"
    second = tree.nodes.new("CompositorNodeRLayers")
    second.layer = "Front"
    over = tree.nodes.new("CompositorNodeAlphaOver")
    below, above = [socket for socket in over.inputs if socket.type == "RGBA"]
    tree.links.new(first.outputs["Image"], below)
    tree.links.new(second.outputs["Image"], above)
    tree.links.new(over.outputs[0], result)
    return scene, folder, [first, second]


def warnings(scene: bpy.types.Scene) -> list[str]:
    """What Composite Denoised warns of."""
    running = kit.ended(composites.composite.start(scene))
    result, reports = composites.composite.outcome(running)
    assert result == "FINISHED", reports
    return [text for level, text in reports if level == "WARNING"]


def combined(folder: Path, layer: str) -> np.ndarray:
    return kit.layer(folder / "frame_0001.exr", f"{layer}.Combined", "RGBA")


def over(below: np.ndarray, above: np.ndarray) -> np.ndarray:
    return above + below * (1 - above[..., 3:])


def test_each_render_layers_gets_a_node() -> None:
    """One alone left the other view layer noisy, and nobody said so."""
    scene, folder, layers = two_layers("each")
    assert bpy.ops.hush.add_node() == {"FINISHED"}
    assert {each.node_tree.hush.view_layer for each in node.nodes(scene)} == {"Back", "Front"}
    assert all(link.to_node in list(node.nodes(scene)) for each in layers for link in each.outputs["Image"].links)
    assert bpy.ops.hush.add_node() == {"CANCELLED"} and len(list(node.nodes(scene))) == 2
    assert bpy.ops.hush.denoise_shot() == {"FINISHED"}
    assert warnings(scene) == []
    made = composites.plain(folder / "composited" / "frame_0001.exr")
    kit.assert_close(made, over(*(combined(folder / "denoised", name) for name in ("Back", "Front"))), 4e-3)


def test_a_view_layer_that_goes_past_the_node_is_told() -> None:
    scene, _, (first, _) = two_layers("past")
    tree = first.id_data
    assert flow.past_layers(scene) == [], "without a node all is composited denoised"
    alone = node.new(tree)
    taker = first.outputs["Image"].links[0].to_socket
    tree.links.new(first.outputs["Image"], alone.inputs[0])
    tree.links.new(alone.outputs[0], taker)
    alone.node_tree.hush.view_layer = "Back"
    (told,) = [problem.text for problem in check.problems(scene, fresh=True) if problem.key == "past_node"]
    assert "Front" in told and "Back" not in told and "Add Temporal Denoise Node" in told
    assert bpy.ops.hush.denoise_shot() == {"FINISHED"}
    assert warnings(scene) == [told]
    assert bpy.ops.hush.add_node() == {"FINISHED"}, "the button that it names does it"
    assert flow.past_layers(scene) == [] and len(list(node.nodes(scene))) == 2


def test_a_look_at_the_render_is_no_matter() -> None:
    """A Viewer and a File Output of the noisy image are the artist's own."""
    scene, _, (first, second) = two_layers("aside", render=False)
    tree = first.id_data
    assert bpy.ops.hush.add_node() == {"FINISHED"}
    tree.links.new(second.outputs["Image"], tree.nodes.new("CompositorNodeViewer").inputs[0])
    assert flow.past_layers(scene) == []


def test_a_node_of_a_view_layer_that_got_another_name() -> None:
    """Render Layers follows, the node does not: another render would not help."""
    scene, _ = composites.denoised_scene("other-name", frames=1)
    assert bpy.ops.hush.add_node() == {"FINISHED"}
    (added,) = node.nodes(scene)
    added.node_tree.hush.view_layer = "Old Name"
    said = composites.refused("Old Name", "choose another View Layer")
    assert "Render Animation" not in said


def test_a_view_layer_that_is_off_is_empty_as_in_a_render() -> None:
    """The whole composite failed, as the files lack it."""
    for with_node in (False, True):
        scene, folder, _ = two_layers(f"off-{with_node}", render=False)
        scene.view_layers["Front"].use = False
        bpy.ops.render.render(animation=True)
        if with_node:
            assert bpy.ops.hush.add_node() == {"FINISHED"}
            (added,) = node.nodes(scene)
            assert added.node_tree.hush.view_layer == "Back", "behind the one that is rendered"
        assert bpy.ops.hush.denoise_shot() == {"FINISHED"}
        (told,) = warnings(scene)
        assert "Front" in told and "off" in told
        kit.assert_close(composites.plain(folder / "composited" / "frame_0001.exr"), combined(folder / "denoised", "Back"), 4e-3)


def test_a_new_compositor_shows_a_view_layer_that_is_rendered() -> None:
    scene = kit.build_scene()
    scene.view_layers.new("Second")
    scene.view_layers[0].use = False
    assert bpy.ops.hush.add_node() == {"FINISHED"}
    tree = compat.compositor_tree(scene)
    assert [each.layer for each in tree.nodes if each.bl_idname == "CompositorNodeRLayers"] == ["Second"]


def test_light_passes_are_denoised_beside_the_node() -> None:
    """They were composited noisy as soon as the compositor had a node."""
    scene, folder, (first, _) = two_layers("light")
    scene.hush.use_light_passes = True
    assert bpy.ops.hush.add_node() == {"FINISHED"}
    tree, result = first.id_data, compat.output_node(first.id_data).inputs[0]
    name = next(socket.name for socket in first.outputs if socket.name in ("DiffDir", "Diffuse Direct"))
    tree.links.new(first.outputs[name], result)
    assert bpy.ops.hush.denoise_shot() == {"FINISHED"}
    assert warnings(scene) == []
    there = kit.channels(folder / "frame_0001.exr")
    in_file = next(each for each in ("DiffDir", "Diffuse Direct") if f"Back.{each}.R" in there)
    noisy, denoised = (kit.layer(place / "frame_0001.exr", f"Back.{in_file}") for place in (folder, folder / "denoised"))
    made = composites.plain(folder / "composited" / "frame_0001.exr")[..., :3]
    kit.assert_differs(noisy, denoised, 1e-3)
    kit.assert_close(made, denoised, 4e-3)


def test_a_compositor_that_two_scenes_share() -> None:
    """The other scene was rendered again at every frame, for an image that nothing took."""
    scene = kit.build_scene("plain", kit.folder("shared-one"))
    scene.render.resolution_x, scene.render.resolution_y, scene.frame_end = 48, 27, 1
    assert bpy.ops.hush.add_node() == {"FINISHED"}
    folder = kit.folder("shared-two")
    other = scene.copy()
    other.name, other.render.filepath = "Other", str(folder / "frame_####")
    bpy.ops.render.render(animation=True, scene="Other")
    tree = compat.compositor_tree(other)
    for each in tree.nodes:
        if each.bl_idname == "CompositorNodeRLayers":
            # Before Blender 5 each scene has a tree of its own, and its copy shows the new scene.
            each.scene = scene
    assert bpy.ops.hush.denoise_shot(scene="Other") == {"FINISHED"}
    assert [text for text in warnings(other) if "composite too" in text] == []
    kit.assert_close(composites.plain(folder / "composited" / "frame_0001.exr"), combined(folder / "denoised", "ViewLayer"), 4e-3)


def test_a_denoise_node_behind_it_is_told() -> None:
    """It is where many compositors denoise, and would bring back the flicker."""
    scene = kit.build_scene()
    tree, layers, result = composites.tree_of(scene)
    before = tree.nodes.new("CompositorNodeDenoise")
    tree.links.new(layers.outputs["Image"], before.inputs[0])
    tree.links.new(before.outputs[0], result)
    assert flow.denoised_again(scene) == [before.name], "also without a node all is composited denoised"
    assert bpy.ops.hush.add_node() == {"FINISHED"}
    (told,) = [problem.text for problem in check.problems(scene, fresh=True) if problem.key == "denoised_again"]
    assert before.name in told and "Mute" in told
    before.mute = True
    assert flow.denoised_again(scene) == []
    before.mute = False
    # Of a pass that Hush leaves alone it is right.
    tree.links.new(layers.outputs["Depth"], before.inputs[0])
    assert flow.denoised_again(scene) == []


def denoised_in_the_compositor() -> tuple[bpy.types.Scene, bpy.types.Node, bpy.types.Node]:
    """A scene that is denoised by Cycles and, from its noisy image, in the compositor; its Render Layers and the Denoise node."""
    scene = kit.build_scene()
    scene.cycles.use_denoising = True
    tree, layers, result = composites.tree_of(scene)
    denoise = tree.nodes.new("CompositorNodeDenoise")
    tree.links.new(layers.outputs["Noisy Image"], denoise.inputs[0])
    tree.links.new(denoise.outputs[0], result)
    return scene, layers, denoise


def test_the_noisy_image_is_an_image_too() -> None:
    """Who denoises in the compositor takes it in place of Image, and Hush's frames went nowhere."""
    scene, layers, denoise = denoised_in_the_compositor()
    assert flow.denoised_again(scene) == [], "Hush leaves that pass as it was rendered"
    assert bpy.ops.hush.add_node() == {"FINISHED"}
    (added,) = node.nodes(scene)
    assert added.inputs[0].links[0].from_socket == layers.outputs["Noisy Image"]
    assert denoise.inputs[0].links[0].from_node == added and flow.denoised_again(scene) == [denoise.name]
    assert flow.past_layers(scene) == []


def test_prepare_shot_leaves_no_compositor_without_its_image() -> None:
    """With Cycles' denoising off there is no Noisy Image, and whatever took it was white; the fix takes Image."""
    scene, layers, denoise = denoised_in_the_compositor()
    assert flow.lost_layers(scene) == []
    assert bpy.ops.hush.prepare_shot() == {"FINISHED"}
    (told,) = [problem for problem in check.problems(scene, fresh=True) if problem.key == "noisy_image"]
    assert "ViewLayer" in told.text and told.fix is not None
    assert bpy.ops.hush.fix(key="noisy_image") == {"FINISHED"}
    (link,) = denoise.inputs[0].links
    assert link.from_socket == layers.outputs["Image"] and flow.lost_layers(scene) == []
    assert flow.denoised_again(scene) == [denoise.name], "and that is told next"


def test_a_denoise_node_inside_a_group_is_told() -> None:
    scene = kit.build_scene()
    tree, layers, result = composites.tree_of(scene)
    group = bpy.data.node_groups.new("Grade", "CompositorNodeTree")
    for direction in ("INPUT", "OUTPUT"):
        group.interface.new_socket("Image", in_out=direction, socket_type="NodeSocketColor")
    denoise, point = group.nodes.new("CompositorNodeDenoise"), group.nodes.new("NodeReroute")
    denoise.name = "Deep"
    group.links.new(group.nodes.new("NodeGroupInput").outputs[0], point.inputs[0])
    group.links.new(point.outputs[0], denoise.inputs[0])
    group.links.new(denoise.outputs[0], group.nodes.new("NodeGroupOutput").inputs[0])
    graded = tree.nodes.new("CompositorNodeGroup")
    graded.node_tree = group
    tree.links.new(layers.outputs["Image"], graded.inputs[0])
    tree.links.new(graded.outputs[0], result)
    assert bpy.ops.hush.add_node() == {"FINISHED"}
    assert flow.denoised_again(scene) == ["Deep"]
    graded.mute = True
    assert flow.denoised_again(scene) == [], "a muted group passes by what is in it"

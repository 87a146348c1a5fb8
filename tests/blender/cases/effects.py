"""Blender 5.3 has a row of compositor trees in a scene, and their Group Input is the render; other versions have one tree without."""

from __future__ import annotations

from pathlib import Path

import bpy
import fingerprint
import kit
from composites import HALF, combined, compat, denoised_scene, plain, untouched

TIME_LIMIT = 600.0


def group(name: str, exposure: float | None = None, *, by_input: bool = False) -> bpy.types.NodeTree:
    """Group Input to Group Output, as Blender 5.3 makes it, with an exposure between if asked, which is an input where `by_input`."""
    tree = bpy.data.node_groups.new(name, "CompositorNodeTree")
    tree.interface.new_socket("Image", in_out="INPUT", socket_type="NodeSocketColor")
    tree.interface.new_socket("Image", in_out="OUTPUT", socket_type="NodeSocketColor")
    if by_input:
        tree.interface.new_socket("Stops", in_out="INPUT", socket_type="NodeSocketFloat").default_value = exposure
    source, result = tree.nodes.new("NodeGroupInput"), tree.nodes.new("NodeGroupOutput")
    out = source.outputs[0]
    if exposure is not None:
        node = tree.nodes.new("CompositorNodeExposure")
        node.inputs["Exposure"].default_value = exposure
        tree.links.new(out, node.inputs[0])
        if by_input:
            tree.links.new(source.outputs["Stops"], node.inputs["Exposure"])
        out = node.outputs[0]
    tree.links.new(out, result.inputs[0])
    return tree


def effect(scene: bpy.types.Scene, tree: bpy.types.NodeTree) -> object:
    made = scene.compositor_effects.new(tree.name)
    made.node_group = tree
    return made


def dark(scene: bpy.types.Scene) -> None:
    """What is rendered from now on is black."""
    for each in scene.objects:
        each.hide_render = each.type != "CAMERA"


def assert_times(folder: Path, frame: int, factor: float) -> None:
    name = f"frame_{frame:04d}.exr"
    expected = combined(folder / "denoised" / name)[..., :3] * factor
    kit.assert_close(plain(folder / "composited" / name)[..., :3], expected, HALF * max(1.0, factor), name)


def test_only_blender_5_3_has_them() -> None:
    assert compat.HAS_EFFECTS == (bpy.app.version >= (5, 3))
    scene = kit.build_scene()
    assert compat.compositor_trees(scene) == [] and compat.compositor_tree(scene) is None
    tree = compat.ensure_compositor_tree(scene)
    assert compat.compositor_trees(scene) == [tree]


def test_the_node_goes_behind_the_group_input() -> None:
    if not compat.HAS_EFFECTS:
        return
    scene = kit.build_scene()
    tree = group("Comp", 1.0)
    effect(scene, tree)
    exposure = next(each for each in tree.nodes if each.bl_idname == "CompositorNodeExposure")
    assert bpy.ops.hush.add_node() == {"FINISHED"}
    (node,) = kit.module("nodes.node").nodes(scene)
    assert node.inputs[0].links[0].from_node.bl_idname == "NodeGroupInput"
    assert [link.to_node for link in node.outputs[0].links] == [exposure]
    assert compat.output_node(tree).inputs[0].links[0].from_node == exposure, "the artist's link is gone"


def test_the_render_of_the_group_input_is_the_denoised_file() -> None:
    """Nothing is rendered for it, with the node and without."""
    if not compat.HAS_EFFECTS:
        return
    scene, folder = denoised_scene("input", frames=2)
    effect(scene, group("Comp", 1.0))
    dark(scene)
    assert untouched() == {"FINISHED"}
    for frame in (1, 2):
        assert_times(folder, frame, 2.0)
    assert bpy.ops.hush.add_node() == {"FINISHED"}
    assert untouched() == {"FINISHED"}
    for frame in (1, 2):
        assert_times(folder, frame, 2.0)


def test_all_effects_that_are_rendered_count() -> None:
    if not compat.HAS_EFFECTS:
        return
    scene, folder = denoised_scene("row", frames=1)
    dark(scene)
    shared = group("Shared", 1.0)
    effect(scene, shared)
    off = effect(scene, group("Off", 5.0))
    off.enable_for_render = False
    effect(scene, shared)
    # The active one is not the first one.
    scene.compositor_effects.active = off
    assert compat.compositor_trees(scene) == [shared, shared]
    assert untouched() == {"FINISHED"}
    assert_times(folder, 1, 4.0)


def test_what_effects_give_their_trees() -> None:
    """The values of their inputs, also where they are keyframed."""
    if not compat.HAS_EFFECTS:
        return
    scene, folder = denoised_scene("inputs", frames=2)
    dark(scene)
    made = effect(scene, group("Comp", 0.0, by_input=True))
    (name,) = (each.identifier for each in made.node_group.interface.items_tree if each.name == "Stops")
    value = getattr(made.properties.inputs, name)
    value.value = 2.0
    assert untouched() == {"FINISHED"}
    for frame in (1, 2):
        assert_times(folder, frame, 4.0)
    for frame, stops in ((1, 0.0), (2, 1.0)):
        value.value = stops
        assert scene.keyframe_insert(f'compositor_effects["{made.name}"].properties.inputs.{name}.value', frame=frame)
    scene.frame_set(1)
    assert untouched() == {"FINISHED"}
    for frame, factor in ((1, 1.0), (2, 2.0)):
        assert_times(folder, frame, factor)


def test_where_all_are_off_nothing_is_added() -> None:
    if not compat.HAS_EFFECTS:
        return
    scene = kit.build_scene()
    made = effect(scene, group("Comp"))
    made.enable_for_render = False
    before = fingerprint.take()
    kit.refused(bpy.ops.hush.add_node, "scene effect")
    assert not fingerprint.changes(before, fingerprint.take())

"""The guides as each Blender writes them, what Hush makes of them, and the switches of Blender 5.2 that change them.

Blender 5.2 writes Denoising Specular Albedo and Denoising Roughness too, and the greatest float over the samples as the depth of the
background; before, that was 0, and from Blender 5.3 on it is the way to the far clipping plane. The environment is in Denoising Albedo in
all versions.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path

import bpy
import kit
import numpy as np

check, prepare = kit.module("checks.check"), kit.module("prepare")
BLENDER_5_2 = bpy.app.version >= (5, 2)
BLENDER_5_3 = bpy.app.version >= (5, 3)
SWITCHES = {
    "follow_reflections": ("denoising_pass_follow_reflections", "mirrors"),
    "albedo_weighting": ("denoising_pass_use_albedo_roughness_weighting", "black"),
}
SAMPLES = 4
ENVIRONMENT = (0.4, 1.0, 2.0)


def told(scene: bpy.types.Scene) -> dict[str, str]:
    """Keys and texts of Check Shot's problems with the switches."""
    return {problem.key: problem.text for problem in check.problems(scene, fresh=True) if problem.key in SWITCHES}


def turn_off(layer: bpy.types.ViewLayer, key: str) -> bool:
    """Turns a switch off; False where this Blender has none."""
    name, _ = SWITCHES[key]
    if hasattr(layer.cycles, name):
        setattr(layer.cycles, name, False)
    return hasattr(layer.cycles, name)


@cache
def rendered() -> Path:
    """A file with sky above ground and a mirror, the environment brighter than 1; tests/data has those of Blender 5.2 and 5.3."""
    scene = kit.build_scene()
    world = bpy.data.worlds.new("Sky")
    scene.world = world
    world.use_nodes = True
    world.node_tree.nodes["Background"].inputs["Color"].default_value = (*ENVIRONMENT, 1)
    mirror = bpy.data.materials["Red"].node_tree.nodes["Principled BSDF"]
    mirror.inputs["Metallic"].default_value, mirror.inputs["Roughness"].default_value = 1, 0
    scene.camera.rotation_euler.x = 1.3
    scene.camera.animation_data_clear()
    scene.render.resolution_x, scene.render.resolution_y = 32, 24
    scene.cycles.samples = SAMPLES
    layer = scene.view_layers[0]
    layer.use_pass_position, layer.use_pass_environment = False, True
    scene.frame_start = scene.frame_end = 1
    folder = kit.folder("rendered")
    scene.render.filepath = str(folder / "frame_####")
    bpy.ops.render.render(animation=True)
    return folder / "frame_0001.exr"


def test_only_blender_5_2_has_the_switches_and_they_are_on() -> None:
    cycles = kit.build_scene().view_layers[0].cycles
    for name, _ in SWITCHES.values():
        assert hasattr(cycles, name) == BLENDER_5_2, name
        assert getattr(cycles, name, True)


def test_a_switch_that_is_off_is_told_and_fixed() -> None:
    for key, (name, words) in SWITCHES.items():
        scene = kit.build_scene()
        assert told(scene) == {}
        layer = scene.view_layers[0]
        if not turn_off(layer, key):
            assert prepare.apply(scene, (key,)) == [] and scene.hush.prepared == ""
            continue
        assert list(told(scene)) == [key]
        assert words in told(scene)[key] and layer.name in told(scene)[key], told(scene)
        (problem,) = (each for each in check.problems(scene, fresh=True) if each.key == key)
        operator, arguments = problem.fix
        assert operator == "hush.fix" and bpy.ops.hush.fix(**arguments) == {"FINISHED"}
        assert getattr(layer.cycles, name) and told(scene) == {}
        assert bpy.ops.hush.undo_prepare() == {"FINISHED"}
        assert not getattr(layer.cycles, name), "Undo Prepare did not put it back"


def test_prepare_turns_both_on_and_undo_puts_both_back() -> None:
    scene = kit.build_scene()
    layer = scene.view_layers[0]
    there = [turn_off(layer, key) for key in SWITCHES]
    assert there == [BLENDER_5_2, BLENDER_5_2]
    changes = prepare.apply(scene)
    assert ("Follow Reflections on" in " ".join(changes), "Albedo Roughness Weighting on" in " ".join(changes)) == tuple(there), changes
    assert told(scene) == {} and prepare.apply(scene) == []
    assert prepare.undo(scene) == []
    assert [getattr(layer.cycles, name, False) for name, _ in SWITCHES.values()] == [False, False]


def test_a_layer_for_the_vectors_alone_is_left_out() -> None:
    scene = kit.build_scene("blur")
    scene.hush.vector_layer = "Vectors"
    for key in SWITCHES:
        turn_off(scene.view_layers["Vectors"], key)
    assert told(scene) == {}


def test_the_background_as_this_blender_writes_it() -> None:
    path = rendered()
    depth, albedo = kit.layer(path, "Denoising Depth", "Z")[..., 0], kit.layer(path, "Denoising Albedo")
    sky = depth[0]
    far = bpy.context.scene.camera.data.clip_end
    expected = (far, 1.2 * far) if BLENDER_5_3 else (np.finfo(np.float32).max / SAMPLES,) * 2 if BLENDER_5_2 else (0, 0)
    assert ((sky >= expected[0] * (1 - 1e-6)) & (sky <= expected[1] * (1 + 1e-6))).all(), sky
    assert ((depth > 0) & (depth < 100)).any(), "no ground is seen"
    kit.assert_close(albedo[0], np.broadcast_to(np.float32(ENVIRONMENT), albedo[0].shape), 1e-5, "the sky's albedo")


def test_the_new_passes_are_named_and_no_light_passes() -> None:
    import hush

    path = rendered()
    names = {f"ViewLayer.{name}" for name in ("Denoising Specular Albedo", "Denoising Roughness")}
    assert {name.rsplit(".", 1)[0] for name in kit.channels(path)} >= names if BLENDER_5_2 else True
    told_of = hush.inspect(path)
    used = {use["pass"] for use in told_of["uses"]}
    assert "ViewLayer.Denoising Albedo" in used and not used & names, used
    assert told_of["light_passes"] == ["Environment" if bpy.app.version >= (5, 0) else "Env"], told_of["light_passes"]
    notes = " ".join(told_of["notes"])
    assert ("Denoising Specular Albedo" in notes) == BLENDER_5_2, notes


def test_denoising_keeps_the_sky_and_the_passes_that_are_no_light() -> None:
    import hush

    path = rendered()
    output = kit.folder("denoised")
    told_of = hush.denoise_sequence(path.parent / "frame_####.exr", output, aovs="all")
    assert told_of["written"] == 1, told_of
    sky = kit.layer(output / path.name, "ViewLayer.Combined")[0]
    kit.assert_close(sky, np.broadcast_to(np.float32(ENVIRONMENT), sky.shape), 0.02, "the denoised sky")
    before, after = kit.channels(path), kit.channels(output / path.name)
    guides = [name for name in before if ".Denoising " in name]
    assert len(guides) == (11 if BLENDER_5_2 else 7), guides
    assert all(np.array_equal(before[name], after[name]) for name in guides)

"""Prepare Shot turns on what Hush needs, says so, and is undone exactly."""

from __future__ import annotations

import json
from typing import Any

import bpy
import kit

prepare = kit.module("prepare")
SKIPPED = {"rna_type", "name", "layer_collection", "active_layer_collection", "prepared", "session_uid", "is_evaluated"}


def plain_values(owner: Any) -> dict[str, Any]:  # noqa: ANN401 (any Blender struct)
    """All properties of a struct that are numbers, texts or sets."""
    found = {}
    for item in owner.bl_rna.properties:
        if item.identifier not in SKIPPED and item.type in {"BOOLEAN", "INT", "FLOAT", "STRING", "ENUM"}:
            value = getattr(owner, item.identifier)
            found[item.identifier] = value if isinstance(value, str | int | float | bool) else list(value)
    return found


def collections(layer: bpy.types.LayerCollection) -> list[Any]:
    """Names and visibility of a view layer's collections."""
    flags = [layer.exclude, layer.holdout, layer.indirect_only, layer.hide_viewport]
    return [layer.name, flags, [collections(child) for child in layer.children]]


def dump(scene: bpy.types.Scene) -> dict[str, Any]:
    """All settings of a scene that Prepare Shot might touch, and many more."""
    structs = {
        "scene": scene,
        "render": scene.render,
        "image": scene.render.image_settings,
        "cycles": scene.cycles,
        "hush": scene.hush,
    }
    found = {name: plain_values(struct) for name, struct in structs.items()}
    for layer in scene.view_layers:
        found[f"layer {layer.name}"] = plain_values(layer)
        found[f"layer {layer.name} cycles"] = plain_values(layer.cycles)
        found[f"layer {layer.name} collections"] = {"": collections(layer.layer_collection)}
    return found


def assert_same(now: dict[str, Any], before: dict[str, Any]) -> None:
    """Fails with what differs between two dumps."""
    flat = [{f"{owner} {name}": value for owner, values in each.items() for name, value in values.items()} for each in (before, now)]
    different = {key: (flat[0].get(key), flat[1].get(key)) for key in flat[0] | flat[1] if flat[0].get(key) != flat[1].get(key)}
    assert now == before, f"before, now: {different}"


def raw_scene(*, blur: bool = False) -> bpy.types.Scene:
    """A scene as Blender makes it: PNG, no passes, the same seed for all frames."""
    scene = kit.build_scene("blur" if blur else "bare")
    if blur:
        scene.view_layers.remove(scene.view_layers["Vectors"])
        for layer in scene.view_layers:
            layer.use_pass_vector = layer.use_pass_z = layer.cycles.denoising_store_passes = False
    if hasattr(scene.render.image_settings, "media_type"):
        scene.render.image_settings.media_type = "IMAGE"
    scene.render.image_settings.file_format = "PNG"
    scene.render.image_settings.color_mode = "RGB"
    scene.render.image_settings.color_depth = "8"
    scene.cycles.use_animated_seed = False
    scene.cycles.use_denoising = True
    return scene


def test_it_turns_on_what_is_needed() -> None:
    scene = raw_scene()
    assert bpy.ops.hush.prepare_shot() == {"FINISHED"}
    layer, settings = scene.view_layers[0], scene.render.image_settings
    assert layer.use_pass_vector and layer.use_pass_z and layer.cycles.denoising_store_passes
    assert scene.cycles.use_animated_seed and not scene.cycles.use_denoising
    assert (settings.file_format, settings.color_depth, settings.exr_codec) == ("OPEN_EXR_MULTILAYER", "32", "ZIP")
    assert [each.name for each in scene.view_layers] == [layer.name], "a view layer was added without motion blur"


def test_it_says_each_change_once() -> None:
    scene = raw_scene(blur=True)
    told = "\n".join(prepare.apply(scene))
    for word in ("Denoising Data", "Vector", "Depth", "animated seed", "denoising off", "MultiLayer", "32 bit", "Hush Vectors"):
        assert word in told, f"{word!r} is not told:\n{told}"
    again = dump(scene), scene.hush.prepared
    assert prepare.apply(scene) == []
    assert (dump(scene), scene.hush.prepared) == again


def test_nothing_is_written_where_nothing_is_to_be_changed() -> None:
    scene = kit.build_scene("plain")
    assert prepare.apply(scene) == [] and not scene.hush.is_property_set("prepared")


def test_undo_is_exact() -> None:
    for blur in (False, True):
        scene = raw_scene(blur=blur)
        before = dump(scene)
        bpy.ops.hush.prepare_shot()
        assert dump(scene) != before
        assert bpy.ops.hush.undo_prepare() == {"FINISHED"}
        assert_same(dump(scene), before)
        assert scene.hush.prepared == ""


def test_undo_is_exact_after_preparing_twice_saving_and_loading() -> None:
    scene = raw_scene(blur=True)
    before = dump(scene)
    bpy.ops.hush.prepare_shot()
    scene.cycles.use_animated_seed = False
    bpy.ops.hush.prepare_shot()
    assert scene.cycles.use_animated_seed
    blend = str(kit.folder("saved") / "shot.blend")
    bpy.ops.wm.save_as_mainfile(filepath=blend)
    bpy.ops.wm.open_mainfile(filepath=blend)
    scene = bpy.context.scene
    assert bpy.ops.hush.undo_prepare() == {"FINISHED"}
    assert_same(dump(scene), before)


def test_undo_leaves_what_was_changed_by_hand_since() -> None:
    scene = raw_scene()
    bpy.ops.hush.prepare_shot()
    scene.render.image_settings.exr_codec = "PIZ"
    scene.cycles.samples = 77
    bpy.ops.hush.undo_prepare()
    assert scene.cycles.samples == 77
    assert scene.render.image_settings.file_format == "PNG"
    assert scene.render.image_settings.exr_codec == "PIZ"


def test_what_undo_leaves_is_told_in_the_words_of_blender() -> None:
    scene = raw_scene()
    kit.module("compat").use_multilayer(scene.render.image_settings)
    scene.render.image_settings.exr_codec = "DWAA"
    bpy.ops.hush.prepare_shot()
    scene.render.image_settings.exr_codec = "PIZ"
    name = scene.view_layers[0].name
    scene.view_layers[0].name = "Beauty"
    told = kit.module("record").undo(scene)
    assert len(told) == 2 and any("Codec" in text for text in told) and any(name in text and "name" in text for text in told), told
    assert not any("_" in text or "›" in text for text in told), f"names of Blender's Python: {told}"


def test_lossless_settings_stay() -> None:
    scene = kit.build_scene("plain")
    scene.render.image_settings.exr_codec = "PIZ"
    before = dump(scene)
    assert bpy.ops.hush.prepare_shot() == {"FINISHED"}
    assert_same(dump(scene), before)
    assert scene.hush.prepared == ""


def test_motion_blur_gets_a_layer_for_the_vectors() -> None:
    scene = raw_scene(blur=True)
    first = scene.view_layers[0]
    hidden = bpy.data.collections.new("Hidden")
    inner = bpy.data.collections.new("Inner")
    shadow = bpy.data.collections.new("Shadow")
    scene.collection.children.link(hidden)
    scene.collection.children.link(shadow)
    shadow.children.link(inner)
    first.layer_collection.children["Hidden"].exclude = True
    first.layer_collection.children["Shadow"].indirect_only = True
    first.layer_collection.children["Shadow"].children["Inner"].holdout = True
    bpy.ops.hush.prepare_shot()
    made = scene.view_layers["Hush Vectors"]
    assert not made.use_motion_blur and made.samples == 1 and made.use_pass_vector and made.use
    assert first.use_motion_blur, "the shot's own layer lost its motion blur"
    assert collections(made.layer_collection)[1:] == collections(first.layer_collection)[1:]
    assert scene.hush.vector_layer == "Hush Vectors"


def test_the_one_sample_is_heeded() -> None:
    """Where Cycles ignores what view layers say; their own numbers do not come into force with it."""
    scene = raw_scene(blur=True)
    scene.cycles.use_layer_samples, scene.view_layers[0].samples = "IGNORE", 999
    before = dump(scene)
    bpy.ops.hush.prepare_shot()
    assert scene.cycles.use_layer_samples == "USE" and scene.view_layers["Hush Vectors"].samples == 1
    assert scene.view_layers[0].samples == 0, "the shot's own layer renders with other samples than before"
    bpy.ops.hush.undo_prepare()
    assert_same(dump(scene), before)
    assert (scene.cycles.use_layer_samples, scene.view_layers[0].samples) == ("IGNORE", 999)
    scene.cycles.use_layer_samples = "BOUNDED"
    bpy.ops.hush.prepare_shot()
    assert scene.cycles.use_layer_samples == "BOUNDED" and scene.view_layers[0].samples == 999


def test_a_layer_that_has_the_vectors_already_is_taken() -> None:
    scene = kit.build_scene("blur")
    bpy.ops.hush.prepare_shot()
    assert scene.hush.vector_layer == "Vectors"
    assert "Hush Vectors" not in scene.view_layers
    bpy.ops.hush.undo_prepare()
    assert scene.hush.vector_layer == "" and "Vectors" in scene.view_layers


def test_every_scene_has_its_own_record() -> None:
    first = raw_scene()
    other = bpy.data.scenes.new("Other")
    other.render.engine = "CYCLES"
    before = dump(first)
    assert bpy.ops.hush.prepare_shot(scene="Other") == {"FINISHED"}
    assert dump(first) == before and first.hush.prepared == ""
    assert json.loads(other.hush.prepared)["values"]


def test_other_engines_are_refused() -> None:
    scene = raw_scene()
    scene.render.engine = "BLENDER_WORKBENCH"
    before = dump(scene)
    for arguments, words in (({}, "Cycles"), ({"scene": "Nowhere"}, "no scene Nowhere")):
        try:
            bpy.ops.hush.prepare_shot(**arguments)
        except RuntimeError as error:
            assert words in str(error), error
        else:
            raise AssertionError("was not refused")
    assert_same(dump(scene), before)


def test_a_renamed_layer_for_the_vectors_is_told() -> None:
    """It is found by its name, so it is not removed."""
    scene = kit.build_scene()
    scene.render.use_motion_blur = True
    assert bpy.ops.hush.prepare_shot() == {"FINISHED"}
    scene.view_layers["Hush Vectors"].name = "Mine"
    told = kit.module("record").undo(scene)
    assert any("Hush Vectors" in text for text in told), told
    assert "Mine" in scene.view_layers and not scene.hush.prepared

"""What a scene says about its shot: files, frames, λ at each frame; and how far it is denoised."""

from __future__ import annotations

from pathlib import Path

import bpy
import frames
import kit


def key_lambda(scene: bpy.types.Scene, keys: dict[int, float]) -> None:
    for frame, value in keys.items():
        scene.hush.lam = value
        assert scene.hush.keyframe_insert("lam", frame=frame)
    for curve in kit.module("compat").fcurves(scene):
        for point in curve.keyframe_points:
            point.interpolation = "LINEAR"


def test_files_are_where_blender_renders_to() -> None:
    shot, scene = kit.module("shot"), kit.build_scene()
    for path in ("/tmp/x/", "/tmp/x/frame_", "/tmp/sh_##_v2", "/tmp/a##b/sh####", "/tmp/take10####", "/tmp/z######_", "/tmp/v2.1/####"):
        scene.render.filepath = path
        for frame in (0, 1, 7, 9999, 10000, 123456):
            assert str(shot.frame_file(shot.frame_pattern(scene), frame)) == scene.render.frame_path(frame=frame), path
        assert shot.output_file(scene, 7).parent == shot.frame_pattern(scene).parent / "denoised"
    if frames.BLENDER_5:
        scene.render.filepath = "/tmp/{no_such_variable}/frame_"
        try:
            shot.frame_pattern(scene)
        except kit.module("messages").Refusal as error:
            assert "no_such_variable" in str(error)
        else:
            raise AssertionError("an output path that cannot be used should be refused")
        assert "no_such_variable" in kit.module("status").shot_status(scene).text


def test_files_are_exr_after_the_output_was_changed_to_png() -> None:
    shot, scene = kit.module("shot"), kit.build_scene(render_to=Path("/tmp/shot"))
    kit.module("compat").use_image_format(scene.render.image_settings, "PNG")
    assert shot.frame_pattern(scene) == Path("/tmp/shot/frame_####.exr")


def test_what_to_press_leads_to_frames_that_can_be_denoised() -> None:
    scene = kit.build_scene(render_to=kit.folder("png"))
    kit.module("compat").use_image_format(scene.render.image_settings, "PNG")
    assert told(scene).endswith(": press Prepare Shot, then Render Animation")
    assert kit.module("status").frame(scene, 1).why == "this frame is not rendered; press Prepare Shot, then Render Animation"
    scene.hush.input_folder = str(kit.folder("from_elsewhere"))
    assert told(scene).endswith(": render what is missing, or choose another folder under Rendered Frames")


def test_a_folder_of_frames_may_be_named() -> None:
    shot, scene, folder = kit.module("shot"), kit.build_scene(), kit.folder("named")
    for frame in range(1, 4):
        (folder / f"other.{frame:05d}.exr").write_bytes(b"x")
    (folder / "note_1.exr").write_bytes(b"x")
    scene.hush.input_folder = str(folder)
    assert shot.frame_pattern(scene) == folder / "other.#####.exr"
    scene.hush.input_folder = str(folder / "note_#.exr")
    assert shot.frame_pattern(scene) == folder / "note_#.exr"


def test_folders_may_have_hashes_in_their_names() -> None:
    shot, scene = kit.module("shot"), kit.build_scene()
    folder = kit.folder("takes") / "Take #3"
    folder.mkdir()
    (folder / "frame_0001.exr").write_bytes(b"x")
    scene.hush.input_folder = str(folder)
    assert shot.frame_pattern(scene) == folder / "frame_####.exr"
    scene.hush.input_folder = ""
    scene.render.filepath = str(folder / "other_##")
    assert shot.frame_pattern(scene) == folder / "other_##.exr"


def test_hashes_that_are_not_the_frame_numbers_are_told() -> None:
    """Blender takes the last ones; the library wants them once, and said so in words of the command line."""
    shot, scene, refusal = kit.module("shot"), kit.build_scene(), kit.module("messages").Refusal
    for field, where in (("filepath", "Output Path"), ("input_folder", "Rendered Frames")):
        setattr(scene.render if field == "filepath" else scene.hush, field, "/tmp/shot#1_####.exr")
        try:
            shot.frame_pattern(scene)
        except refusal as error:
            assert "shot#1_####.exr" in str(error) and where in str(error), error
        else:
            raise AssertionError(f"{field} should be refused")
        scene.render.filepath = "/tmp/shot_####"


def test_lambda_keys_reach_every_frame() -> None:
    shot, scene = kit.module("shot"), kit.build_scene()
    scene.hush.lam = 3.0
    assert shot.lambda_keys(scene) == 3.0
    key_lambda(scene, {1: 2.0, 5: 10.0})
    scene.frame_set(4)
    assert shot.lambda_keys(scene) == {1: 2.0, 2: 4.0, 3: 6.0, 4: 8.0, 5: 10.0}
    assert scene.frame_current == 4 and shot.lambda_at(scene, 100) == 10.0
    assert shot.lambda_source(scene) == "keys"
    scene.frame_step = 2
    assert shot.lambda_keys(scene) == {1: 2.0, 3: 6.0, 5: 10.0}


def test_lambda_stays_in_its_range() -> None:
    shot, scene = kit.module("shot"), kit.build_scene()
    key_lambda(scene, {1: 1.0, 5: 64.0})
    (curve,) = (c for c in kit.module("compat").fcurves(scene) if c.data_path == "hush.lam")
    curve.keyframe_points[0].co.y, curve.keyframe_points[1].co.y = -10.0, 90.0
    curve.update()
    values = shot.lambda_keys(scene)
    assert values[1] == 1.0 and values[5] == 64.0, values


def test_lambda_under_a_driver_is_its_value_now() -> None:
    shot, scene = kit.module("shot"), kit.build_scene()
    scene.hush.driver_add("lam").driver.expression = "frame + 1"
    scene.frame_set(3)
    assert shot.lambda_source(scene) == "driver"
    assert shot.lambda_keys(scene) == 4.0 == shot.lambda_at(scene, 1)


def test_keys_of_other_things_are_not_taken_for_lambda() -> None:
    shot, scene = kit.module("shot"), kit.build_scene()
    scene.hush.lam = 5.0
    scene.cycles.keyframe_insert("samples", frame=1)
    assert shot.lambda_source(scene) == "value" and shot.lambda_keys(scene) == 5.0


def test_settings_are_saved() -> None:
    scene, blend = kit.build_scene(), kit.folder("saved") / "s.blend"
    scene.hush.lam, scene.hush.window, scene.hush.output_folder = 7.0, "3", "//out"
    key_lambda(scene, {1: 2.0, 5: 6.0})
    bpy.ops.wm.save_as_mainfile(filepath=str(blend))
    bpy.ops.wm.read_homefile(use_empty=True)
    bpy.ops.wm.open_mainfile(filepath=str(blend))
    scene, shot = bpy.context.scene, kit.module("shot")
    assert shot.window(scene) == 3 and shot.output_folder(scene) == blend.parent / "out"
    assert shot.lambda_keys(scene)[3] == 4.0


def told(scene: bpy.types.Scene) -> str:
    kit.module("status").forget()
    return kit.module("status").shot_status(scene).text


def test_status_tells_how_far_it_is() -> None:
    shot = kit.copy_of_shot("status")
    scene = kit.build_scene(render_to=shot)
    assert told(scene) == "not denoised yet: press Denoise Shot"
    frames.denoise(scene, [1, 2])
    assert told(scene) == "2 of 5 frames denoised, 3 to do"
    frames.denoise(scene)
    assert told(scene) == "5 of 5 frames denoised"
    scene.hush.lam = 4.0
    # Without forgetting: the settings are compared each time.
    assert kit.module("status").shot_status(scene).text == "0 of 5 frames denoised, 5 are out of date: λ Noise to Keep changed"
    frames.denoise(scene, [1, 2, 3, 4])
    assert told(scene) == "4 of 5 frames denoised, 1 is out of date: λ Noise to Keep changed"
    scene.hush.lam = 1.0
    key_lambda(scene, {1: 4.0, 4: 4.0, 5: 1.0})
    assert told(scene) == "5 of 5 frames denoised"


def test_status_tells_what_changed() -> None:
    shot = kit.copy_of_shot("changed")
    scene = kit.build_scene(render_to=shot)
    frames.denoise(scene)
    for name, value, reason in (
        ("window", "1", "the Window changed"),
        ("use_light_passes", True, "Light Passes changed"),
        ("keep_noisy", True, "Keep Noisy Image changed"),
        ("second_pass", True, "Second Pass changed"),
    ):
        before = getattr(scene.hush, name)
        setattr(scene.hush, name, value)
        assert told(scene) == f"0 of 5 frames denoised, 5 are out of date: {reason}"
        setattr(scene.hush, name, before)
    # Frame 1 rendered again: it and those that it helps are out of date.
    kit.rewrite(shot / "frame_0001.exr", lambda name, pixels: pixels * 2 if ".Combined." in name else pixels)
    text = told(scene)
    assert text.startswith("2 of 5 frames denoised, 3 are out of date: "), text
    assert "the render changed" in text and "a frame beside it changed" in text
    (shot / "denoised" / "frame_0005.exr").unlink()
    assert told(scene).startswith("1 of 5 frames denoised, 3 are out of date: ") and told(scene).endswith(", 1 to do")
    (shot / "frame_0005.exr").unlink()
    assert told(scene).endswith(", 1 is not rendered"), told(scene)


def test_status_after_a_run_that_was_stopped() -> None:
    import hush

    shot = kit.copy_of_shot("stopped")
    scene = kit.build_scene(render_to=shot)
    frames.denoise(scene)
    assert told(scene) == "5 of 5 frames denoised"
    scene.hush.lam = 8.0
    (arguments,) = kit.module("shot").sequences(scene)
    written: list[int] = []

    def count(event: dict) -> None:
        if event["event"] == "frame":
            written.append(event["frame"])

    stopped = hush.denoise_sequence(**arguments, progress=count, cancel=lambda: len(written) >= 2)
    assert stopped["interrupted"] and 2 <= len(written) < 5, (stopped, written)
    left = 5 - len(written)
    text = told(scene)
    assert text.startswith(f"{len(written)} of 5 frames denoised, {left} {'is' if left == 1 else 'are'} out of date: "), text
    frames.denoise(scene)
    assert told(scene) == "5 of 5 frames denoised"


def test_status_without_frames_or_with_a_bad_manifest() -> None:
    empty = kit.folder("empty")
    scene = kit.build_scene(render_to=empty)
    assert told(scene) == f"no rendered frames in {empty}: press Render Animation"
    scene.render.filepath = str(empty / "not" / "there" / "frame_####")
    assert told(scene) == f"no rendered frames in {empty / 'not' / 'there'}: press Render Animation"
    shot = kit.copy_of_shot("bad")
    scene.render.filepath = str(shot / "frame_####")
    frames.denoise(scene, [1])
    for text in (
        "",
        "{",
        "[]",
        '{"frames": {"frame_0001.exr": 7}, "settings": {}}',
        '{"frames": {"frame_0001.exr": {"settings": []}}, "settings": 3}',
    ):
        (shot / "denoised" / "hush-manifest.json").write_text(text)
        assert not told(scene).startswith("1 of 5"), (text, told(scene))


def test_files_of_another_scene_are_asked_for_as_they_are_denoised() -> None:
    """View layers that the files lack are left out, as Denoise Shot leaves them out."""
    import hush

    shot = kit.copy_of_shot("renamed")
    scene = kit.build_scene(render_to=shot)
    scene.view_layers[0].name = "Another Name"
    hush.denoise_sequence(str(shot / "frame_####.exr"), str(shot / "denoised"))
    assert told(scene) == "5 of 5 frames denoised"


def test_a_range_without_frames() -> None:
    scene = kit.build_scene(render_to=kit.copy_of_shot("range"))
    scene.frame_start, scene.frame_end = 5, 5
    assert "not denoised yet" in told(scene)
    assert kit.module("status").shot_status(scene).total == 1


def test_numbers_and_capitals_of_names() -> None:
    """As the library reads them: a minus is a sign only where no word is before it."""
    shot, scene = kit.module("shot"), kit.build_scene()
    for name, pattern, frame in (
        ("shot-0007.exr", "shot-####.exr", 7),
        ("shot_-0007.exr", "shot_####.exr", -7),
        ("-0007.exr", "####.exr", -7),
        ("a1-7.exr", "a1-#.exr", 7),
        ("SHOT_0007_L.EXR", "SHOT_####_L.EXR", 7),
    ):
        folder = kit.folder("numbers")
        (folder / name).write_bytes(b"x")
        scene.hush.input_folder = str(folder)
        shot._sequences.clear()
        assert shot.frame_pattern(scene) == folder / pattern, name
        assert shot.frame_file(shot.frame_pattern(scene), frame) == folder / name
        assert kit.module("denoising.denoise")._named(str(folder / name)) == [(folder / pattern, [frame])], name
        assert shot.example(folder) == folder / name


def test_what_blender_fills_in_has_no_frame_number() -> None:
    if bpy.app.version < (5, 0):
        return
    shot, scene = kit.module("shot"), kit.build_scene()
    for path, name in (
        ("/x/{resolution_x:######}_", "000096_####.exr"),
        ("/x/{resolution_x:##}_###", "96_###.exr"),
        ("/x/{fps}_", "24.0_####.exr"),
    ):
        scene.render.filepath = path
        assert shot.frame_pattern(scene) == Path("/x", name), shot.frame_pattern(scene)


def test_folders_may_be_beside_the_file() -> None:
    """Also where Blender wants to be told so."""
    if "is_path_supports_blend_relative" not in bpy.types.Property.bl_rna.properties:
        return
    hush = kit.build_scene().hush.bl_rna.properties
    operator = bpy.ops.hush.denoise_shot.get_rna_type().properties
    paths = [each for each in (*hush, *operator) if each.type == "STRING" and each.subtype in ("DIR_PATH", "FILE_PATH")]
    assert len(paths) == 6, [each.identifier for each in paths]
    assert all(each.is_path_supports_blend_relative for each in paths), [each.identifier for each in paths]

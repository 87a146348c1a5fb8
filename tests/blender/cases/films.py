"""An output that is set to a film, or has no file extensions: the frames are found, or it is said what to do."""

from __future__ import annotations

import bpy
import kit

compat, check, prepare, shot = (kit.module(name) for name in ("compat", "checks.check", "prepare", "shot"))
IMAGE = "ViewLayer.Combined"


def as_film(scene: bpy.types.Scene) -> None:
    settings = scene.render.image_settings
    if hasattr(settings, "media_type"):
        settings.media_type = "VIDEO"
    settings.file_format = "FFMPEG"


def errors(scene: bpy.types.Scene) -> dict[str, str]:
    return {each.key: each.text for each in check.problems(scene, fresh=True) if each.level == check.ERROR}


def test_frames_are_found_after_the_output_became_a_film() -> None:
    folder = kit.copy_of_shot("film")
    scene = kit.build_scene("plain", folder)
    as_film(scene)
    assert shot.frame_pattern(scene) == folder / "frame_####.exr"
    assert set(errors(scene)) == {"format"} and "Prepare Shot" in errors(scene)["format"], errors(scene)
    assert bpy.ops.hush.denoise_shot() == {"FINISHED"}
    assert len(kit.files(folder / "denoised")) >= 5
    assert bpy.ops.hush.preview_frame() == {"FINISHED"}


def test_the_pattern_of_a_film_is_that_of_its_frames() -> None:
    """What Hush makes of a film's path is what Blender makes of it once the output is EXR again."""
    for name in ("frame_", "frame_###", "take 0001-0005 ##", "film.mkv", "v0001-0005_", "a.b####c"):
        scene = kit.build_scene()
        scene.render.filepath = f"/tmp/somewhere/{name}"
        expected = shot.frame_pattern(scene)
        as_film(scene)
        assert shot.frame_pattern(scene) == expected, name


def test_without_file_extensions_it_is_said_and_mended() -> None:
    folder = kit.folder("bare")
    scene = kit.build_scene("plain", folder)
    scene.frame_end = 1
    assert "file_extension" not in errors(scene)
    scene.render.use_file_extension = False
    assert "Prepare Shot" in errors(scene)["file_extension"]
    assert bpy.ops.hush.fix(key="file_extension") == {"FINISHED"} and scene.render.use_file_extension
    assert bpy.ops.hush.undo_prepare() == {"FINISHED"} and not scene.render.use_file_extension
    assert bpy.ops.hush.whole_shot() == {"FINISHED"}
    assert "frame_0001.exr" in kit.files(folder) and "frame_0001.exr" in kit.files(folder / "denoised")


def test_an_extension_written_by_hand_is_left() -> None:
    folder = kit.folder("by-hand")
    scene = kit.build_scene("plain", folder)
    scene.frame_end = 1
    scene.render.filepath, scene.render.use_file_extension = str(folder / "frame_####.exr"), False
    assert "file_extension" not in errors(scene)
    assert bpy.ops.hush.whole_shot() == {"FINISHED"} and not scene.render.use_file_extension
    assert "frame_0001.exr" in kit.files(folder / "denoised")

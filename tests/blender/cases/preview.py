"""Denoise This Frame: the image is right, in every view and region, and nothing of it stays in the file."""

from __future__ import annotations

import shutil
import tempfile
from pathlib import Path

import bpy
import kit
import numpy as np

preview = kit.module("preview.preview")
display = kit.module("preview.display")
NAME = "Hush Preview"
TIME_LIMIT = 400.0


def fingerprint() -> dict[str, list]:
    """All that is in the file: names, users and fake users, custom properties, and which images the Image Editors show."""
    found = {}
    for prop in bpy.data.bl_rna.properties:
        if prop.type == "COLLECTION":
            blocks = getattr(bpy.data, prop.identifier)
            found[prop.identifier] = sorted((b.name_full, b.users, b.use_fake_user, tuple(sorted(b.keys()))) for b in blocks)
    found["editors"] = [space.image.name_full if space.image else "" for space in display.editors()]
    return found


def assert_same(after: dict[str, list], before: dict[str, list]) -> None:
    differing = {kind: (before.get(kind), after.get(kind)) for kind in {*before, *after} if before.get(kind) != after.get(kind)}
    assert not differing, differing


def shot_scene(name: str, kind: str = "plain", frame: int = 3) -> tuple[bpy.types.Scene, Path]:
    """A scene at a frame, and the folder with its rendered frames."""
    frames = kit.copy_of_shot(name, kind)
    scene = kit.build_scene(kind, frames)
    scene.frame_set(frame)
    # Blender 4 makes room for the scene's settings when they are first read, as the panel does.
    assert scene.hush.lam == 1.0
    preview._view.update(view=0, wipe=0.5)
    return scene, frames


def image_editor() -> tuple[bpy.types.SpaceImageEditor, dict]:
    """An Image Editor of the start-up file's, and the context of one who is in it."""
    for screen in bpy.data.screens:
        for area in screen.areas:
            if area.type == "IMAGE_EDITOR":
                return area.spaces.active, {"screen": screen, "area": area}
    raise AssertionError("no Image Editor")


def preview_in(context: dict, **arguments: object) -> None:
    with bpy.context.temp_override(**context):
        assert bpy.ops.hush.preview_frame(**arguments) == {"FINISHED"}


def pixels() -> np.ndarray:
    """Of the preview's image, (height, width, 4), rows from the top."""
    image = bpy.data.images[NAME]
    flat = np.empty(image.size[0] * image.size[1] * 4, np.float32)
    image.pixels.foreach_get(flat)
    return flat.reshape(image.size[1], image.size[0], 4)[::-1]


def folders() -> set[Path]:
    """The previews' temporary folders."""
    return set(Path(tempfile.gettempdir()).glob("hush-preview-*"))


def expected(frames: Path, frame: int = 3, **settings: object) -> dict:
    import hush

    return hush.preview(frames, frame, **settings)


def test_the_frame_is_shown_and_leaves_no_trace() -> None:
    scene, frames = shot_scene("trace")
    editor, here = image_editor()
    editor.image = bpy.data.images.new("Mine", 8, 8)
    before, files, dirty = fingerprint(), kit.files(frames), folders()
    preview_in(here)
    image = bpy.data.images[NAME]
    assert tuple(image.size) == (96, 54) and not image.use_fake_user and image.packed_file is None and not image.is_dirty
    want = expected(frames)
    assert want["neighbours"] == [1, 2, 4, 5]
    made = pixels()
    kit.assert_close(made[:, :48, :3], kit.layer(frames / "frame_0003.exr", "Combined")[:, :48], 1e-6, "left: as rendered")
    kit.assert_close(made[:, 48:, :3], want["denoised"][:, 48:, :3], 1e-6, "right: denoised")
    kit.assert_differs(made[:, 48:, :3], want["noisy"][:, 48:, :3], 0.01, "denoised")
    assert editor.image == image
    assert kit.files(frames) == files, "something was written beside the frames"
    assert bpy.ops.hush.end_preview() == {"FINISHED"}
    assert_same(fingerprint(), before)
    assert folders() == dirty, "temporary files are left"
    assert bpy.ops.hush.end_preview() == {"CANCELLED"}
    assert scene.hush.output_folder == ""


def test_views_and_wipe() -> None:
    _, frames = shot_scene("views")
    assert bpy.ops.hush.preview_frame(flicker=True) == {"FINISHED"}
    manager = bpy.context.window_manager
    assert manager.hush_preview_view == "FLICKER"
    want = expected(frames, flicker=True)
    assert want["change"] < 0.9 * np.nanmean(want["noisy_flicker"])
    maps = [want["noisy_flicker"], want["flicker"]]
    level = np.concatenate([maps[0][:, :48], maps[1][:, 48:]], axis=1)
    seen = np.isfinite(level)
    made = pixels()
    assert not bpy.data.images[NAME].use_view_as_render, "a map is no light"
    kit.assert_close(made[..., 0][seen], np.clip(level[seen] / 0.25, 0, 1) ** 2.2, 1e-5, "change")
    assert (made[~seen] == np.float32([0.0, 0.02, 0.15, 1.0])).all()
    for view, image in (("NOISY", want["noisy"]), ("DENOISED", want["denoised"])):
        manager.hush_preview_view = view
        kit.assert_close(pixels()[..., :3], image[..., :3], 1e-6, view)
        assert bpy.data.images[NAME].use_view_as_render, "it is to look as the render does"
    manager.hush_preview_view = "WIPE"
    manager.hush_preview_wipe = 0.25
    both = np.concatenate([want["noisy"][:, :24, :3], want["denoised"][:, 24:, :3]], axis=1)
    kit.assert_close(pixels()[..., :3], both, 1e-6, "wipe")
    assert not bpy.data.images[NAME].is_dirty
    bpy.ops.hush.end_preview()


def test_the_scene_decides() -> None:
    scene, frames = shot_scene("settings", frame=2)
    scene.hush.lam, scene.hush.window = 16.0, "0"
    assert bpy.ops.hush.preview_frame() == {"FINISHED"}
    told = display.current().result
    assert (told["frame"], told["lam"], told["window"], told["neighbours"]) == (2, 16.0, 0, [])
    kit.assert_close(pixels()[:, 48:, :3], expected(frames, 2, lam=16, window=0)["denoised"][:, 48:, :3], 1e-6)
    for frame, value in ((1, 2.0), (5, 10.0)):
        scene.hush.lam = value
        scene.keyframe_insert("hush.lam", frame=frame)
    scene.frame_set(5)
    assert bpy.ops.hush.preview_frame() == {"FINISHED"}
    assert display.current().result["lam"] == 10.0
    assert [image.name for image in bpy.data.images if "Hush" in image.name] == [NAME], "the second takes the place of the first"
    bpy.ops.hush.end_preview()


def test_the_render_region_alone_is_denoised() -> None:
    scene, frames = shot_scene("border")
    render = scene.render
    render.use_border = True
    render.border_min_x, render.border_max_x, render.border_min_y, render.border_max_y = 0.25, 0.75, 0.0, 0.5
    assert bpy.ops.hush.preview_frame() == {"FINISHED"}
    assert tuple(bpy.data.images[NAME].size) == (48, 27)
    preview._view["view"] = 1
    preview._refresh()
    whole = expected(frames)["denoised"][27:, 24:72, :3]
    assert np.max(np.abs(pixels()[..., :3] - whole) / (whole + 0.01)) < 1e-3
    bpy.ops.hush.end_preview()


def test_it_is_not_saved() -> None:
    scene, _ = shot_scene("saved")
    editor, here = image_editor()
    mine = editor.image = bpy.data.images.new("Mine", 8, 8)
    preview_in(here)
    path = kit.folder("blend") / "shot.blend"
    for copy in (True, False):
        bpy.ops.wm.save_as_mainfile(filepath=str(path), copy=copy)
        # Blender does not look into the open file as a library.
        with bpy.data.libraries.load(str(shutil.copy(path, path.with_name("copy.blend")))) as (there, _):
            assert list(there.images) == ["Mine"], there.images
        assert editor.image == bpy.data.images[NAME], "after saving it is still seen"
    bpy.ops.hush.end_preview()
    assert editor.image == mine
    said = kit.blender(
        "import sys; bpy.ops.wm.open_mainfile(filepath=sys.argv[1]); "
        "print('IMAGES', [i.name for i in bpy.data.images], list(bpy.context.window_manager.keys()))",
        path,
    )
    assert "IMAGES ['Mine'] []" in said, said
    assert scene.hush.lam == 1.0


def test_another_file_ends_it() -> None:
    before = folders()
    shot_scene("other")
    assert bpy.ops.hush.preview_frame() == {"FINISHED"}
    assert folders() - before
    bpy.ops.wm.read_homefile(use_empty=True)
    assert display.current() is None and NAME not in bpy.data.images
    assert folders() == before


def test_what_is_odd_is_said() -> None:
    shot_scene("bare", "bare")
    assert bpy.ops.hush.preview_frame() == {"FINISHED"}
    told = display.current().result
    said = " ".join(preview.notes(told))
    assert "Vector" in said and "--" not in said, said
    assert told["neighbours"] == [] and "by itself" in preview.in_words(told)
    bpy.ops.hush.end_preview()
    # With motion blur the layer's own vectors are zero; the scene says where others are.
    scene, _ = shot_scene("blur", "blur")
    scene.hush.vector_layer = "Vectors"
    assert bpy.ops.hush.preview_frame() == {"FINISHED"}
    assert display.current().result["neighbours"] == [1, 2, 4, 5]
    bpy.ops.hush.end_preview()


def test_what_cannot_be_is_refused() -> None:
    scene, frames = shot_scene("refused", frame=4)
    before, temporary = fingerprint(), folders()
    (frames / "frame_0004.exr").write_bytes((frames / "frame_0004.exr").read_bytes()[:2000])
    kit.refused(bpy.ops.hush.preview_frame, "frame_0004.exr")
    (frames / "frame_0004.exr").unlink()
    kit.refused(bpy.ops.hush.preview_frame, "Frame 4 is not rendered")
    assert_same(fingerprint(), before)
    assert folders() == temporary, (folders(), temporary)
    assert preview._running is None
    scene.frame_set(3)
    assert bpy.ops.hush.preview_frame() == {"FINISHED"}
    assert display.current().result["neighbours"] == [1, 2]
    # One that fails leaves the one that is shown.
    scene.frame_set(4)
    kit.refused(bpy.ops.hush.preview_frame, "Frame 4 is not rendered")
    assert NAME in bpy.data.images
    bpy.ops.hush.end_preview()
    # Rendering again as the scene is set would not help.
    kit.module("compat").use_image_format(scene.render.image_settings, "PNG")
    kit.refused(bpy.ops.hush.preview_frame, "The output is PNG:", "Press Prepare Shot. Frame 4 is not rendered")


def test_a_missing_image_is_no_trouble() -> None:
    _, _ = shot_scene("removed")
    editor, here = image_editor()
    preview_in(here)
    bpy.data.images.remove(bpy.data.images[NAME])
    bpy.context.window_manager.hush_preview_wipe = 0.75
    preview_in(here)
    assert editor.image == bpy.data.images[NAME]
    bpy.data.images[NAME].name = "Renamed"
    bpy.ops.hush.end_preview()
    assert "Renamed" not in bpy.data.images and display.current() is None


def test_undo_brings_back_what_the_editor_showed() -> None:
    shot_scene("undone")
    editor, here = image_editor()
    mine = bpy.data.images.new("Mine", 8, 8)
    mine.use_fake_user = True
    editor.image = mine
    bpy.ops.ed.undo_push(message="before")
    bpy.ops.mesh.primitive_cube_add()
    bpy.ops.ed.undo_push(message="a cube")
    before = folders()
    preview_in(here)
    assert editor.image == bpy.data.images[NAME] and folders() != before
    assert bpy.ops.ed.undo() == {"FINISHED"}
    editor, _ = image_editor()
    assert editor.image is not None and editor.image.name == "Mine", editor.image
    assert NAME not in bpy.data.images and display.current() is None and folders() == before
    assert bpy.ops.ed.redo() == {"FINISHED"}
    assert NAME not in bpy.data.images


def test_a_colour_configuration_without_the_name() -> None:
    """As a studio's in Blender 4.2: the image is shown without a conversion, and one press leaves one image."""
    shot_scene("studio")
    _, here = image_editor()
    compat = kit.module("compat")
    real, compat.working_space = compat.working_space, lambda: "No Such Space"
    try:
        for _ in range(2):
            preview_in(here)
            assert [image.name for image in bpy.data.images].count(NAME) == 1 and display.image() is not None
    finally:
        compat.working_space = real
    assert bpy.data.images[NAME].colorspace_settings.is_data
    bpy.ops.hush.end_preview()
    assert not [image for image in bpy.data.images if image.name.startswith(NAME)]


def test_switching_the_extension_off_ends_it() -> None:
    global preview, display
    shot_scene("off")
    editor, here = image_editor()
    before = folders()
    preview_in(here)
    assert editor.image is not None
    kit.disable()
    assert NAME not in bpy.data.images and editor.image is None
    assert folders() == before
    kit.enable()
    preview = kit.module("preview.preview")
    display = kit.module("preview.display")


def test_files_in_another_colour_space() -> None:
    """The preview has the pixels of the file, and so their space."""
    scene, _ = shot_scene("space")
    settings = scene.render.image_settings
    settings.color_management, settings.linear_colorspace_settings.name = "OVERRIDE", "ACEScg"
    _, here = image_editor()
    preview_in(here)
    assert bpy.data.images[NAME].colorspace_settings.name == "ACEScg"
    preview._set_view("wipe", 0.25)
    assert bpy.data.images[NAME].colorspace_settings.name == "ACEScg"
    bpy.ops.hush.end_preview()

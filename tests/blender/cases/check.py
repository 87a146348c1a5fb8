"""Check Shot finds what is not right, says it in words, and its fixes take it away."""

from __future__ import annotations

import wave
from pathlib import Path

import bpy
import kit

try:
    import aud
except ImportError:
    aud = None

check = kit.module("checks.check")


def found(scene: bpy.types.Scene) -> dict[str, str]:
    """Keys and texts of the problems."""
    return {problem.key: problem.text for problem in check.problems(scene, fresh=True)}


def shot_scene(name: str = "frames", kind: str = "plain") -> tuple[bpy.types.Scene, Path]:
    """A scene and the folder with its rendered frames."""
    frames = kit.copy_of_shot(name, kind)
    return kit.build_scene(kind, frames), frames


def test_a_good_shot_has_no_problems() -> None:
    scene, _ = shot_scene()
    assert found(scene) == {}
    assert bpy.ops.hush.check_shot() == {"FINISHED"}


def test_what_a_fix_takes_away() -> None:
    def multilayer_half(scene: bpy.types.Scene) -> None:
        scene.render.image_settings.color_depth = "16"

    def lossy(scene: bpy.types.Scene) -> None:
        scene.render.image_settings.exr_codec = "DWAA"

    def png(scene: bpy.types.Scene) -> None:
        if hasattr(scene.render.image_settings, "media_type"):
            scene.render.image_settings.media_type = "IMAGE"
        scene.render.image_settings.file_format = "PNG"

    def single(scene: bpy.types.Scene) -> None:
        kit.module("compat").use_image_format(scene.render.image_settings, "OPEN_EXR")

    def sequence(scene: bpy.types.Scene) -> None:
        editor = scene.sequence_editor_create()
        strips = editor.strips if hasattr(editor, "strips") else editor.sequences
        key = "length" if hasattr(editor, "strips") and bpy.app.version >= (5, 0) else "frame_end"
        strips.new_effect(name="Red", type="COLOR", channel=1, frame_start=1, **{key: 5})

    cases = {
        "engine": (lambda s: setattr(s.render, "engine", "BLENDER_WORKBENCH"), "The render engine is Workbench;"),
        "camera": (lambda s: setattr(s, "camera", None), "camera"),
        "passes": (lambda s: setattr(s.view_layers[0], "use_pass_vector", False), "Vector"),
        "seed": (lambda s: setattr(s.cycles, "use_animated_seed", False), "seed"),
        "denoising": (lambda s: setattr(s.cycles, "use_denoising", True), "Cycles denoises"),
        "overwrite": (lambda s: setattr(s.render, "use_overwrite", False), "Overwrite"),
        "placeholders": (lambda s: setattr(s.render, "use_placeholder", True), "Placeholders"),
        "sequencer": (sequence, "Sequencer"),
        "frame_step": (lambda s: setattr(s, "frame_step", 2), "neighbours cannot help"),
    }
    formats = {"The output is PNG:": png, "The output is OpenEXR:": single, "DWAA": lossy, "16 bit": multilayer_half}
    for key, spoil, words in [(k, *v) for k, v in cases.items()] + [("format", v, k) for k, v in formats.items()]:
        scene, _ = shot_scene()
        spoil(scene)
        told = found(scene)
        assert key in told and words in told[key], f"{key}: {told}"
        problem = next(each for each in check.problems(scene) if each.key == key)
        operator, arguments = problem.fix
        assert operator == "hush.fix"
        assert bpy.ops.hush.fix(**arguments) == {"FINISHED"}
        assert key not in found(scene), f"{key} is there after its fix"


def test_motion_blur_without_a_layer_for_the_vectors() -> None:
    scene, _ = shot_scene("blurred", "blur")
    assert "motion_blur" in found(scene)
    bpy.ops.hush.fix(key="motion_blur")
    assert scene.hush.vector_layer == "Vectors"
    assert found(scene) == {}
    scene.view_layers["Vectors"].use = False
    assert "vector_pass" in found(scene)
    bpy.ops.hush.fix(key="vector_pass")
    assert "vector_pass" not in found(scene)


def test_fixes_are_undone_with_prepare() -> None:
    scene, _ = shot_scene()
    scene.cycles.use_animated_seed = False
    bpy.ops.hush.fix(key="seed")
    bpy.ops.hush.undo_prepare()
    assert not scene.cycles.use_animated_seed


def test_frames_that_are_missing() -> None:
    scene, frames = shot_scene()
    scene.frame_end = 9
    (frames / "frame_0003.exr").unlink()
    (frames / "frame_0005.exr").write_bytes(b"")
    assert found(scene)["frames"] == "Frames 3, 5-9 are not rendered: press Render Animation"
    scene.frame_end = 4
    assert found(scene)["frames"] == "Frame 3 is not rendered: press Render Animation"
    for path in frames.glob("*.exr"):
        path.unlink()
    assert "not rendered yet" in found(scene)["frames"]


def test_frames_of_an_earlier_render() -> None:
    scene, _ = shot_scene("bare", "bare")
    layer = scene.view_layers[0]
    layer.use_pass_vector = layer.use_pass_z = layer.cycles.denoising_store_passes = True
    text = found(scene)["older"]
    assert "Vector" in text and "Render Animation" in text, text
    scene, _ = shot_scene()
    scene.render.resolution_x = 100
    assert "96 × 54" in found(scene)["older"]
    scene, _ = shot_scene()
    scene.view_layers[0].name = "Renamed"
    assert "Renamed" in found(scene)["older"]


def test_a_damaged_first_frame() -> None:
    scene, frames = shot_scene()
    (frames / "frame_0001.exr").write_bytes(b"not an image")
    assert "frame_0001.exr" in found(scene)["first_frame"]


def test_folders_that_cannot_be_used() -> None:
    scene, frames = shot_scene()
    scene.hush.output_folder = str(frames)
    assert "replace" in found(scene)["folder"]
    scene.hush.output_folder = str(frames / "frame_0001.exr" / "denoised")
    assert "is a file" in found(scene)["folder"]
    scene.hush.output_folder = "/proc/denoised"
    assert "Nothing can be written" in found(scene)["folder"]
    scene.hush.output_folder = "//denoised"
    assert "not saved" in found(scene)["save"]
    try:
        bpy.ops.hush.check_shot()
    except RuntimeError as error:
        assert "not saved" in str(error)
    else:
        raise AssertionError("no error was reported")


def test_frames_that_are_all_there_may_lie_where_nothing_can_be_written() -> None:
    """As on a server that only the farm writes to; frames that are still to be rendered may not."""
    scene, frames = shot_scene("read-only")
    scene.hush.output_folder = str(kit.folder("read-only-elsewhere"))
    files, whole_shot = kit.module("checks.files"), kit.module("denoising.whole_shot")
    closed = lambda folder, **_: f"{folder} is closed" if folder == frames else None
    real, files.why_not_writable, check.why_not_writable = files.why_not_writable, closed, closed
    try:
        assert found(scene) == {}
        kit.refused(bpy.ops.hush.whole_shot, "is closed", render_again=True)
        (frames / "frame_0003.exr").unlink()
        assert "is closed" in found(scene)["render_folder"]
        assert len(kit.module("denoising.denoise").runs(scene)) == 1
        kit.refused(bpy.ops.hush.whole_shot, "is closed")
    finally:
        files.why_not_writable = check.why_not_writable = real
    assert whole_shot.to_render(scene) == [3]


def test_a_place_that_cannot_be_written_to_says_where_it_is_chosen() -> None:
    scene, _ = shot_scene()
    blocked = kit.folder("blocked") / "file"
    blocked.write_text("")
    scene.hush.output_folder = str(blocked)
    assert "under Folders" in found(scene)["folder"]
    scene.hush.output_folder, scene.render.filepath = str(kit.folder("blocked-elsewhere")), str(blocked / "frame_####")
    assert "Output › Output Path" in found(scene)["render_folder"]


def test_lambda_that_leaves_its_range() -> None:
    scene, _ = shot_scene()
    for frame, value in ((1, 40.0), (3, 64.0), (5, 40.0)):
        scene.hush.lam = value
        scene.keyframe_insert("hush.lam", frame=frame)
    curve = next(iter(kit.module("compat").fcurves(scene)))
    for point in curve.keyframe_points:
        point.co.y *= 2
    curve.update()
    assert "80 at frame 1" in found(scene)["lambda"]
    scene.animation_data_clear()
    scene.driver_add("hush.lam").driver.expression = "frame"
    assert "a driver" in found(scene)["lambda"]


def test_a_mask_of_lambda_wants_its_aov() -> None:
    scene, _ = shot_scene()
    assert "lambda_mask" not in found(scene)
    scene.hush.lambda_pass = "Hush Lambda"
    told = found(scene)["lambda_mask"]
    assert "no shader AOV Hush Lambda" in told and "Shader AOV" in told and scene.view_layers[0].name in told, told
    aov = scene.view_layers[0].aovs.add()
    aov.name, aov.type = "Hush Lambda", "VALUE"
    assert "lambda_mask" not in found(scene)
    scene.hush.lambda_images = "//masks/mask_####.exr"
    assert "not looked at" in found(scene)["lambda_mask"]


def test_the_disk_is_not_asked_all_the_time() -> None:
    scene, frames = shot_scene()
    assert found(scene) == {}
    (frames / "frame_0003.exr").unlink()
    assert check.problems(scene) == [], "the disk was asked again at once"
    assert "frames" in found(scene)


def test_a_full_disk_is_foreseen() -> None:
    scene, _ = shot_scene()
    shutil = kit.module("checks.files").shutil
    real = shutil.disk_usage
    shutil.disk_usage = lambda path: real(path)._replace(free=1000)
    try:
        assert "1 kB are free" in found(scene)["space"]
    finally:
        shutil.disk_usage = real
    assert "space" not in found(scene)


def test_two_scenes_that_render_to_the_same_files() -> None:
    one, _ = shot_scene()
    two = one.copy()
    two.name = "Other"
    for scene in (one, two):
        (problem,) = (each for each in check.problems(scene, fresh=True) if each.key == "same_files")
        assert problem.level == check.ERROR and one.name in problem.text and "Other" in problem.text, problem
        assert "frame_####.exr" in problem.text
    two.render.filepath = str(kit.folder("another") / "frame_####")
    assert "same_files" not in found(one)
    # A scene that renders nothing takes no files.
    two.render.filepath = one.render.filepath
    two.camera = None
    assert "same_files" not in found(one)


def test_a_linked_scene_of_the_same_files_is_no_matter() -> None:
    """It is rendered in its own file."""
    one, _ = shot_scene()
    library = kit.folder("library") / "library.blend"
    bpy.data.libraries.write(str(library), {one})
    with bpy.data.libraries.load(str(library), link=True) as (_, into):
        into.scenes = [one.name]
    assert len(bpy.data.scenes) == 2 and "same_files" not in found(one)


def test_strips_that_are_not_seen_are_no_matter() -> None:
    scene, folder = shot_scene()
    sound = folder / "voice.wav"
    with wave.open(str(sound), "wb") as file:
        file.setnchannels(1)
        file.setsampwidth(2)
        file.setframerate(8000)
        file.writeframes(b"\0\0" * 8000)
    editor = scene.sequence_editor_create()
    strips = editor.strips if hasattr(editor, "strips") else editor.sequences
    # Blender 4.2 as a module of Python is built without sound.
    if aud is not None:
        strips.new_sound("Voice", str(sound), 1, 1)
    assert "sequencer" not in found(scene)
    length = "length" if "length" in strips.bl_rna.functions["new_effect"].parameters else "frame_end"
    picture = strips.new_effect(name="Red", type="COLOR", channel=2, frame_start=1, **{length: 5})
    assert "sequencer" in found(scene)
    # As Blender renders them: 4.2 in place of the scene although they are muted.
    muted_count = bpy.app.version < (4, 5)
    picture.mute = True
    assert ("sequencer" in found(scene)) == muted_count
    picture.mute, editor.channels[2].mute = False, True
    assert ("sequencer" in found(scene)) == muted_count


def test_stereo_in_one_file() -> None:
    scene, _ = shot_scene()
    scene.render.use_multiview = True
    scene.render.image_settings.views_format = "MULTIVIEW"
    told = found(scene)
    assert ("stereo" in told) == (bpy.app.version >= (5, 0)), told
    scene.render.image_settings.views_format = "INDIVIDUAL"
    assert "stereo" not in found(scene)


def test_frames_out_of_date_are_listed_with_their_reasons() -> None:
    import hush

    scene, frames = shot_scene()
    assert "stale" not in found(scene)
    hush.denoise_sequence(**kit.module("shot").sequences(scene)[0])
    assert "stale" not in found(scene)
    kit.rewrite(frames / "frame_0001.exr", lambda name, pixels: pixels * 2 if ".Combined." in name else pixels)
    texts = [problem.text for problem in check.problems(scene, fresh=True) if problem.key == "stale"]
    assert "Frame 1 is out of date: the render changed. Press Denoise Shot" in texts, texts
    assert "Frames 2-3 are out of date: a frame beside it changed. Press Denoise Shot" in texts, texts
    scene.hush.lam = 9.0
    assert found(scene)["stale"] == "Frames 1-5 are out of date: λ Noise to Keep changed. Press Denoise Shot"


def test_a_view_layer_that_was_renamed_since() -> None:
    """The advice was to render the whole shot again."""
    scene, _ = shot_scene("renamed")
    scene.view_layers[0].name = "Beauty"
    told = found(scene)["older"]
    assert all(words in told for words in ("Beauty", "ViewLayer", "old name")), told


def test_one_view_layer_of_several_is_told() -> None:
    scene, _ = shot_scene("single")
    scene.render.use_single_layer = True
    assert "single_layer" not in found(scene), "there is one only"
    scene.view_layers.new("Second")
    assert "Render Single Layer" in found(scene)["single_layer"]
    assert bpy.ops.hush.fix(key="single_layer") == {"FINISHED"} and not scene.render.use_single_layer


def test_cameras_that_change_the_output_path() -> None:
    """Blender 5 fills in {camera_name}: with markers the frames of a shot go to several folders."""
    scene, _ = shot_scene("cameras")
    second = scene.camera.copy()
    scene.collection.objects.link(second)
    scene.timeline_markers.new("one", frame=1).camera = scene.camera
    later = scene.timeline_markers.new("two", frame=3)
    later.camera = second
    assert kit.module("shot").changes_camera(scene)
    if bpy.app.version >= (5, 0):
        folder = kit.folder("cameras-out")
        scene.render.filepath = str(folder / "{camera_name}" / "frame_####")
        assert "markers" in found(scene)["path"]
        kit.refused(bpy.ops.hush.whole_shot, "{camera_name}")
        assert kit.files(folder) == [], "nothing is rendered"
    later.frame = scene.frame_end + 1
    assert not kit.module("shot").changes_camera(scene) and "path" not in found(scene)


def test_a_missing_folder_is_told_in_words() -> None:
    scene, frames = shot_scene()
    scene.hush.input_folder = str(frames / "not" / "there")
    told = found(scene)
    assert "Errno" not in " ".join(told.values()), told
    assert "not rendered yet" in told["frames"] and str(frames / "not" / "there") in told["frames"]

"""Denoise Shot: the scene's frames or named ones, in a process of its own, stopped and continued, and refused where it must be."""

from __future__ import annotations

import json
import os
import shutil
import signal
import time
from pathlib import Path
from types import SimpleNamespace

import bpy
import kit
import numpy as np
from windows import Window, foreground

denoise = kit.module("denoising.denoise")
job = kit.module("jobs.job")
TIME_LIMIT = 900.0
NAMES = [f"frame_{frame:04d}.exr" for frame in kit.FRAMES]


def shot_scene(name: str = "shot", kind: str = "plain") -> tuple[bpy.types.Scene, Path]:
    """A scene and the folder with its rendered frames."""
    frames = kit.copy_of_shot(name, kind)
    return kit.build_scene(kind, frames), frames


def long_scene(name: str) -> tuple[bpy.types.Scene, Path, list[str]]:
    """The same with sixty frames, so that there is time to stop it, and the files' names."""
    frames = kit.folder(name)
    names = [f"frame_{frame:04d}.exr" for frame in range(1, 61)]
    for number, each in enumerate(names):
        shutil.copy(kit.shot() / NAMES[number % len(NAMES)], frames / each)
    scene = kit.build_scene("plain", frames)
    scene.frame_end = len(names)
    scene.render.threads = 1
    return scene, frames, names


def manifest(folder: Path) -> dict[str, dict]:
    """The entry of each file, with its settings in place of their key."""
    told = json.loads((folder / "hush-manifest.json").read_text(encoding="utf-8"))
    return {name: {**entry, "settings": told["settings"][entry["settings"]]} for name, entry in told["frames"].items()}


def helped(entry: dict) -> list[int]:
    """The neighbours that helped a frame."""
    return [each["frame"] for each in entry["neighbours"] if each["used"]]


def refused(*words: str, **arguments: object) -> None:
    """Denoise Shot must report an error with these words, and start nothing."""
    kit.refused(bpy.ops.hush.denoise_shot, *words, **arguments)
    assert job.current() is None


def images(folder: Path) -> list[str]:
    return [name for name in kit.files(folder) if name.endswith(".exr")]


def wait_for_frames(running: object, count: int) -> None:
    """Until so many frames are denoised."""
    seen = 0
    until = time.monotonic() + 60
    while seen < count:
        assert time.monotonic() < until, "no frame was finished in a minute"
        seen += sum(event["event"] == "frame" for event in running.poll())
        assert not running.ended, running.errors
        time.sleep(0.005)


def blurred_shot(name: str) -> tuple[bpy.types.Scene, Path]:
    """A scene with motion blur as Prepare Shot leaves it, its three frames rendered into the folder."""
    scene = kit.build_scene("blur", kit.folder(name))
    scene.view_layers.remove(scene.view_layers["Vectors"])
    assert bpy.ops.hush.prepare_shot() == {"FINISHED"}
    scene.frame_end = 3
    bpy.ops.render.render(animation=True)
    return scene, Path(scene.render.filepath).parent


def test_a_shot_is_denoised() -> None:
    scene, frames = shot_scene()
    before = {name: (frames / name).read_bytes() for name in NAMES}
    assert bpy.ops.hush.denoise_shot() == {"FINISHED"}
    assert images(frames / "denoised") == NAMES
    assert {name: (frames / name).read_bytes() for name in NAMES} == before
    for name in NAMES:
        noisy, made, clean = (kit.layer(folder / name, "Combined") for folder in (frames, frames / "denoised", kit.shot("clean")))
        assert np.abs(made - clean).mean() < 0.6 * np.abs(noisy - clean).mean(), f"{name} is not cleaner"
    entries = manifest(frames / "denoised")
    assert helped(entries["frame_0003.exr"]) == [1, 2, 4, 5]
    assert denoise.progress(scene) is None


def test_keyframes_of_lambda_reach_the_files() -> None:
    scene, frames = shot_scene()
    for frame, value in ((1, 2.0), (5, 10.0)):
        scene.hush.lam = value
        scene.keyframe_insert("hush.lam", frame=frame)
    compat = kit.module("compat")
    for curve in compat.fcurves(scene):
        for point in curve.keyframe_points:
            point.interpolation = "LINEAR"
    assert bpy.ops.hush.denoise_shot() == {"FINISHED"}
    entries = manifest(frames / "denoised")
    assert [round(entries[name]["settings"]["lambda"], 3) for name in NAMES] == [2, 4, 6, 8, 10]


def test_settings_reach_the_files() -> None:
    scene, frames = shot_scene()
    scene.hush.window, scene.hush.keep_noisy = "1", True
    scene.hush.output_folder = str(kit.folder("elsewhere"))
    scene.frame_start, scene.frame_end = 3, 4
    assert bpy.ops.hush.denoise_shot() == {"FINISHED"}
    folder = Path(scene.hush.output_folder)
    assert images(folder) == ["frame_0003.exr", "frame_0004.exr"]
    assert helped(manifest(folder)["frame_0004.exr"]) == [3, 5], "frames beside the range help"
    assert any("Noisy Image" in name for name in kit.channels(folder / "frame_0003.exr"))


def test_named_files_as_in_cycles() -> None:
    frames = kit.copy_of_shot("named")
    kit.build_scene("plain")
    ways = {
        "folder": (str(frames), "folder/", NAMES),
        "pattern": (str(frames / "frame_####.exr"), "pattern/frame_####.exr", NAMES),
        "beginning": (str(frames / "frame_"), "beginning", NAMES),
        "file": (str(frames / "frame_0002.exr"), "file", ["frame_0002.exr"]),
    }
    base = kit.folder("named-results")
    for source, target, expected in ways.values():
        assert bpy.ops.hush.denoise_shot(input_filepath=source, output_filepath=str(base / target)) == {"FINISHED"}
        assert images(base / target.split("/")[0]) == expected, (source, target)
    entry = manifest(base / "file")["frame_0002.exr"]
    assert helped(entry) == [1, 3, 4]
    assert bpy.ops.hush.denoise_shot(input_filepath=str(frames)) == {"FINISHED"}
    assert images(frames / "denoised") == NAMES


def test_names_and_folders_that_cannot_be() -> None:
    frames = kit.copy_of_shot("refused")
    kit.build_scene("plain", frames)
    for target in (str(frames), f"{frames}/", str(frames / "frame_####.exr")):
        refused("choose another folder", input_filepath=str(frames / "frame_####.exr"), output_filepath=target)
        refused("choose another folder", output_filepath=target)
    refused("keep the names", input_filepath=str(frames / "frame_0001.exr"), output_filepath=str(frames.parent / "out" / "clean_0001.exr"))
    refused("Nothing can be written", output_filepath="/proc/denoised")
    refused("is a file", output_filepath=str(frames / "frame_0001.exr" / "x"))
    refused("nowhere", input_filepath=str(frames / "nowhere" / "frame_####.exr"), output_filepath=str(frames.parent / "out"))
    assert kit.files(frames) == NAMES


def test_scenes_that_cannot_be() -> None:
    scene, frames = shot_scene("scenes")
    scene.render.engine = "BLENDER_WORKBENCH"
    refused("Cycles")
    scene.render.engine = "CYCLES"
    scene.hush.output_folder = "//denoised"
    refused("not saved")
    scene.hush.output_folder = ""
    refused("no scene Nowhere", scene="Nowhere")
    scene.render.filepath = str(kit.folder("empty") / "frame_####")
    refused("frame_####.exr")
    kit.module("compat").use_image_format(scene.render.image_settings, "PNG")
    refused(
        "The output is PNG: only OpenEXR MultiLayer keeps the passes. Press Prepare Shot. The shot is not rendered yet",
        "frame_####.exr: press Prepare Shot, then Render Animation",
    )
    scene.render.use_file_extension = False
    refused("File Extensions is off")
    assert kit.files(frames) == NAMES


def test_a_still_beside_the_frames_to_come_is_none_of_them() -> None:
    """As after F12 and Save As, with an output path that has no name for frames, which is Blender's own choice."""
    scene, frames = shot_scene("still")
    stills = kit.folder("stills")
    for name in ("Untitled.exr", ".exr", "sky_v2.exr"):
        shutil.copy(frames / NAMES[0], stills / name)
    for path in (f"{stills}/", str(stills / "sky_####")):
        scene.render.filepath = path
        refused("The shot is not rendered yet")


def test_missing_and_damaged_frames_are_an_error_but_the_rest_is_done() -> None:
    scene, frames = shot_scene("gaps")
    (frames / "frame_0004.exr").unlink()
    refused("Error: Frame 4 is not rendered: press Render Animation")
    assert images(frames / "denoised") == [name for name in NAMES if "4" not in name]
    shutil.copy(kit.shot() / "frame_0004.exr", frames)
    (frames / "frame_0005.exr").write_bytes((kit.shot() / "frame_0005.exr").read_bytes()[:20000])
    refused("frame_0005.exr")
    assert sorted(set(NAMES) - set(images(frames / "denoised"))) in ([], ["frame_0005.exr"])
    assert scene.hush.output_folder == ""


def test_stopped_half_way_and_continued() -> None:
    scene, frames, names = long_scene("stopped")
    running = denoise.start(scene)
    assert not bpy.ops.hush.denoise_shot.poll(), "a second run could be started"
    wait_for_frames(running, 2)
    assert denoise.progress(scene) is not None and 0 < running.fraction < 1
    scene.name = "Renamed while it runs"
    assert denoise.progress(scene) is not None
    assert denoise.progress(bpy.data.scenes.new("Scene")) is None
    running.cancel()
    kit.ended(running)
    assert denoise.outcome(running)[0] == "CANCELLED"
    assert "stopped" in denoise.outcome(running)[1][-1][1]
    made = images(frames / "denoised")
    assert 2 <= len(made) < len(names), made
    left = [name for name in kit.files(frames / "denoised") if name not in made]
    assert left == ["hush-manifest.json"], f"left behind: {left}"
    stamps = {name: (frames / "denoised" / name).stat().st_mtime_ns for name in made}
    for name in made:
        kit.layer(frames / "denoised" / name, "Combined")
    assert bpy.ops.hush.denoise_shot() == {"FINISHED"}
    assert images(frames / "denoised") == names
    assert {name: (frames / "denoised" / name).stat().st_mtime_ns for name in made} == stamps, "finished frames were made again"


def test_a_worker_that_is_killed_is_told() -> None:
    scene, frames, names = long_scene("killed")
    running = denoise.start(scene)
    wait_for_frames(running, 1)
    os.kill(running._process.pid, signal.SIGKILL)
    kit.ended(running)
    result, reports = denoise.outcome(running)
    assert result == "CANCELLED" and reports[-1][0] == "ERROR" and "killed" in reports[-1][1], reports
    assert bpy.ops.hush.denoise_shot() == {"FINISHED"}
    assert images(frames / "denoised") == names


def test_the_worker_ends_with_blender() -> None:
    _, frames, names = long_scene("orphan")
    blend = kit.folder("orphan-file") / "shot.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(blend))
    told = kit.blender(
        f"""
import importlib, os, sys, bpy
bpy.ops.wm.open_mainfile(filepath=sys.argv[1])
denoise = importlib.import_module("{kit.MODULE}.denoising.denoise")
running = denoise.start(bpy.data.scenes["Scene"])
print("worker", running._process.pid, flush=True)
os._exit(0)
""",
        blend,
    )
    worker = int(told.split("worker ")[1].split()[0])
    until = time.monotonic() + 20
    while Path(f"/proc/{worker}").exists() and "Z" not in Path(f"/proc/{worker}/stat").read_text(encoding="utf-8").split()[2]:
        assert time.monotonic() < until, "the worker goes on without Blender"
        time.sleep(0.1)
    assert len(images(frames / "denoised") if (frames / "denoised").exists() else []) < len(names), "it denoised the whole shot alone"


def test_switching_the_extension_off_stops_the_worker() -> None:
    scene, _, _ = long_scene("off")
    running = denoise.start(scene)
    kit.disable()
    assert running._process.poll() is not None
    kit.enable()


def test_motion_blur_takes_the_vectors_of_the_other_layer() -> None:
    _, frames = blurred_shot("blurred")
    moving = kit.layer(frames / "frame_0002.exr", "Hush Vectors.Vector", "XYZW")
    empty = kit.layer(frames / "frame_0002.exr", "ViewLayer.Vector", "XYZW")
    assert np.abs(moving).max() > 0.5 and np.abs(empty).max() == 0
    assert bpy.ops.hush.denoise_shot() == {"FINISHED"}
    entry = manifest(frames / "denoised")["frame_0002.exr"]
    assert entry["settings"]["vector_layer"] == "Hush Vectors"
    assert helped(entry) == [1, 3]
    noisy, made = (kit.channels(folder / "frame_0002.exr") for folder in (frames, frames / "denoised"))
    kit.assert_differs(made["ViewLayer.Combined.R"], noisy["ViewLayer.Combined.R"], 0.001)
    kit.assert_close(made["Hush Vectors.Combined.R"], noisy["Hush Vectors.Combined.R"], 0.0, "the layer of the vectors")


def test_after_undo_prepare_the_files_still_give_the_vectors() -> None:
    """Bug 5: the good frames were overwritten without motion vectors, as the scene had the layer no more."""
    scene, frames = blurred_shot("undone")
    assert bpy.ops.hush.denoise_shot() == {"FINISHED"}
    before = {name: (frames / "denoised" / name).stat().st_mtime_ns for name in images(frames / "denoised")}
    assert bpy.ops.hush.undo_prepare() == {"FINISHED"}
    assert "Hush Vectors" not in scene.view_layers
    assert bpy.ops.hush.denoise_shot() == {"FINISHED"}
    assert {name: (frames / "denoised" / name).stat().st_mtime_ns for name in before} == before, "frames were made again"
    assert bpy.ops.hush.denoise_shot(overwrite=True) == {"FINISHED"}
    entry = manifest(frames / "denoised")["frame_0002.exr"]
    assert entry["settings"]["vector_layer"] == "Hush Vectors" and helped(entry) == [1, 3]
    # A layer of that name without the record of Prepare Shot, as in a copy of the scene.
    scene.view_layers.new("Hush Vectors")
    settings, _ = kit.module("shot").settings(scene, frames / "frame_0001.exr")
    assert settings["layers"] == ["ViewLayer"] and settings["vector_layer"] == "Hush Vectors", settings


def test_what_is_left_is_told_from_the_first_frame_on() -> None:
    running = denoise.DenoiseJob.__new__(denoise.DenoiseJob)
    vars(running).update(fraction=0.0, text="", warnings=[], cancelled=False, _bad={}, _runs=2, _frames=1, _finished=0)
    vars(running).update(_in_frame=0.0, _todo=0, _here=0, _computed=0, _first=0.0, results=[], _said_the_end=False)
    take = lambda kind, run=0, **fields: running._take({"event": kind, "run": run, **fields})
    take("start", frames=5, todo=4)
    assert running.text == "Denoising 4 frames"
    take("frame", frame=1, status="skipped", finished=1, frames=5)
    take("working", frame=2)
    assert running.text == "Denoising frame 2" and running.fraction == 0.1
    running._first -= 60
    take("progress", frame=2, fraction=0.5)
    assert running.text == "Denoising frame 2, about 15 minutes left" and abs(running.fraction - 0.15) < 1e-9, running.text
    take("frame", frame=2, status="denoised", finished=2, frames=5)
    assert running.text == "Denoising frame 2, about 7 minutes left", running.text
    take("start", 1, frames=5, todo=4)
    take("working", 1, frame=1)
    assert running.text == "Denoising frame 1, about 4 minutes left" and running.fraction == 0.5, running.text
    assert job.left(20) == "less than a minute left" and job.left(60 * 61) == "about 1 hour 1 minute left"


def test_errors_name_fields_and_no_options_of_the_command_line() -> None:
    _, frames = shot_scene("words")
    (frames / "denoised").mkdir()
    shutil.copy(frames / NAMES[0], frames / "denoised")
    refused("Denoised Frames")
    scene = kit.build_scene("bare", kit.copy_of_shot("bare-words", "bare"))
    scene.hush.window = "2"
    try:
        bpy.ops.hush.denoise_shot()
    except RuntimeError as error:
        assert "--" not in str(error), error


def test_two_scenes() -> None:
    first, frames = shot_scene("first")
    other = first.copy()
    other.name = "Other"
    other.render.filepath = str(kit.copy_of_shot("other") / "frame_####")
    other.frame_end = 2
    assert bpy.ops.hush.denoise_shot(scene="Other") == {"FINISHED"}
    assert images(frames) == NAMES, "the open scene's frames were denoised"
    assert len(images(Path(other.render.filepath).parent / "denoised")) == 2


def test_views_with_files_of_their_own() -> None:
    frames = kit.folder("stereo")
    for name in NAMES[:2]:
        for view in ("_L", "_R"):
            shutil.copy(kit.shot() / name, frames / name.replace(".exr", f"{view}.exr"))
    scene = kit.build_scene("plain", frames)
    scene.render.use_multiview = True
    scene.render.image_settings.views_format = "INDIVIDUAL"
    scene.frame_end = 2
    assert bpy.ops.hush.denoise_shot() == {"FINISHED"}
    assert images(frames / "denoised") == [name.replace(".exr", f"{view}.exr") for name in NAMES[:2] for view in ("_L", "_R")]


def test_a_folder_with_odd_letters() -> None:
    frames = kit.folder("Käse [v2] 100% {x}")
    for name in NAMES[:2]:
        shutil.copy(kit.shot() / name, frames)
    scene = kit.build_scene("plain", frames)
    scene.hush.input_folder = str(frames)
    scene.render.filepath = "/tmp/frame_####"
    scene.frame_end = 2
    assert bpy.ops.hush.denoise_shot() == {"FINISHED"}
    assert images(frames / "denoised") == NAMES[:2]


def opened() -> tuple[Window, SimpleNamespace]:
    """A window, and Denoise Shot in it."""
    window = Window()
    return window, window.operator(denoise.HUSH_OT_denoise_shot, input_filepath="", output_filepath="", overwrite=False)


def press(fake: SimpleNamespace, window: Window, kind: str) -> set[str]:
    return fake.modal(window, SimpleNamespace(type=kind, value="PRESS"))


def ticks(fake: SimpleNamespace, window: Window) -> set[str]:
    """The timer, until the operator ends."""
    until = time.monotonic() + 60
    while (result := press(fake, window, "TIMER")) == {"PASS_THROUGH"}:
        assert time.monotonic() < until, "the operator does not end"
        time.sleep(0.01)
    return result


def test_in_a_window_progress_is_shown_and_events_pass() -> None:
    _, frames = shot_scene("window")
    window, fake = opened()
    assert fake._begin(window)
    assert press(fake, window, "MOUSEMOVE") == {"PASS_THROUGH"}
    assert ticks(fake, window) == {"FINISHED"}
    assert any("Denoising frame" in text and "%" in text and "Esc" in text for text in window.shown), window.shown
    assert window.removed and window.reports[-1][0] == "INFO" and "5 frames denoised" in window.reports[-1][1]
    assert images(frames / "denoised") == NAMES and job.current() is None


def test_in_a_window_esc_stops_after_the_frame_in_hand() -> None:
    _, frames, names = long_scene("esc")
    window, fake = opened()
    assert fake._begin(window)
    while not (frames / "denoised" / names[0]).exists():
        press(fake, window, "TIMER")
    background = kit.module("jobs.background")
    with foreground(background, rendering=True):
        # Esc is for the render then, which is none of Hush's.
        assert press(fake, window, "ESC") == {"PASS_THROUGH"} and not fake._job.cancelled
    assert press(fake, window, "ESC") == {"RUNNING_MODAL"}
    assert "Stopping" in window.shown[-1]
    assert ticks(fake, window) == {"CANCELLED"}
    assert "stopped" in window.reports[-1][1]
    assert len(images(frames / "denoised")) < len(names)


def test_opening_another_file_stops_it() -> None:
    long_scene("another")
    window, fake = opened()
    assert fake._begin(window)
    fake.cancel(window)
    assert job.current() is None and fake._job._process.poll() is not None


def mask(image: bpy.types.Image, marked: slice, path: Path) -> None:
    """Writes a mask of the shot's size: 1 in some columns, else 0."""
    pixels = np.zeros((image.size[1], image.size[0], 4), np.float32)
    pixels[:, marked, :3] = 1.0
    pixels[..., 3] = 1.0
    image.pixels.foreach_set(pixels.ravel())
    image.filepath_raw, image.file_format = str(path), "OPEN_EXR"
    image.save()


def test_a_mask_keeps_noise_in_its_part_of_the_frame() -> None:
    scene, frames = shot_scene("masked")
    scene.hush.lam = 1.0
    assert bpy.ops.hush.denoise_shot() == {"FINISHED"}
    plain = kit.layer(frames / "denoised" / NAMES[2], "Combined", "RGB")
    masks = kit.folder("masks")
    height, width = plain.shape[:2]
    image = bpy.data.images.new("mask", width, height, float_buffer=True)
    for name in NAMES:
        mask(image, slice(width // 2, None), masks / name)
    scene.hush.lambda_images, scene.hush.lambda_masked = str(masks / "frame_####.exr"), 64.0
    assert bpy.ops.hush.denoise_shot() == {"FINISHED"}
    entries = manifest(frames / "denoised")
    assert entries[NAMES[2]]["settings"]["lambda_masked"] == 64.0 and entries[NAMES[2]]["lambda_image"], entries[NAMES[2]]
    masked, noisy = (kit.layer(path / NAMES[2], "Combined", "RGB") for path in (frames / "denoised", frames))
    change = np.abs(masked - plain).mean(axis=(0, 2))
    assert change[-width // 4 :].mean() > 20 * change[: width // 8].mean(), change
    right = slice(width * 3 // 4, None)
    assert np.abs(masked - noisy)[:, right].mean() < np.abs(plain - noisy)[:, right].mean()
    # A mask that changed makes its frame stale, and only that.
    mask(image, slice(width // 3, None), masks / NAMES[1])
    import hush

    checked = hush.check_sequence(**kit.module("shot").sequences(scene)[0])
    assert [(frame["frame"], frame["kind"]) for frame in checked["frames"] if frame["state"] == "stale"] == [(2, "lambda_image")]

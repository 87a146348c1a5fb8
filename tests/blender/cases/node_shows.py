"""The Temporal Denoise node shows the denoised frame's own pixels, and the incoming image wherever there is none."""

from __future__ import annotations

import shutil
from pathlib import Path

import bpy
import frames
import kit
import numpy as np

EXACT = 1e-5


def prepared(name: str, denoised: list[int]) -> tuple[Path, bpy.types.Scene, bpy.types.Node]:
    shot = kit.copy_of_shot(name)
    frames.make_denoised(shot, denoised)
    return shot, *frames.scene_with_node(shot)


def assert_noisy(image: np.ndarray, shot: Path, frame: int) -> None:
    kit.assert_close(image, frames.noisy(shot, frame), 1e-3, f"frame {frame}, which should pass through")


def test_the_denoised_pixels_come_out() -> None:
    shot, scene, _ = prepared("pixels", [1, 2, 3, 4, 5])
    for frame in (1, 4, 2):
        kit.assert_close(frames.composite(scene, frame, kit.folder("out")), frames.picture(frame), EXACT, f"frame {frame}")


def test_an_animation_follows_the_frames() -> None:
    shot, scene, _ = prepared("animation", [1, 2, 4])
    out = kit.folder("out")
    settings = scene.render.image_settings
    if hasattr(settings, "media_type"):
        settings.media_type = "IMAGE"
    settings.file_format, settings.color_depth = "OPEN_EXR", "32"
    scene.render.filepath = str(out / "film_")
    scene.frame_end = 4
    bpy.ops.render.render(animation=True)
    for frame in (1, 2, 3, 4):
        planes = kit.channels(out / f"film_{frame:04d}.exr")
        image = np.stack([planes[c] for c in "RGB"], -1)
        if frame == 3:
            assert_noisy(image, shot, frame)
        else:
            kit.assert_close(image, frames.picture(frame), EXACT, f"frame {frame}")


def test_no_denoised_folder_at_all() -> None:
    shot = kit.copy_of_shot("none")
    scene, node = frames.scene_with_node(shot)
    assert_noisy(frames.composite(scene, 1, kit.folder("out")), shot, 1)
    frames.make_denoised(shot, [1])
    frames.module("refresh").shot_changed(scene)
    kit.assert_close(frames.composite(scene, 1, kit.folder("out")), frames.picture(1), EXACT)


def test_a_missing_frame_passes_through_and_comes_back() -> None:
    shot, scene, _ = prepared("missing", [1, 2, 3])
    out = kit.folder("out")
    (shot / "denoised" / "frame_0002.exr").rename(shot / "aside.exr")
    assert_noisy(frames.composite(scene, 2, out), shot, 2)
    (shot / "aside.exr").rename(shot / "denoised" / "frame_0002.exr")
    kit.assert_close(frames.composite(scene, 2, out), frames.picture(2), EXACT)
    shutil.rmtree(shot / "denoised")
    assert_noisy(frames.composite(scene, 3, out), shot, 3)


def test_half_written_files_pass_through() -> None:
    for name, keep in (("empty", 0.0), ("header", 0.05), ("half", 0.5), ("almost", 0.98)):
        shot, scene, _ = prepared(f"broken-{name}", [1, 2, 3])
        file = shot / "denoised" / "frame_0002.exr"
        data = file.read_bytes()
        file.write_bytes(data[: int(len(data) * keep)])
        assert_noisy(frames.composite(scene, 2, kit.folder("out")), shot, 2)
    shot, scene, _ = prepared("broken-garbage", [1, 3])
    (shot / "denoised" / "frame_0002.exr").write_bytes(b"no picture" * 1000)
    assert_noisy(frames.composite(scene, 2, kit.folder("out")), shot, 2)


def test_a_file_that_vanishes_while_its_frame_is_rendered() -> None:
    shot, scene, _ = prepared("vanishing", [1, 2, 3])

    def vanish(*_: object) -> None:
        (shot / "denoised" / "frame_0002.exr").unlink(missing_ok=True)

    kit.assert_close(frames.composite(scene, 1, kit.folder("out")), frames.picture(1), EXACT)
    bpy.app.handlers.render_pre.append(vanish)
    try:
        image = frames.composite(scene, 2, kit.folder("out"))
    finally:
        bpy.app.handlers.render_pre.remove(vanish)
    assert frames.module("node").is_on(next(frames.module("node").nodes(scene))), "the file should have been there at render_pre"
    assert_noisy(image, shot, 2)


def test_files_written_again_are_read_again() -> None:
    shot, scene, _ = prepared("again", [1, 2])
    kit.assert_close(frames.composite(scene, 2, kit.folder("out")), frames.picture(2), EXACT)
    frames.make_denoised(shot, [1, 2], base=30.0)
    frames.module("refresh").shot_changed(scene)
    kit.assert_close(frames.composite(scene, 2, kit.folder("out")), frames.picture(2, base=30.0), EXACT)


def test_another_resolution_passes_through() -> None:
    shot, scene, node = prepared("resolution", [1])
    scene.render.resolution_percentage = 50
    image = frames.composite(scene, 1, kit.folder("out"))
    assert image.shape[:2] == (27, 48)
    assert 0.01 < image.max() < 9, image.max()
    assert "96 × 54" in frames.module("node").why_off(node)


def test_fireflies_do_not_come_through() -> None:
    """The incoming image is left out exactly, however bright it is."""
    shot, scene, node = prepared("fireflies", [1])
    tree = node.id_data
    bright = tree.nodes.new("ShaderNodeMath" if frames.BLENDER_5 else "CompositorNodeMath")
    bright.inputs[0].default_value, bright.inputs[1].default_value = 1e30, 1e30
    tree.links.new(bright.outputs[0], node.inputs[0])
    kit.assert_close(frames.composite(scene, 1, kit.folder("out")), frames.picture(1), EXACT)


def test_transparent_black_stays() -> None:
    """A shadow on a transparent film is black with alpha; it is the denoised alpha that comes out."""
    shot, scene, node = prepared("shadow", [1])

    def change(name: str, pixels: np.ndarray) -> np.ndarray:
        if ".Combined." not in name:
            return pixels
        return np.full_like(pixels, 0.25 if name.endswith("A") else 0.0)

    kit.rewrite(shot / "denoised" / "frame_0001.exr", change)
    frames.module("refresh").shot_changed(scene)
    scene.render.film_transparent = True
    out = kit.folder("out")
    image = frames.composite(scene, 1, out)
    assert image.max() == 0, image.max()
    assert np.allclose(kit.channels(out / "result_1.exr")["A"], 0.25)


def test_a_black_frame_stays_black() -> None:
    shot, scene, node = prepared("black", [1])
    bpy.data.objects.remove(bpy.data.objects["Area"])
    for background in (shot / "frame_0001.exr", shot / "denoised" / "frame_0001.exr"):
        kit.rewrite(background, lambda name, p: np.zeros_like(p) if ".Combined." in name and name[-1] in "RGB" else p)
    frames.module("refresh").shot_changed(scene)
    assert frames.composite(scene, 1, kit.folder("out")).max() < 1e-6

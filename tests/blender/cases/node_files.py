"""Saved and opened again, with the extension and without, in this Blender: the comp shows what it should."""

from __future__ import annotations

from pathlib import Path

import bpy
import frames
import kit
import numpy as np

OPEN = """\
import sys, bpy, kit, frames
from pathlib import Path
import numpy as np
blend, out = sys.argv[1:]
bpy.ops.wm.open_mainfile(filepath=blend)
for frame in (1, 2, 3):
    np.save(f"{out}/{frame}.npy", frames.composite(bpy.context.scene, frame, Path(out)))
"""


def saved(name: str) -> tuple[Path, Path]:
    """A shot with frames 1 and 3 denoised, and a .blend beside it that shows them."""
    shot = kit.copy_of_shot(name)
    frames.make_denoised(shot, [1, 3])
    scene, _ = frames.scene_with_node(shot)
    scene.hush.lam = 5.0
    blend = shot / "shot.blend"
    scene.hush.input_folder = "//"
    bpy.ops.wm.save_as_mainfile(filepath=str(blend), compress=False)
    return shot, blend


def opened(blend: Path, *, enabled: bool) -> list[np.ndarray]:
    out = kit.folder("opened")
    kit.blender(OPEN, blend, out, enabled=enabled)
    return [np.load(out / f"{frame}.npy") for frame in (1, 2, 3)]


def test_with_the_extension() -> None:
    shot, blend = saved("with")
    one, two, three = opened(blend, enabled=True)
    kit.assert_close(one, frames.picture(1), 1e-5)
    kit.assert_close(two, frames.noisy(shot, 2), 1e-3)
    kit.assert_close(three, frames.picture(3), 1e-5)


def test_moved_with_its_frames() -> None:
    shot, blend = saved("before")
    moved = kit.folder("moved") / "elsewhere"
    shot.rename(moved)
    one, two, _ = opened(moved / blend.name, enabled=True)
    kit.assert_close(one, frames.picture(1), 1e-5)
    kit.assert_close(two, frames.noisy(moved, 2), 1e-3)


def test_without_the_extension_the_comp_is_whole() -> None:
    """5.0 and 4.5 pass the image through an unknown node; 4.2 goes on showing what is inside."""
    shot, blend = saved("without")
    for image, frame in zip(opened(blend, enabled=False), (1, 2, 3), strict=True):
        shows_inside = bpy.app.version < (4, 5) and frame != 2
        expected = frames.picture(frame) if shows_inside else frames.noisy(shot, frame)
        kit.assert_close(image, expected, 1e-3, f"frame {frame}")


def test_without_the_extension_and_the_frames() -> None:
    shot, blend = saved("gone")
    for file in (shot / "denoised").iterdir():
        file.unlink()
    for image, frame in zip(opened(blend, enabled=False), (1, 2, 3), strict=True):
        kit.assert_close(image, frames.noisy(shot, frame), 1e-3, f"frame {frame}")


def test_saved_without_the_extension_it_comes_back() -> None:
    shot, blend = saved("through")
    kit.blender(
        "import sys, bpy\nbpy.ops.wm.open_mainfile(filepath=sys.argv[1])\nbpy.ops.wm.save_mainfile()",
        blend,
        enabled=False,
    )
    bpy.ops.wm.open_mainfile(filepath=str(blend))
    scene = bpy.context.scene
    assert scene.hush.lam == 5.0
    assert len(list(frames.module("node").nodes(scene))) == 1
    kit.assert_close(frames.composite(scene, 3, kit.folder("out")), frames.picture(3), 1e-5)


def test_linked_scenes_do_no_harm() -> None:
    shot, blend = saved("library")
    bpy.ops.wm.read_homefile(use_empty=True)
    bpy.context.scene.name = "Local"
    with bpy.data.libraries.load(str(blend), link=True) as (there, here):
        here.scenes = there.scenes
    linked = next(scene for scene in bpy.data.scenes if scene.library)
    module = frames.module
    module("node").sync(linked, fresh=True)
    assert module("status").shot_status(linked).total == 5
    assert module("shot").output_folder(linked) == shot / "denoised"
    kit.assert_close(frames.composite(linked, 1, kit.folder("out")), frames.picture(1), 1e-5)
    bpy.ops.wm.save_as_mainfile(filepath=str(kit.folder("links") / "links.blend"))

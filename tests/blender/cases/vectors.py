"""Cycles' Vector pass means what Hush takes it to mean: a moving, turning object before a moving camera, through the cameras.

    frame t−1:  column + X, row − Y        frame t+1:  column − Z, row + W

The same rule in Rust is tested by `a_point_is_looked_for_where_its_vectors_say`.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path

import bpy
import kit
import numpy as np

FRAME = 3
TOLERANCE = 0.05
CUBE, GROUND = 1, 2
INDEX = "Object Index" if bpy.app.version >= (5, 0) else "IndexOB"
Matrices = dict[str, np.ndarray]


def matrices(scene: bpy.types.Scene, frame: int) -> Matrices:
    """The object's to the world and the world's to the picture (0…1, y up after the division) at a frame."""
    scene.frame_set(frame)
    render, camera = scene.render, scene.camera
    depsgraph = bpy.context.evaluated_depsgraph_get()
    projection = camera.calc_matrix_camera(depsgraph, x=render.resolution_x, y=render.resolution_y)
    found = {name: np.array(bpy.data.objects[name].matrix_world) for name in ("Cube", "Ground")}
    return {**found, "picture": np.array(projection @ camera.matrix_world.inverted())}


@cache
def rendered() -> tuple[Path, dict[int, Matrices]]:
    """One frame, sampled once in the middle of each pixel, and the matrices of it and of the frames beside it."""
    folder = kit.folder("vectors")
    scene = kit.build_scene()
    scene.view_layers[0].use_pass_object_index = True
    bpy.data.objects["Cube"].pass_index, bpy.data.objects["Ground"].pass_index = CUBE, GROUND
    scene.cycles.samples, scene.cycles.filter_width = 1, 0.01
    around = {frame: matrices(scene, frame) for frame in (FRAME - 1, FRAME, FRAME + 1)}
    scene.frame_set(FRAME)
    scene.render.filepath = str(folder / "frame_####")
    scene.frame_start = scene.frame_end = FRAME
    bpy.ops.render.render(animation=True)
    return folder / f"frame_{FRAME:04d}.exr", around


def seen_at(position: np.ndarray, name: str, at: Matrices, now: Matrices, size: tuple[int, int]) -> np.ndarray:
    """Column and row (pixel centres whole numbers, rows down) at which points of an object, in the world now, are seen then."""
    rows, columns = size
    points = np.concatenate([position.astype(np.float64), np.ones((len(position), 1))], 1).T
    clip = at["picture"] @ at[name] @ np.linalg.inv(now[name]) @ points
    x, y = clip[0] / clip[3], clip[1] / clip[3]
    return np.stack([(x + 1) / 2 * columns - 0.5, rows - (y + 1) / 2 * rows - 0.5], -1)


def errors(name: str, index: int) -> tuple[dict[int, np.ndarray], dict[int, np.ndarray]]:
    """How far from the truth the vectors of an object's pixels point, at t−1 and t+1, and how far it moved; in pixels."""
    path, around = rendered()
    vector, position = kit.layer(path, "Vector", "XYZW"), kit.layer(path, "Position", "XYZ")
    size = vector.shape[:2]
    mask = kit.layer(path, INDEX, "X")[..., 0] == index
    assert mask.sum() > 150, f"{name}: {mask.sum()} pixels"
    rows, columns = np.nonzero(mask)
    x, y, z, w = vector[mask].astype(np.float64).T
    here = seen_at(position[mask], name, around[FRAME], around[FRAME], size)
    assert np.abs(here - np.stack([columns, rows], -1)).max() < TOLERANCE, "the Position pass is not where the pixels are"
    told = {FRAME - 1: here + np.stack([x, -y], -1), FRAME + 1: here + np.stack([-z, w], -1)}
    true = {frame: seen_at(position[mask], name, around[frame], around[FRAME], size) for frame in told}
    off = {frame: np.abs(told[frame] - true[frame]).max(-1) for frame in told}
    return off, {frame: np.abs(true[frame] - here).max(-1) for frame in told}


def check(name: str, index: int, moved_at_least: float) -> None:
    off, moved = errors(name, index)
    for frame in off:
        print(f"{name} t{frame - FRAME:+d}: off by {off[frame].max():.4f} px at most; moved {np.median(moved[frame]):.2f} px")
        assert np.median(moved[frame]) > moved_at_least, f"{name} hardly moves, so nothing was tested"
        assert off[frame].max() <= TOLERANCE, f"{name} t{frame - FRAME:+d}: off by {off[frame].max():.3f} px"


def test_a_moving_object() -> None:
    check("Cube", CUBE, 1.0)


def test_what_only_the_camera_moves() -> None:
    check("Ground", GROUND, 0.5)


def test_hush_takes_the_vectors_so() -> None:
    """The middle frame, denoised with its neighbours, is better than with vectors that point the other way."""
    import hush

    shots = {name: kit.copy_of_shot(name) for name in ("right", "reversed")}
    for path in shots["reversed"].glob("*.exr"):
        kit.rewrite(path, lambda name, pixels: -pixels if ".Vector." in name else pixels)
    truth = kit.layer(kit.shot("clean") / f"frame_{FRAME:04d}.exr", "Combined")
    error = {}
    for name, folder in shots.items():
        output = kit.folder(f"{name}-denoised")
        hush.denoise_sequence(str(folder), str(output), frames=[FRAME], window=2)
        image = kit.layer(output / f"frame_{FRAME:04d}.exr", "Combined")
        error[name] = float(np.mean(np.abs(image - truth) / (np.abs(image) + np.abs(truth) + 0.01)))
    print(error)
    assert error["right"] < 0.97 * error["reversed"], error

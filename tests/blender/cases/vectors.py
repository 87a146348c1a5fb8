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


def test_colours_move_along_the_vectors() -> None:
    """A texture that glows, free of noise: what a frame shows is found in the frames beside it where the rule says."""
    folder = kit.folder("textured")
    scene = kit.build_scene(render_to=folder)
    glow(bpy.data.objects["Cube"])
    scene.render.resolution_percentage = 200
    scene.cycles.samples, scene.cycles.filter_width = 1, 0.01
    scene.frame_start, scene.frame_end = FRAME - 1, FRAME + 1
    scene.view_layers[0].use_pass_object_index = True
    bpy.data.objects["Cube"].pass_index = CUBE
    bpy.ops.render.render(animation=True)
    before, now, after = (folder / f"frame_{frame:04d}.exr" for frame in range(FRAME - 1, FRAME + 2))
    on_cube = {path: kit.layer(path, INDEX, "X")[..., 0] == CUBE for path in (before, now, after)}
    x, y, z, w = np.moveaxis(kit.layer(now, "Vector", "XYZW").astype(np.float64), -1, 0)
    rows, columns = np.indices(x.shape)
    colour = kit.layer(now, "Combined")
    for path, column, row in ((before, x, -y), (after, -z, w)):
        off = {}
        for name, sign in (("right", 1), ("reversed", -1)):
            there, seen = bilinear(kit.layer(path, "Combined"), on_cube[path], columns + sign * column, rows + sign * row)
            inside = seen & on_cube[now]
            assert inside.sum() > 500, inside.sum()
            off[name] = float(np.median(np.abs(there - colour).max(-1)[inside]))
        print(path.name, off)
        assert off["right"] < 0.02 and off["reversed"] > 5 * off["right"], off


def glow(thing: bpy.types.Object) -> None:
    """A smooth texture, fixed to the object, that shines by itself."""
    material = bpy.data.materials.new("Glow")
    material.use_nodes = True
    nodes, links = material.node_tree.nodes, material.node_tree.links
    nodes.clear()
    noise, emission, output = (nodes.new(f"ShaderNode{kind}") for kind in ("TexNoise", "Emission", "OutputMaterial"))
    coordinates = nodes.new("ShaderNodeTexCoord")
    noise.inputs["Scale"].default_value, noise.inputs["Detail"].default_value = 4.0, 0.0
    links.new(coordinates.outputs["Object"], noise.inputs["Vector"])
    links.new(noise.outputs["Color"], emission.inputs["Color"])
    links.new(emission.outputs[0], output.inputs["Surface"])
    thing.data.materials.clear()
    thing.data.materials.append(material)


def bilinear(image: np.ndarray, mask: np.ndarray, column: np.ndarray, row: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The image between pixels, and whether all four around a place are there and in the mask."""
    rows, columns = mask.shape
    inside = (column >= 0) & (column <= columns - 1.001) & (row >= 0) & (row <= rows - 1.001)
    column, row = np.where(inside, column, 0), np.where(inside, row, 0)
    c, r = column.astype(int), row.astype(int)
    fc, fr = (column - c)[..., None], (row - r)[..., None]
    upper = image[r, c] * (1 - fc) + image[r, c + 1] * fc
    lower = image[r + 1, c] * (1 - fc) + image[r + 1, c + 1] * fc
    return upper * (1 - fr) + lower * fr, inside & mask[r, c] & mask[r, c + 1] & mask[r + 1, c] & mask[r + 1, c + 1]

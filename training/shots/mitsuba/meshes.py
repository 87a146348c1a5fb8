"""Meshes for Mitsuba's scenes, as PLY files."""

from __future__ import annotations

import random
from collections.abc import Callable
from pathlib import Path

import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def grid(point: Callable[[Array, Array], Array], rows: int, columns: int) -> tuple[Array, NDArray[np.uint32], Array]:
    """A surface over (u, v) in [0, 1]²: positions, triangles and texture coordinates."""
    v, u = np.meshgrid(np.linspace(0, 1, rows + 1), np.linspace(0, 1, columns + 1), indexing="ij")
    index = np.arange((rows + 1) * (columns + 1), dtype=np.uint32).reshape(rows + 1, columns + 1)
    a, b, c, d = (index[i : i + rows, j : j + columns].ravel() for i, j in ((0, 0), (0, 1), (1, 1), (1, 0)))
    faces = np.concatenate((np.stack((a, b, c), 1), np.stack((a, c, d), 1)))
    return point(u.ravel(), v.ravel()), faces, np.stack((u.ravel(), v.ravel()), 1)


def torus(r: random.Random) -> tuple[Array, NDArray[np.uint32], Array]:
    thick, turns = r.uniform(0.15, 0.45), r.choice((0, 0, 3, 5))

    def point(u: Array, v: Array) -> Array:
        a, b = 2 * np.pi * u, 2 * np.pi * v
        radius = 0.7 + thick * np.cos(b) * (1 + 0.3 * np.cos(turns * a))
        return np.stack((radius * np.cos(a), thick * np.sin(b), radius * np.sin(a)), 1)

    return grid(point, 24, 48)


def blob(r: random.Random) -> tuple[Array, NDArray[np.uint32], Array]:
    waves = [([r.gauss(0, 2.5) for _ in range(3)], r.uniform(0, 6.3), r.uniform(0.05, 0.18)) for _ in range(4)]

    def point(u: Array, v: Array) -> Array:
        a, b = 2 * np.pi * u, np.pi * v
        unit = np.stack((np.sin(b) * np.cos(a), -np.cos(b), np.sin(b) * np.sin(a)), 1)
        return unit * (0.8 + sum(height * np.sin(unit @ np.array(k) + phase) for k, phase, height in waves))[:, None]

    return grid(point, 32, 48)


def hills(r: random.Random) -> tuple[Array, NDArray[np.uint32], Array]:
    """A ground from −1 to 1 with low hills; not above 0 by more than 0.08."""
    waves = [(r.gauss(0, 5), r.gauss(0, 5), r.uniform(0, 6.3), r.uniform(0.005, 0.02)) for _ in range(5)]

    def point(u: Array, v: Array) -> Array:
        x, z = 2 * u - 1, 2 * v - 1
        y = sum(height * np.sin(kx * x + kz * z + phase) for kx, kz, phase, height in waves)
        return np.stack((x, np.minimum(y, 0.08), -z), 1)

    return grid(point, 64, 64)


def ribbon(r: random.Random) -> tuple[Array, NDArray[np.uint32], Array]:
    twist, width = r.uniform(2, 8), r.uniform(0.15, 0.4)

    def point(u: Array, v: Array) -> Array:
        a, x = twist * u, width * (2 * v - 1)
        return np.stack((x * np.cos(a) + 0.3 * np.sin(3 * u), 2 * u - 1, x * np.sin(a)), 1)

    return grid(point, 4, 64)


def leaves(r: random.Random) -> tuple[Array, NDArray[np.uint32], Array]:
    """A bush: a few hundred small quads around a ball."""
    rng = np.random.default_rng(r.randrange(1 << 31))
    count = r.randint(120, 400)
    centre = rng.normal(size=(count, 3))
    centre *= (rng.uniform(0.3, 1, (count, 1)) ** 0.4) / np.linalg.norm(centre, axis=1, keepdims=True)
    one = rng.normal(size=(count, 3)) * 0.11
    two = np.cross(one, rng.normal(size=(count, 3)))
    two *= 0.06 / np.maximum(np.linalg.norm(two, axis=1, keepdims=True), 1e-6)
    corners = np.stack((centre - one - two, centre + one - two, centre + one + two, centre - one + two), 1)
    first = 4 * np.arange(count, dtype=np.uint32)[:, None]
    faces = np.concatenate((first + np.array([0, 1, 2], np.uint32), first + np.array([0, 2, 3], np.uint32)))
    return corners.reshape(-1, 3), faces, np.tile(np.array([[0, 0], [1, 0], [1, 1], [0, 1.0]]), (count, 1))


SOLIDS = (torus, blob, ribbon, leaves)


def written(r: random.Random, kind: Callable[[random.Random], tuple[Array, NDArray[np.uint32], Array]], path: Path) -> str:
    """Writes a mesh as PLY; the file's name."""
    points, faces, uv = kind(r)
    flat = kind is leaves
    mesh = mi.Mesh(kind.__name__, len(points), len(faces), has_vertex_normals=not flat, has_vertex_texcoords=True)
    params = mi.traverse(mesh)
    params["vertex_positions"] = points.astype(np.float32).ravel()
    params["vertex_texcoords"] = uv.astype(np.float32).ravel()
    params["faces"] = faces.ravel()
    if not flat:
        corner = points[faces]
        face = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
        normals = np.zeros_like(points)
        for k in range(3):
            np.add.at(normals, faces[:, k], face)
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
        params["vertex_normals"] = normals.astype(np.float32).ravel()
    params.update()
    mesh.write_ply(str(path))
    return str(path)

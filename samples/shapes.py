"""Builders of the sample shot's meshes: boxes, balls, rings and solids of revolution."""

from __future__ import annotations

import math
from collections.abc import Sequence

import bpy


def finished(thing: bpy.types.Object, material: bpy.types.Material, smooth: bool = True) -> bpy.types.Object:
    """Gives an object its one material and its shading."""
    thing.data.materials.clear()
    thing.data.materials.append(material)
    if smooth and hasattr(thing.data, "polygons"):
        thing.data.polygons.foreach_set("use_smooth", [True] * len(thing.data.polygons))
    return thing


def added(name: str, mesh: bpy.types.Mesh, at: Sequence[float] = (0, 0, 0)) -> bpy.types.Object:
    thing = bpy.data.objects.new(name, mesh)
    thing.location = at
    bpy.context.scene.collection.objects.link(thing)
    return thing


def turned(name: str, profile: Sequence[tuple[float, float]], at: Sequence[float], segments: int = 96) -> bpy.types.Object:
    """A solid of revolution about z; the profile is (radius, height), from the bottom up; radius 0 closes it."""
    points: list[tuple[float, float, float]] = []
    faces: list[tuple[int, ...]] = []
    for radius, height in profile:
        points += [
            (radius * math.cos(2 * math.pi * k / segments), radius * math.sin(2 * math.pi * k / segments), height) for k in range(segments)
        ]
    for ring in range(len(profile) - 1):
        for k in range(segments):
            a, b = ring * segments + k, ring * segments + (k + 1) % segments
            faces.append((a, b, b + segments, a + segments))
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(points, [], faces)
    thing = added(name, mesh, at)
    weld = thing.modifiers.new("weld", "WELD")
    weld.merge_threshold = 1e-5
    return thing


def rounded(profile: Sequence[tuple[float, float]], steps: int = 6) -> list[tuple[float, float]]:
    """Catmull-Rom curve through the points of a profile."""
    ends = [profile[0], *profile, profile[-1]]
    curve = []
    for a, b, c, d in zip(ends, ends[1:], ends[2:], ends[3:], strict=False):
        for step in range(steps):
            t = step / steps
            weights = (-t + 2 * t * t - t**3, 2 - 5 * t * t + 3 * t**3, t + 4 * t * t - 3 * t**3, t**3 - t * t)
            curve.append(tuple(0.5 * sum(w * p[i] for w, p in zip(weights, (a, b, c, d), strict=True)) for i in (0, 1)))
    return [(max(r, 0.0), h) for r, h in [*curve, profile[-1]]]


def box(name: str, size: Sequence[float], at: Sequence[float], bevel: float = 0.03) -> bpy.types.Object:
    x, y, z = (0.5 * s for s in size)
    corners = [(a * x, b * y, c * z) for a in (-1, 1) for b in (-1, 1) for c in (-1, 1)]
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(corners, [], [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)])
    thing = added(name, mesh, at)
    if bevel:
        edge = thing.modifiers.new("bevel", "BEVEL")
        edge.width, edge.segments = bevel, 3
    return thing


def sphere(name: str, radius: float, at: Sequence[float]) -> bpy.types.Object:
    bpy.ops.mesh.primitive_uv_sphere_add(segments=64, ring_count=32, radius=radius, location=at)
    bpy.context.object.name = name
    return bpy.context.object


def ring(name: str, radius: float, thickness: float, at: Sequence[float], tilt: Sequence[float]) -> bpy.types.Object:
    bpy.ops.mesh.primitive_torus_add(
        major_segments=96, minor_segments=12, major_radius=radius, minor_radius=thickness, location=at, rotation=tilt
    )
    bpy.context.object.name = name
    return bpy.context.object


def islands(mesh: bpy.types.Mesh, smaller_than: int) -> list[int]:
    """The faces of the mesh's separate parts that have fewer vertices than that (a monkey's eyes)."""
    part = list(range(len(mesh.vertices)))

    def root(i: int) -> int:
        while part[i] != i:
            i = part[i]
        return i

    for edge in mesh.edges:
        a, b = (root(i) for i in edge.vertices)
        part[max(a, b)] = min(a, b)
    roots = [root(i) for i in range(len(part))]
    return [face.index for face in mesh.polygons if roots.count(roots[face.vertices[0]]) < smaller_than]

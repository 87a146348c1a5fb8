"""Random animated scenes for Mitsuba 3: rooms, open ground and close-ups; lengths about 1, y up.

Only rigid motion and uniform poses, so that motion vectors can be computed from the poses.
"""

from __future__ import annotations

import math
import random
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

from training.shots.mitsuba import materials
from training.shots.mitsuba.meshes import SOLIDS, hills, written

Matrix = NDArray[np.float64]
Pose = Callable[[float], Matrix]
Plugin = dict[str, Any]
PRIMITIVES = ("sphere", "cube", "cylinder", "disk", "rectangle", "sphere", "cube")


def moved(x: float, y: float, z: float) -> Matrix:
    m = np.eye(4)
    m[:3, 3] = x, y, z
    return m


def scaled(x: float, y: float, z: float) -> Matrix:
    return np.diag([x, y, z, 1.0])


def turned(axis: NDArray[np.float64], angle: float) -> Matrix:
    """Rotation about an axis through the origin, in radians."""
    x, y, z = axis / np.linalg.norm(axis)
    k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    m = np.eye(4)
    m[:3, :3] += math.sin(angle) * k + (1 - math.cos(angle)) * (k @ k)
    return m


def looking(origin: NDArray[np.float64], target: NDArray[np.float64], up: NDArray[np.float64]) -> Matrix:
    """Mitsuba's `look_at`: columns left, up, forward, origin."""
    forward = (target - origin) / np.linalg.norm(target - origin)
    left = np.cross(up, forward)
    left /= np.linalg.norm(left)
    m = np.eye(4)
    m[:3] = np.stack((left, np.cross(forward, left), forward, origin), 1)
    return m


@dataclass
class Thing:
    """A shape with its BSDF, and where it is in each frame."""

    plugin: Plugin
    pose: Pose


@dataclass
class World:
    """A scene over time; frame 0 is the middle one."""

    kind: str
    motion: str
    camera: Pose
    fov: float
    depth: int
    things: list[Thing] = field(default_factory=list)
    lights: list[Plugin] = field(default_factory=list)

    def at(self, frame: float, size: int) -> Plugin:
        """Mitsuba's scene of a frame, with the AOVs that Hush reads."""
        film = {"type": "hdrfilm", "width": size, "height": size, "rfilter": {"type": "box"}, "pixel_format": "rgb"}
        to_world = mi.ScalarTransform4f
        scene: Plugin = {
            "type": "scene",
            "integrator": {
                "type": "aov",
                "aovs": "albedo:albedo,normal:sh_normal,depth:depth",
                "image": {"type": "path", "max_depth": self.depth},
            },
            "sensor": {
                "type": "perspective",
                "fov": self.fov,
                "to_world": to_world(self.camera(frame)),
                "film": film,
                "sampler": {"type": "independent"},
            },
        }
        for k, thing in enumerate(self.things):
            scene[f"thing{k:03d}"] = {**thing.plugin, "to_world": to_world(thing.pose(frame))}
        return scene | {f"light{k}": light for k, light in enumerate(self.lights)}


def wandering(r: random.Random, base: Matrix, scale: Matrix, reach: float) -> Pose:
    """A pose that drifts and turns, or stays; the shape is scaled first."""
    if r.random() < 0.35:
        return lambda _: base @ scale
    drift = np.array([r.gauss(0, reach), abs(r.gauss(0, 0.3 * reach)), r.gauss(0, reach)])
    axis = np.array([r.gauss(0, 0.4), 1.0, r.gauss(0, 0.4)])
    spin = r.gauss(0, 0.06) if r.random() < 0.7 else 0.0
    return lambda t: moved(*(drift * t)) @ base @ turned(axis, spin * t) @ scale


def flying(r: random.Random, origin: NDArray[np.float64], target: NDArray[np.float64]) -> tuple[str, Pose]:
    """The camera's motion and what it is called."""
    kind = r.choice(("still", "orbit", "dolly", "pan", "handheld"))
    speed = 10 ** r.uniform(-2.3, -1.2)
    up = np.array([r.gauss(0, 0.05), 1.0, 0.0])
    side = np.cross(target - origin, up)
    side /= np.linalg.norm(side)
    shake = [(r.uniform(0.5, 2), r.uniform(0, 6.3)) for _ in range(3)]

    def pose(t: float) -> Matrix:
        if kind == "orbit":
            return looking(target + turned(up, speed * t)[:3, :3] @ (origin - target), target, up)
        if kind == "dolly":
            return looking(origin + speed * t * (target - origin), target, up)
        if kind == "pan":
            return looking(origin, target + 2 * speed * t * side, up)
        if kind == "handheld":
            jitter = np.array([math.sin(a * t + b) for a, b in shake]) * speed
            return looking(origin + jitter, target + jitter[::-1], up)
        return looking(origin, target, up)

    return kind, pose


def things(r: random.Random, folder: Path, count: int, place: Callable[[], NDArray[np.float64]], size: float, shiny: float) -> list[Thing]:
    """Shapes that stand about where `place` says."""
    out = []
    for k in range(count):
        s = size * 2 ** r.uniform(-1, 0.7)
        base = moved(*place()) @ turned(
            np.array([r.gauss(0, 1) for _ in range(3)]), r.uniform(-1, 1) * (math.pi if r.random() < 0.6 else 0.2)
        )
        if r.random() < 0.4:
            mesh = written(r, r.choice(SOLIDS), folder / f"mesh{k}.ply")
            plugin: Plugin = {"type": "ply", "filename": mesh}
            s *= 1.1
        else:
            plugin = {"type": r.choice(PRIMITIVES)}
        closed = plugin["type"] in ("sphere", "cube")
        long = s * 2 ** r.uniform(-1, 1)
        stretch = {"cube": (s, long, s), "rectangle": (s, long, s), "cylinder": (s, s, long)}.get(plugin["type"], (s, s, s))
        plugin["bsdf"] = materials.random_bsdf(r, shiny, closed)
        if r.random() < 0.05:
            plugin["emitter"] = {"type": "area", "radiance": materials.rgb(r, 2.0)}
        out.append(Thing(plugin, wandering(r, base, scaled(*stretch), 0.04 * size)))
    return out


def wall(matrix: Matrix, bsdf: Plugin) -> Thing:
    return Thing({"type": "rectangle", "bsdf": bsdf}, lambda _: matrix)


def room(r: random.Random, folder: Path) -> World:
    """A box with an open front behind the camera or a window, lit by a panel, lamps or the sky through the window."""
    w, h, d = r.uniform(2, 4), r.uniform(1.3, 2.2), r.uniform(2, 4)
    x, y = np.array([1.0, 0, 0]), np.array([0, 1.0, 0])
    surface = lambda: materials.random_bsdf(r, 0.12, False, big=True)
    flat = lambda m, sx, sy: m @ scaled(sx, sy, 1)
    walls = [
        wall(flat(turned(x, -math.pi / 2), w, d), surface()),
        wall(flat(moved(0, 2 * h, 0) @ turned(x, math.pi / 2), w, d), materials.painted(r)),
        wall(flat(moved(0, h, -d), w, h), surface()),
        wall(flat(moved(-w, h, 0) @ turned(y, math.pi / 2), d, h), surface()),
    ]
    lit = r.choice(("panel", "window", "lamps"))
    right = flat(moved(w, h, 0) @ turned(y, -math.pi / 2), d, h)
    if lit == "window":
        walls.append(wall(right @ moved(-0.62, 0, 0) @ scaled(0.38, 1, 1), surface()))
        walls.append(wall(right @ moved(0.6, 0.1, 0) @ scaled(0.4, 0.9, 1), surface()))
    else:
        walls.append(wall(right, surface()))
        walls.append(wall(flat(moved(0, h, d) @ turned(y, math.pi), w, h), materials.painted(r)))
    lights: list[Plugin] = []
    if lit == "window":
        lights.append(materials.sky(r, 8.0))
    elif lit == "panel":
        size = r.uniform(0.3, 0.8)
        glow = {"type": "area", "radiance": materials.rgb(r, 12.0 / size)}
        lamp = flat(moved(r.uniform(-1, 1), 2 * h - 0.02, r.uniform(-1, 1)) @ turned(x, math.pi / 2), size, size)
        walls.append(Thing({"type": "rectangle", "emitter": glow}, lambda _: lamp))
    else:
        for _ in range(r.randint(2, 4)):
            at = moved(r.uniform(-0.8, 0.8) * w, r.uniform(0.8, 1.8) * h, r.uniform(-0.8, 0.5) * d)
            size = r.uniform(0.06, 0.16)
            glow = {"type": "area", "radiance": materials.rgb(r, 60.0)}
            walls.append(Thing({"type": "sphere", "emitter": glow}, wandering(r, at, scaled(size, size, size), 0.02)))
    place = lambda: np.array([r.uniform(-0.75, 0.75) * w, r.uniform(0.15, 0.9), r.uniform(-0.85, 0.2) * d])
    origin = np.array([r.uniform(-0.7, 0.7) * w, r.uniform(0.5, 1.4) * h, r.uniform(0.6, 0.95) * d])
    motion, camera = flying(r, origin, np.array([r.uniform(-0.4, 0.4) * w, r.uniform(0.2, 0.9), -0.4 * d]))
    shapes = things(r, folder, r.randint(4, 10), place, 0.42, 0.3)
    return World(f"room {lit}", motion, camera, r.uniform(45, 75), r.randint(4, 7), walls + shapes, lights)


def ground(r: random.Random, folder: Path) -> World:
    """Shapes on flat or hilly ground under a sky, sometimes with a sun."""
    bsdf = materials.random_bsdf(r, 0.15, False, big=True)
    if r.random() < 0.5:
        base = Thing({"type": "ply", "filename": written(r, hills, folder / "hills.ply"), "bsdf": bsdf}, lambda _: scaled(9, 9, 9))
    else:
        base = wall(turned(np.array([1.0, 0, 0]), -math.pi / 2) @ scaled(9, 9, 1), bsdf)
    lights = [materials.sky(r, 1.0)]
    if r.random() < 0.5:
        direction = [r.uniform(-1, 1), -r.uniform(0.4, 1.5), r.uniform(-1, 1)]
        lights.append({"type": "directional", "direction": direction, "irradiance": materials.rgb(r, 4.0)})
    place = lambda: np.array([r.uniform(-2.5, 2.5), r.uniform(0.3, 1.0), r.uniform(-3, 1.5)])
    origin = np.array([r.uniform(-2, 2), r.uniform(0.6, 2.5), r.uniform(3.2, 5)])
    motion, camera = flying(r, origin, np.array([r.uniform(-0.7, 0.7), r.uniform(0.2, 0.8), -0.6]))
    shapes = things(r, folder, r.randint(4, 12), place, 0.55, 0.3)
    return World("ground", motion, camera, r.uniform(35, 65), r.randint(3, 6), [base, *shapes], lights)


def close(r: random.Random, folder: Path) -> World:
    """A few shiny or clear shapes near the camera, lit by the sky or panels."""
    bsdf = materials.random_bsdf(r, 0.3, False, big=True)
    base = wall(moved(0, -0.6, 0) @ turned(np.array([1.0, 0, 0]), -math.pi / 2) @ scaled(5, 5, 1), bsdf)
    lights, panels = [materials.sky(r, 0.7 if r.random() < 0.6 else 0.08)], []
    for _ in range(r.randint(0, 3)):
        at = np.array([r.uniform(-3, 3), r.uniform(1.5, 3.5), r.uniform(-2, 3)])
        size = r.uniform(0.3, 1.0)
        matrix = looking(at, np.zeros(3), np.array([0.1, 1, 0.2])) @ scaled(size, size, 1)
        panels.append(
            Thing({"type": "rectangle", "emitter": {"type": "area", "radiance": materials.rgb(r, 8.0 / size)}}, lambda _, m=matrix: m)
        )
    place = lambda: np.array([r.uniform(-1, 1), r.uniform(-0.35, 0.4), r.uniform(-1, 0.6)])
    origin = np.array([r.uniform(-1.5, 1.5), r.uniform(0.1, 1.3), r.uniform(1.8, 3)])
    motion, camera = flying(r, origin, np.array([r.uniform(-0.2, 0.2), 0.0, 0.0]))
    shapes = things(r, folder, r.randint(2, 6), place, 0.4, 0.65)
    return World("close", motion, camera, r.uniform(30, 55), r.randint(4, 8), [base, *panels, *shapes], lights)


def build(r: random.Random, folder: Path) -> World:
    """A random scene; its meshes go into `folder`."""
    return r.choice((room, room, ground, ground, close))(r, folder)

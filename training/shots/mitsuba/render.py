"""Renders random shots with Mitsuba 3: OUT/SEED.npz as training.shots.cycles.render does with Cycles, for a second source encoder.

    python -m training.shots.mitsuba.render runs/mitsuba --first 20000 --count 64
    python -m training.shots.mitsuba.render runs/mitsuba --first 20000 --count 1 --exr runs/frames

Wants mitsuba from PyPI (3.9.1) and, for its LLVM mode, the system's libLLVM, 19 (16 fails on some CPUs); DRJIT_LIBLLVM_PATH names it where
it is not found. `--variant scalar_rgb` does without, several times slower. Albedo, normals and depth are what Mitsuba's `aov`
integrator gives. Mitsuba has no motion vectors: they are computed from the poses of the shapes and the camera, in Cycles' form.
"""

from __future__ import annotations

import argparse
import gc
import math
import random
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING

import drjit as dr
import mitsuba as mi
import numpy as np
import OpenEXR
from numpy.typing import NDArray

from training.shots.shot_file import dull, save

if TYPE_CHECKING:
    from training.shots.mitsuba.scenes import World

FRAMES = 5
BATCH = 128
LEAST, MOST, MOST_HELD = 3, 5, 10
STEADY = 0.02
FAR = 1e4
PASSES = {"color": slice(0, 3), "albedo": slice(3, 6), "normal": slice(6, 9), "depth": slice(9, 10)}
CHANNELS = {"color": "RGB", "albedo": "RGB", "normal": "XYZ", "depth": "T", "vector": "XYZW"}
SETTINGS = """# How Hush finds the passes: Mitsuba's AOVs have the names that the scene gives them.
renderer = "mitsuba"

[passes]
albedo = "albedo"
normal = "normal"
depth = "depth"
vector = "vector"
"""
Array = NDArray[np.float32]


def rendered(scene: mi.Scene, samples: int, seed: int) -> dict[str, Array]:
    """Passes (rows, columns, channels) of a frame."""
    pixels = np.array(mi.render(scene, spp=samples, seed=seed), dtype=np.float32)
    return {name: pixels[..., channels] for name, channels in PASSES.items()}


def reference(scene: mi.Scene, r: random.Random, batches_at_most: int) -> dict[str, Array]:
    """A frame in batches of samples, until their means agree or there are enough."""
    batches = []
    while len(batches) < batches_at_most:
        batches.append(rendered(scene, BATCH, r.randrange(1 << 30)))
        if len(batches) >= LEAST:
            colours = np.stack([b["color"].mean(-1) for b in batches])
            error = colours.std(0, ddof=1) / math.sqrt(len(batches)) / (colours.mean(0) + 0.02 * colours.mean() + 1e-6)
            if error.mean() < STEADY:
                break
    return {name: np.mean([b[name] for b in batches], 0) for name in PASSES}


def projected(points: NDArray[np.float64], world: World, frame: float, size: int) -> NDArray[np.float64]:
    """Where homogeneous world points (…, 4) lie in a frame, (…, 2) as column and row of pixel centres."""
    local = points @ np.linalg.inv(world.camera(frame)).T
    ahead = local[..., 2] > 1e-6
    scale = size / 2 / math.tan(math.radians(world.fov) / 2) / np.where(ahead, local[..., 2], 1)
    place = size / 2 - 0.5 - local[..., :2] * scale[..., None]
    return np.where(ahead[..., None], place, FAR)


def vectors(scene: mi.Scene, world: World, frame: int, size: int) -> tuple[Array, float]:
    """Cycles' Vector pass (rows, columns, 4) of what lies behind the pixel centres; and by how many pixels the camera model is off."""
    rows, columns = np.meshgrid(np.arange(size), np.arange(size), indexing="ij")
    sensor, here = scene.sensors()[0], np.stack((columns, rows), -1).reshape(-1, 2)
    at = (here + 0.5) / size
    hits, directions, owners = traced(scene, sensor, at, len(world.things))
    # The sky is infinitely far: it turns with the camera and does not move.
    now = np.where((owners >= 0)[:, None], np.c_[hits, np.ones(len(hits))], np.c_[directions, np.zeros(len(hits))])
    around = []
    for step in (-1, 1):
        then = now.copy()
        for k, thing in enumerate(world.things):
            mine = owners == k
            then[mine] = now[mine] @ (thing.pose(frame + step) @ np.linalg.inv(thing.pose(frame))).T
        around.append(projected(then, world, frame + step, size))
    own = projected(now, world, frame, size)
    before, after = around[0] - own, own - around[1]
    flow = np.stack((before[:, 0], -before[:, 1], after[:, 0], -after[:, 1]), -1)
    return flow.reshape(size, size, 4).astype(np.float32), float(np.abs(own - here).max())


def traced(
    scene: mi.Scene, sensor: mi.Sensor, at: NDArray[np.float64], count: int
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.int64]]:
    """Points hit through film positions (n, 2) in [0, 1]², ray directions, and the number of the thing hit, −1 for none."""
    names = {f"thing{k:03d}": k for k in range(count)}
    if mi.variant().startswith("scalar"):
        hits, directions, owners = [], [], []
        for u, v in at:
            ray, _ = sensor.sample_ray(0.0, 0.0, mi.ScalarPoint2f(u, v), mi.ScalarPoint2f(0.5))
            si = scene.ray_intersect(ray)
            hits.append(np.array(si.p)), directions.append(np.array(ray.d))
            owners.append(names[si.shape.id()] if si.is_valid() else -1)
        return np.array(hits, np.float64), np.array(directions, np.float64), np.array(owners)
    ray, _ = sensor.sample_ray(0.0, 0.0, mi.Point2f(at[:, 0].astype(np.float32), at[:, 1].astype(np.float32)), mi.Point2f(0.5))
    si = scene.ray_intersect(ray)
    owner = dr.full(mi.Int32, -1, len(at))
    for shape in scene.shapes():
        owner = dr.select(si.shape == mi.ShapePtr(shape), names[shape.id()], owner)
    return np.array(si.p, np.float64).T, np.array(ray.d, np.float64).T, np.array(owner, np.int64)


def write_exr(path: Path, passes: dict[str, Array]) -> None:
    """One part, the beauty plain and the AOVs by their names, as Mitsuba's `hdrfilm` writes them; `vector` is ours."""
    channels = {}
    for name, pixels in passes.items():
        prefix = "" if name == "color" else f"{name}."
        channels |= {f"{prefix}{c}": np.ascontiguousarray(pixels[..., k]) for k, c in enumerate(CHANNELS[name])}
    OpenEXR.File({"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}, channels).write(str(path))


def shot(seed: int, size: int, target: Path, frames: Path | None) -> str:
    """Builds, renders and saves one shot; a line about it."""
    from training.shots.mitsuba import scenes  # after the variant is set

    began = time.perf_counter()
    r = random.Random(seed)
    with tempfile.TemporaryDirectory() as folder:
        world = scenes.build(r, Path(folder))
        samples = round(2 ** r.uniform(0, 5.0))
        noisy, middle, miss = [], {}, 0.0
        scene = mi.load_dict(world.at(0, size), optimize=False)  # merged shapes lose their names
        if why := dull(rendered(scene, 4, 999)):
            return f"{seed} skipped: {why}"
        for frame in range(-(FRAMES // 2), FRAMES // 2 + 1):
            scene = None
            gc.collect()  # a scene loaded beside another compiles all over again
            scene = mi.load_dict(world.at(frame, size), optimize=False)
            passes = rendered(scene, samples, r.randrange(1 << 30))
            passes["vector"], error = vectors(scene, world, frame, size)
            noisy.append(passes)
            miss = max(miss, error)
            if frame == 0:
                middle = reference(scene, r, MOST if seed % 8 else MOST_HELD)
    assert miss < 0.05, f"{seed}: the camera model is {miss} pixels off"
    meta = {"seed": seed, "kind": world.kind, "motion": world.motion, "spp": [samples], "adaptive": [0.0], "renderer": "mitsuba"}
    save(target, [noisy], [[middle]], meta)
    if frames:
        frames.mkdir(parents=True, exist_ok=True)
        (frames / "hush.toml").write_text(SETTINGS)
        for k, passes in enumerate(noisy):
            write_exr(frames / f"shot{seed}_{k:04d}.exr", passes)
    return (
        f"{seed} {world.kind} {world.motion}: {samples} spp, {time.perf_counter() - began:.1f} s, own projection off by {miss:.4f} pixels"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("output", type=Path, help="folder for the shots")
    parser.add_argument("--first", type=int, default=20000, help="first seed")
    parser.add_argument("--count", type=int, default=1, help="how many seeds")
    parser.add_argument("--step", type=int, default=1, help="from one seed to the next; 8 from a multiple of 8: validation only")
    parser.add_argument("--size", type=int, default=128, help="width and height in pixels")
    parser.add_argument("--threads", type=int, default=0, help="threads for Mitsuba; 0: all")
    parser.add_argument("--variant", default="llvm_ad_rgb", help="of Mitsuba: llvm_ad_rgb or scalar_rgb")
    parser.add_argument("--exr", type=Path, help="also write the noisy frames here, as EXR files, and how Hush is to read them")
    chosen = parser.parse_args()
    mi.set_variant(chosen.variant)
    mi.set_log_level(mi.LogLevel.Error)
    if chosen.threads:
        dr.set_thread_count(chosen.threads)
    chosen.output.mkdir(parents=True, exist_ok=True)
    for seed in range(chosen.first, chosen.first + chosen.count * chosen.step, chosen.step):
        target = chosen.output / f"{seed:06d}.npz"
        if not target.exists():
            print(shot(seed, chosen.size, target, chosen.exr), flush=True)


if __name__ == "__main__":
    main()

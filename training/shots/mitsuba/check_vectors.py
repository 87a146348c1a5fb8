"""Checks the motion vectors of Mitsuba's shots against Mitsuba itself.

    python -m training.shots.mitsuba.check_vectors --first 20000 --count 8

From each pixel of a shot's middle frame the vectors lead to a place in the frame before and after; the ray through that place must
hit the point of the shape that the pixel shows, or something in front of it. Prints how far it misses, in scene units (a scene is
a few units wide), and fails where more than one in a hundred misses by over 0.001.
"""

from __future__ import annotations

import argparse
import random
import tempfile
from pathlib import Path

import mitsuba as mi
import numpy as np

from training.shots.mitsuba.render import traced, vectors

SIZE = 128


def misses(seed: int, folder: Path) -> tuple[float, float, float]:
    """Largest miss among the best 99 %, mean motion in pixels, and the share of pixels whose shape was hit again."""
    from training.shots.mitsuba import scenes

    world = scenes.build(random.Random(seed), folder)
    scene = mi.load_dict(world.at(0, SIZE), optimize=False)
    flow = vectors(scene, world, 0, SIZE)[0].reshape(-1, 4)
    rows, columns = np.meshgrid(np.arange(SIZE), np.arange(SIZE), indexing="ij")
    here = np.stack((columns, rows), -1).reshape(-1, 2)
    points, _, owners = traced(scene, scene.sensors()[0], (here + 0.5) / SIZE, len(world.things))
    far, motion, again = [], [], []
    for step, way in ((-1, np.c_[flow[:, 0], -flow[:, 1]]), (1, np.c_[-flow[:, 2], flow[:, 3]])):
        there = here + way
        inside = (there > 0).all(1) & (there < SIZE - 1).all(1) & (owners >= 0)
        then = mi.load_dict(world.at(step, SIZE), optimize=False)
        hits, _, others = traced(then, then.sensors()[0], (there + 0.5) / SIZE, len(world.things))
        expected = np.c_[points, np.ones(len(points))]
        for k, thing in enumerate(world.things):
            mine = owners == k
            expected[mine] = expected[mine] @ (thing.pose(step) @ np.linalg.inv(thing.pose(0))).T
        same = inside & (others == owners)
        far.append(np.linalg.norm(hits - expected[:, :3], axis=1)[same])
        motion.append(np.linalg.norm(way[same], axis=1))
        again.append(same.sum() / max(inside.sum(), 1))
    return float(np.percentile(np.concatenate(far), 99)), float(np.concatenate(motion).mean()), float(np.mean(again))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--first", type=int, default=20000, help="first seed")
    parser.add_argument("--count", type=int, default=8, help="how many seeds")
    parser.add_argument("--variant", default="llvm_ad_rgb", help="of Mitsuba: llvm_ad_rgb or scalar_rgb")
    chosen = parser.parse_args()
    mi.set_variant(chosen.variant)
    mi.set_log_level(mi.LogLevel.Error)
    bad = []
    for seed in range(chosen.first, chosen.first + chosen.count):
        with tempfile.TemporaryDirectory() as folder:
            miss, motion, again = misses(seed, Path(folder))
        print(f"{seed}: 99 % miss by less than {miss:.1e}, motion {motion:.2f} pixels, the same shape for {again:.3f}", flush=True)
        bad += [seed] if miss > 1e-3 else []
    if bad:
        raise SystemExit(f"motion vectors are wrong: {bad}")


if __name__ == "__main__":
    main()

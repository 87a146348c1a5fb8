"""Renders random training shots with Cycles: OUT/SEED.npz, noisy takes of seven frames and references for the middle two.

    python -m training.shots.cycles.render runs/shots --first 70000 --count 200 --assets runs/assets

Wants bpy 5.0 or 5.2 from PyPI, numpy and OpenEXR. The assets are the CC0 HDRIs, models and normal maps of the npm package
@pmndrs/assets, base64 in .js files: `training.shots.cycles.fetch_assets` fetches and decodes them. Without them it works too, but
a seed then gives another shot. Seeds divisible by 8 are the validation split. What is already there is skipped.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
from functools import partial
from pathlib import Path

from training.shots.cycles.assets import found
from training.shots.cycles.device import DEVICES
from training.shots.cycles.settings import Quality, Settings
from training.shots.processes import run_all


def rendered(settings: Settings, job: str) -> str:
    """A seed, as a process gets it; a line about it, empty where it is there."""
    from training.shots.cycles.shot import shot  # brings bpy, which changes the paths that further processes would inherit

    if (settings.output / f"{int(job):06d}.npz").exists():
        return ""
    with tempfile.TemporaryDirectory(prefix=f"shot-{os.getpid()}-") as scratch:
        return shot(int(job), settings, Path(scratch) / "frame.exr")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("output", type=Path, help="folder for the shots")
    parser.add_argument("--first", type=int, default=70000, help="first seed")
    parser.add_argument("--count", type=int, default=1, help="how many seeds")
    parser.add_argument("--every", type=int, default=1, help="of those only the multiples of this; 8: only validation shots")
    parser.add_argument("--takes", type=int, default=3, help="noisy takes of each frame, each with its own seeds and samples")
    parser.add_argument("--samples", type=int, default=1024, help="of each half of a reference, at most; at least four times a take's")
    parser.add_argument(
        "--threshold", type=float, default=0.0056, help="noise at which a pixel of a half is done; their mean has 0.7 of it"
    )
    parser.add_argument("--seconds", type=float, default=60.0, help="by the clock for each half of a reference, at most; 0: any")
    parser.add_argument("--size", type=int, default=128, help="width and height in pixels")
    parser.add_argument(
        "--largest", type=float, default=1.0, help="three quarters of the shots are squares of larger frames, up to so many times --size"
    )
    parser.add_argument("--assets", type=Path, default=Path("runs/assets"), help="folder of training.shots.cycles.fetch_assets")
    parser.add_argument("--threads", type=int, default=0, help="threads for Cycles, of each process; 0: all")
    parser.add_argument("--processes", type=int, default=1, help="that render at once")
    parser.add_argument("--device", choices=DEVICES, default="cpu", help="that Cycles renders on")
    chosen = parser.parse_args()
    if not found(chosen.assets).hdris:
        print(f"no assets in {chosen.assets}: the shots will have neither HDRIs, models nor normal maps", file=sys.stderr)
    quality = Quality(chosen.takes, chosen.samples, chosen.threshold, chosen.seconds)
    settings = Settings(chosen.output, chosen.assets, chosen.size, chosen.largest, quality, chosen.threads, chosen.device)
    chosen.output.mkdir(parents=True, exist_ok=True)
    seeds = [seed for seed in range(chosen.first, chosen.first + chosen.count) if seed % chosen.every == 0]
    left = [str(seed) for seed in seeds if not (chosen.output / f"{seed:06d}.npz").exists()]
    lost = run_all(partial(rendered, settings), left, chosen.processes)
    if lost:
        sys.exit(f"not rendered: {', '.join(lost)}")


if __name__ == "__main__":
    main()

"""Renders the benchmark's shots from nothing into a cache: CACHE/SHOT/{4spp,32spp,pass1,pass2…}/frame_0001.exr …

    python -m training.benchmark.render --cache runs/benchmark

Animated shots of 8 frames at 320×180, made for measuring and never trained on: nothing of them comes from the training shots'
generator. The noisy frames are what Blender writes for an artist with Denoising Data and Vector on; the references have
another seed and far more samples, in passes with seeds of their own: training.benchmark.run takes their mean, and tells from their
difference how noisy it still is. Frames that are there are skipped, so it can be stopped and started again. Wants bpy 5.0.1, numpy,
OpenEXR.
"""

from __future__ import annotations

import argparse
import sys
from functools import partial
from pathlib import Path

from training.benchmark.frames import SHOTS, SPP
from training.benchmark.settings import Settings
from training.shots.cycles.device import DEVICES
from training.shots.processes import run_all

FRAMES = tuple(range(1, 9))


def kind(text: str) -> str:
    """A number of samples, or reference."""
    if text != "reference" and not (text.isdecimal() and int(text) > 0):
        raise argparse.ArgumentTypeError(f"{text!r} is neither a number of samples nor reference")
    return text


def folders(kinds: list[str], passes: int) -> list[str]:
    """The folders of the kinds of frames: numbers of samples, and the reference's passes."""
    return [f"{kind}spp" for kind in kinds if kind.isdecimal()] + [f"pass{k + 1}" for k in range(passes) if "reference" in kinds]


def target_of(cache: Path, job: str) -> Path:
    shot, folder, frame = job.split()
    return cache / shot / folder / f"frame_{int(frame):04d}.exr"


def rendered(settings: Settings, job: str) -> str:
    """A job, such as `glass pass1 3`; a line about it, empty where it is there."""
    from training.benchmark import shot  # brings bpy, which changes the paths that further processes would inherit

    target = target_of(settings.cache, job)
    if target.exists():
        return ""
    name, folder, frame = job.split()
    seconds = shot.rendered(name, folder, int(frame), target, settings)
    return f"{name} {folder} frame {frame}: {seconds:.1f} s"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cache", type=Path, required=True, help="folder for the shots")
    parser.add_argument("--shots", nargs="+", choices=SHOTS, default=list(SHOTS))
    parser.add_argument("--spp", nargs="+", type=kind, default=[*map(str, SPP), "reference"], help="samples of noisy frames, or reference")
    parser.add_argument("--passes", type=int, default=4, help="of the references")
    parser.add_argument("--frames", type=int, nargs="+", default=list(FRAMES))
    parser.add_argument("--scale", type=int, default=1, help="render the middle of frames so many times as wide; 6: of 1920×1080")
    parser.add_argument("--threads", type=int, default=0, help="threads for Cycles, of each process; 0: all")
    parser.add_argument("--processes", type=int, default=1, help="that render at once")
    parser.add_argument("--device", choices=DEVICES, default="cpu", help="that Cycles renders on")
    chosen = parser.parse_args()
    settings = Settings(chosen.cache.resolve(), chosen.scale, chosen.threads, chosen.device)
    wanted = folders(chosen.spp, chosen.passes)
    jobs = [f"{shot} {folder} {frame}" for shot in chosen.shots for folder in wanted for frame in chosen.frames]
    left = [job for job in jobs if not target_of(settings.cache, job).exists()]
    lost = run_all(partial(rendered, settings), left, chosen.processes)
    if lost:
        sys.exit(f"not rendered: {', '.join(lost)}; run it again for these")


if __name__ == "__main__":
    main()

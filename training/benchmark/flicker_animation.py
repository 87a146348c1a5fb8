"""Makes the README's looping picture: a benchmark shot at 4 samples as rendered, by OIDN as Cycles runs it,
frame by frame, and by Hush.

    python -m training.benchmark.run --cache runs/benchmark --hush target/release/hush
    python -m training.benchmark.flicker_animation --cache runs/benchmark

It takes the frames that training.benchmark.run leaves behind and plays them to and fro: an animated PNG, or a GIF with fewer colours.
Needs Pillow, pyoidn, OpenEXR, numpy.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from PIL import Image as Pictures

from samples.pictures import Layout, picture
from training.benchmark import oidn
from training.benchmark.frames import SHOTS, SPP, Take, beauty, frame, numbers
from training.benchmark.tables import PEER

ROOT = Path(__file__).resolve().parents[2]

LAYOUT = Layout(4, 22, 13)


def reduced(sheets: list[Pictures.Image], colours: int) -> list[Pictures.Image]:
    """All with one palette, or the colours would flicker by themselves."""
    every = Pictures.fromarray(np.concatenate([np.asarray(s) for s in sheets]))
    palette = every.quantize(colours, method=Pictures.Quantize.MEDIANCUT, dither=Pictures.Dither.NONE)
    return [s.quantize(palette=palette, dither=Pictures.Dither.NONE) for s in sheets]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cache", type=Path, required=True, help="folder of training.benchmark.render")
    parser.add_argument("--results", type=Path, help="--out of training.benchmark.run (CACHE/results)")
    parser.add_argument("--shot", choices=SHOTS, default="interior")
    parser.add_argument("--spp", type=int, choices=SPP, default=4)
    parser.add_argument("--crop", type=int, nargs=4, default=[60, 22, 124, 108], metavar=("X", "Y", "WIDTH", "HEIGHT"))
    parser.add_argument("--zoom", type=int, default=2)
    parser.add_argument("--exposure", type=float, default=0.0, help="stops")
    parser.add_argument("--colours", type=int, default=255, help="of the palette, for a .gif")
    parser.add_argument("--milliseconds", type=int, default=120, help="a frame")
    parser.add_argument("--output", type=Path, default=ROOT / "docs" / "flicker.png", help=".png or .gif")
    chosen = parser.parse_args()
    take = Take(chosen.cache, chosen.shot, chosen.spp)
    results = chosen.results or chosen.cache / "results"
    folders = {
        f"Cycles, {chosen.spp} samples": take.noisy,
        "OIDN, frame by frame": take.peer(PEER, oidn.version()),
        "Hush, ±2 frames": results / take.shot / f"{take.spp}spp-window2",
    }
    shared = sorted(set.intersection(*(set(numbers(folder)) for folder in folders.values())))
    if not shared:
        raise SystemExit(f"no frame that is in all of {', '.join(map(str, folders.values()))}; run training.benchmark.run first")
    crops = [[(name, beauty(frame(folder, n))) for name, folder in folders.items()] for n in shared]
    sheets = [picture(frames, tuple(chosen.crop), chosen.zoom, chosen.exposure, LAYOUT) for frames in crops]
    frames = reduced(sheets, chosen.colours) if chosen.output.suffix == ".gif" else sheets
    frames += frames[-2:0:-1]
    chosen.output.parent.mkdir(parents=True, exist_ok=True)
    aside = chosen.output.with_suffix(f".part{chosen.output.suffix}")
    frames[0].save(aside, save_all=True, append_images=frames[1:], duration=chosen.milliseconds, loop=0, optimize=True)
    aside.replace(chosen.output)
    print(f"{chosen.output}: {frames[0].width}×{frames[0].height}, {len(frames)} frames, {chosen.output.stat().st_size // 1024} KB")


if __name__ == "__main__":
    main()

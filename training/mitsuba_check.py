"""Checks the motion vectors of Mitsuba's shots: warps the neighbours' albedo to the middle frame.

    python mitsuba_check.py shots

For each shot the mean absolute difference of the albedo where the vectors lead to a visible point (there and back within half a
pixel), warped and not warped.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import torch
from data import CENTRE, read_shot
from geometry import advance, displacements, grid, inside
from model import warped


def difference(path: Path) -> tuple[float, float, float]:
    """Mean albedo difference warped and unwarped, and the share of pixels compared."""
    shot = read_shot(path)
    start = grid(*shot.depth.shape[-2:])
    moved, still, counted = 0.0, 0.0, 0
    for step in (-1, 1):
        there = displacements(shot.vector[CENTRE])[step > 0]
        back = displacements(shot.vector[CENTRE + step])[step < 0]
        position = start + there
        home = advance(position, back)
        seen = inside(position) & ((home - start).norm(dim=0) < 0.5)
        ours, theirs = shot.albedo[CENTRE], shot.albedo[CENTRE + step]
        sampled = warped(theirs[None], position.nan_to_num(0)[None])[0]
        moved += float((sampled - ours).abs().mean(0)[seen].sum())
        still += float((theirs - ours).abs().mean(0)[seen].sum())
        counted += int(seen.sum())
    return moved / max(counted, 1), still / max(counted, 1), counted / (2 * start[0].numel())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("shots", type=Path, help="folder of NNNNNN.npz")
    rows = [(path.stem, *difference(path)) for path in sorted(parser.parse_args().shots.glob("*.npz"))]
    for name, moved, still, share in rows:
        print(f"{name}: {moved:.4f} warped, {still:.4f} not warped, {share:.2f} of the pixels")
    mean = [sum(row[k] for row in rows) / max(len(rows), 1) for k in (1, 2, 3)]
    print(f"mean of {len(rows)}: {mean[0]:.4f} warped, {mean[1]:.4f} not warped, {mean[2]:.2f} of the pixels")


if __name__ == "__main__":
    main()

"""Whether noisy frames have the mean of a benchmark's references: whether another Blender's frames may be measured against them.

    python -m training.benchmark.same_mean --cache runs/benchmark-5.2 --references runs/benchmark

Of each shot and number of samples, over blocks of 16×16 pixels of each frame that has a reference: how far the block's mean is from
the reference's, over the standard error that the differences inside the block give it. The root mean square is 1 where noise is all
there is; the references' own Blender is the control (the same command with --cache runs/benchmark). A change of the light anywhere
shows as blocks far above.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from training.benchmark.frames import SHOTS, SPP, Take, beauty, frame, numbers, takes

BLOCK = 16


def blocks(image: NDArray[np.float64]) -> NDArray[np.float64]:
    """(rows, columns) cut into (blocks, pixels of one); what is left over at the edges is left out."""
    rows, columns = (size // BLOCK * BLOCK for size in image.shape)
    cut = image[:rows, :columns].reshape(rows // BLOCK, BLOCK, columns // BLOCK, BLOCK)
    return cut.swapaxes(1, 2).reshape(-1, BLOCK * BLOCK)


def deviations(noisy: NDArray[np.float32], reference: NDArray[np.float32]) -> NDArray[np.float64]:
    """Of images (rows, columns, 3): each block's mean difference over its standard error; blocks without any difference are left out."""
    difference = blocks((noisy.astype(np.float64) - reference).mean(-1))
    error = difference.std(1, ddof=1) / BLOCK
    return difference.mean(1)[error > 0] / error[error > 0]


def of_take(take: Take) -> NDArray[np.float64]:
    """All blocks of a take's frames that have a reference."""
    pairs = [(beauty(frame(take.noisy, n)), beauty(frame(take.reference, n))) for n in numbers(take.reference)]
    return np.concatenate([deviations(*pair) for pair in pairs])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cache", type=Path, required=True, help="folder of the noisy frames")
    parser.add_argument("--references", type=Path, help="folder of the references, where it is another one")
    parser.add_argument("--shots", nargs="+", choices=SHOTS, default=list(SHOTS))
    parser.add_argument("--spp", nargs="+", type=int, default=list(SPP))
    chosen = parser.parse_args()
    print("| shot | spp | blocks | root mean square | mean | above 4 |\n| --- | --- | --- | --- | --- | --- |")
    for take in takes(chosen.cache, chosen.shots, chosen.spp, chosen.references):
        found = of_take(take)
        root, far = np.sqrt((found**2).mean()), (np.abs(found) > 4).sum()
        print(f"| {take.shot} | {take.spp} | {found.size} | {root:.2f} | {found.mean():+.3f} | {far} |", flush=True)


if __name__ == "__main__":
    main()

"""Scores of the project's sample shot (samples/): OIDN, and Hush by window and by λ.

    python -m training.benchmark.sample_shot --hush target/release/hush --out runs/sample-shot --update training/RESULTS.md

What is already in the folder is made again. Needs pyoidn.
"""

from __future__ import annotations

import argparse
import json
import subprocess
from collections.abc import Iterator, Sequence
from pathlib import Path

from training.benchmark import oidn, tables
from training.benchmark.frames import for_oidn, frame, numbers, write_beauty

SAMPLES = Path(__file__).resolve().parents[2] / "samples"
SHOT, REFERENCE = SAMPLES / "shot", SAMPLES / "reference"
SCORES = {"smape": "SMAPE", "relmse": "relMSE", "psnr": "PSNR", "ssim": "SSIM", "flip": "FLIP", "flicker": "flicker"}
OF_LAMBDA = ("smape", "relmse", "flicker")
DIGITS = {"psnr": 2, "ssim": 3}
LAMBDAS = (1, 4, 16, 64)


def scores(hush: Path, folder: Path) -> dict[str, float]:
    """What `hush eval` says of a folder, the mean of all frames."""
    command = [hush, "eval", REFERENCE, folder, "--vectors", SHOT, "--json"]
    return json.loads(subprocess.run(command, check=True, stdout=subprocess.PIPE).stdout)["mean"]


def by_oidn(folder: Path, method: str, threads: int) -> Path:
    with oidn.device(threads) as device:
        for number in numbers(SHOT):
            write_beauty(frame(folder, number), oidn.METHODS[method](device, *for_oidn(frame(SHOT, number))))
    return folder


def by_hush(hush: Path, folder: Path, *options: str) -> Path:
    subprocess.run([hush, "denoise", SHOT, "--output", folder, "--overwrite", "--quiet", "--no-settings", *options], check=True)
    return folder


def rows(hush: Path, out: Path, threads: int) -> Iterator[tuple[str, dict[str, float]]]:
    """Each method by its name, with its scores."""
    yield "noisy", scores(hush, SHOT)
    for method in oidn.METHODS:
        yield tables.METHODS[method], scores(hush, by_oidn(out / method, method, threads))
    for window in range(4):
        method = f"window{window}"
        yield tables.METHODS[method], scores(hush, by_hush(hush, out / method, "--window", str(window)))
    for value in LAMBDAS:
        yield str(value), scores(hush, by_hush(hush, out / f"lambda{value}", "--lambda", str(value)))


def shown(title: str, names: Sequence[str], found: dict[str, dict[str, float]], metrics: Sequence[str]) -> str:
    cells = ([name, *(tables.number(found[name][m], DIGITS.get(m, 4)) for m in metrics)] for name in names)
    return tables.table([title, *(SCORES[m] for m in metrics)], cells)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--hush", type=Path, required=True, help="the program")
    parser.add_argument("--out", type=Path, required=True, help="folder for the denoised frames")
    parser.add_argument("--threads", type=int, default=2, help="for OIDN")
    parser.add_argument("--update", type=Path, help="document to write the tables into")
    chosen = parser.parse_args()
    found = dict(rows(chosen.hush.resolve(), chosen.out, chosen.threads))
    of_lambda = [str(value) for value in LAMBDAS]
    first = shown(f"mean of {len(numbers(SHOT))} frames", [name for name in found if name not in of_lambda], found, list(SCORES))
    second = shown("λ, window ±2", [*of_lambda, "noisy"], found, OF_LAMBDA)
    text = f"OIDN {oidn.version()}.\n\n{first}\n\n{second}"
    print(text)
    if chosen.update:
        document = chosen.update.read_text(encoding="utf-8")
        chosen.update.write_text(tables.replaced(document, "sample-shot", text, "sample_shot.py"), encoding="utf-8")


if __name__ == "__main__":
    main()

"""Scores of the project's sample shot (samples/): OIDN, and Hush by window and by λ.

    python -m training.benchmark.sample_shot --hush target/release/hush --out runs/sample-shot --update training/RESULTS.md

What OIDN made is kept, Hush denoises anew. Needs pyoidn.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator, Sequence
from pathlib import Path

from training.benchmark import oidn, tables
from training.benchmark.frames import numbers
from training.benchmark.run import Hush, denoised_by_oidn

SAMPLES = Path(__file__).resolve().parents[2] / "samples"
SHOT, REFERENCE = SAMPLES / "shot", SAMPLES / "reference"
SCORES = {"smape": "SMAPE", "relmse": "relMSE", "psnr": "PSNR", "ssim": "SSIM", "flip": "FLIP", "flicker": "flicker"}
OF_LAMBDA = ("smape", "relmse", "flicker")
DIGITS = {"psnr": 2, "ssim": 3}
LAMBDAS = (4, 16, 64)  # beside 1, which window ±2 has


def scores(hush: Hush, folder: Path) -> dict[str, float]:
    """What `hush eval` says of a folder, the mean of all frames."""
    return json.loads(hush.run("eval", REFERENCE, folder, "--vectors", SHOT, "--json"))["mean"]


def by_hush(hush: Hush, folder: Path, *options: str) -> dict[str, float]:
    hush.run("denoise", SHOT, "--output", folder, *options, *hush.options)
    return scores(hush, folder)


def by_method(hush: Hush, out: Path, threads: int) -> Iterator[tuple[str, dict[str, float]]]:
    """Each method by its name, with its scores; λ is 1."""
    yield "noisy", scores(hush, SHOT)
    with oidn.device(threads) as device:
        for method in oidn.METHODS:
            folder = denoised_by_oidn(SHOT, out / f"{method}-{oidn.version()}", device, method)
            yield tables.METHODS[method], scores(hush, folder)
    for window in range(4):
        method = f"window{window}"
        yield tables.METHODS[method], by_hush(hush, out / method, "--window", str(window))


def shown(title: str, rows: dict[str, dict[str, float]], metrics: Sequence[str]) -> str:
    cells = ([name, *(tables.number(found[m], DIGITS.get(m, 4)) for m in metrics)] for name, found in rows.items())
    return tables.table([title, *(SCORES[m] for m in metrics)], cells)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--hush", type=Path, required=True, help="the program")
    parser.add_argument("--out", type=Path, required=True, help="folder for the denoised frames")
    parser.add_argument("--threads", type=int, default=2, help="for OIDN and Hush")
    parser.add_argument("--update", type=Path, help="document to write the tables into")
    chosen = parser.parse_args()
    hush = Hush(chosen.hush, None, chosen.threads)
    methods = dict(by_method(hush, chosen.out, chosen.threads))
    dial = {"1": methods[tables.METHODS["window2"]]}
    dial |= {str(value): by_hush(hush, chosen.out / f"lambda{value}", "--lambda", str(value)) for value in LAMBDAS}
    first = shown(f"mean of {len(numbers(SHOT))} frames", methods, list(SCORES))
    second = shown("λ, window ±2", dial | {"noisy": methods["noisy"]}, OF_LAMBDA)
    text = f"OIDN {oidn.version()}.\n\n{first}\n\n{second}"
    print(text)
    if chosen.update:
        document = chosen.update.read_text(encoding="utf-8")
        chosen.update.write_text(tables.replaced(document, "sample-shot", text, "sample_shot.py"), encoding="utf-8")


if __name__ == "__main__":
    main()

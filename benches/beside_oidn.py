"""Times Hush's bench and Open Image Denoise in turn, so that both meet the same machine.

python benches/beside_oidn.py [PAIRS] [--oidn VERSION]

The peer is OIDN as Cycles runs it by default: albedo and normal each filtered by itself, then the colour with cleanAux, all at quality
High; its time is that of the three. With the guides as rendered, at quality High and at Fast, it is a column each. All are timed through
pyoidn, one filter after the other on 1920×1080 float images in memory, as `oidnBenchmark` does it, which has no run of a guide alone.
A filter is committed before and run once to warm up; making filters, which Cycles does for each frame, is not in the time.

VERSION is that of pyoidn on PyPI; by default the one in training/requirements.txt. Where another one is installed, or none, it goes into
target/oidn/VERSION. The ratio of a pair is that of two runs right after each other; below 1 Hush is the faster one.
"""

from __future__ import annotations

import argparse
import importlib
import json
import os
import re
import statistics
import subprocess
import sys
import time
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
SIZE = (1080, 1920, 3)
RUNS = {"as Cycles runs it": 2, "high, raw guides": 10, "fast, raw guides": 10}


def run(command: list[str], env: dict[str, str]) -> str:
    return subprocess.run(command, check=True, capture_output=True, text=True, cwd=ROOT, env=env).stdout


def metadata_of_cargo() -> dict[str, Any]:
    return json.loads(run(["cargo", "metadata", "--format-version", "1", "--no-deps", "--locked"], dict(os.environ)))


def hush_milliseconds(target: Path) -> float:
    """The median frame of Hush's bench, from the numbers that it leaves for its next run."""
    env = {name: value for name, value in os.environ.items() if not name.startswith("HUSH_BENCH")}
    run(["cargo", "bench", "--quiet", "--locked", "--bench", "denoise"], env)
    measured = target / "criterion" / "denoise" / "1920x1080 window 2" / "new" / "estimates.json"
    return json.loads(measured.read_text())["median"]["point_estimate"] / 1e6


def default_version() -> str:
    found = re.search(r"^pyoidn==(\S+)$", (ROOT / "training" / "requirements.txt").read_text(), re.MULTILINE)
    if found is None:
        raise SystemExit("training/requirements.txt names no pyoidn")
    return found[1]


def installed() -> str | None:
    try:
        return metadata.version("pyoidn")
    except metadata.PackageNotFoundError:
        return None


def load(version: str, target: Path) -> Any:  # noqa: ANN401
    """pyoidn of this version, fetched where it is not installed."""
    if installed() != version:
        folder = target / "oidn" / version
        if not folder.is_dir():
            run(
                [sys.executable, "-m", "pip", "install", "--quiet", "--target", str(folder), f"pyoidn=={version}"],
                dict(os.environ),
            )
        sys.path.insert(0, str(folder))
    return importlib.import_module("pyoidn")


class Oidn:
    """Its filters on images of noise: what is in them does not change the time."""

    def __init__(self, module: Any) -> None:  # noqa: ANN401
        self.module, draw = module, np.random.default_rng(1)
        self.images = {name: draw.random(SIZE, np.float32) for name in ("color", "albedo", "normal")}

    def milliseconds(self, mode: str) -> float:
        """Of a frame: the median of the runs of each filter, added up."""
        quality = self.module.OIDN_QUALITY_FAST if mode.startswith("fast") else self.module.OIDN_QUALITY_HIGH
        steps = [(("color", "albedo", "normal"), mode == "as Cycles runs it")]
        if mode == "as Cycles runs it":
            steps = [(("albedo",), False), (("normal",), False), *steps]
        with self.module.Device() as device:
            device.commit()
            return sum(self.filter(device, names, clean_aux, quality, RUNS[mode]) for names, clean_aux in steps)

    def filter(self, device: Any, names: tuple[str, ...], clean_aux: bool, quality: int, runs: int) -> float:  # noqa: ANN401
        out, seconds = np.zeros(SIZE, np.float32), []
        with self.module.Filter(device, self.module.OIDN_FILTER_TYPE_RT) as made:
            for name in names:
                made.set_image(name, self.images[name], self.module.OIDN_FORMAT_FLOAT3)
            made.set_image(self.module.OIDN_IMAGE_OUTPUT, out, self.module.OIDN_FORMAT_FLOAT3)
            made.set_bool("hdr", "color" in names)
            made.set_bool("cleanAux", clean_aux)
            made.set_quality(quality)
            made.commit()
            for _ in range(1 + runs):
                began = time.perf_counter()
                made.execute()
                seconds.append(time.perf_counter() - began)
            problem = device.get_error()
        if problem is not None:
            raise SystemExit(f"OIDN failed: {problem}")
        return 1000 * statistics.median(seconds[1:])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("pairs", type=int, nargs="?", default=5, help="runs of each in turn")
    parser.add_argument("--oidn", default=default_version(), metavar="VERSION", help="of pyoidn on PyPI")
    chosen = parser.parse_args()
    target = Path(metadata_of_cargo()["target_directory"])
    oidn = Oidn(load(chosen.oidn, target))
    times: list[dict[str, float]] = []
    print(f"| ms a frame of 1080p | Hush, window ±2 | {' | '.join(f'OIDN {chosen.oidn} {mode}, ratio' for mode in RUNS)} |")
    print(f"|---|---|{'---|' * len(RUNS)}")
    for pair in range(chosen.pairs):
        found = {"Hush": hush_milliseconds(target), **{mode: oidn.milliseconds(mode) for mode in RUNS}}
        times.append(found)
        print(row(f"pair {pair + 1}", found["Hush"], {mode: (found[mode], found["Hush"] / found[mode]) for mode in RUNS}), flush=True)
    median = lambda of: statistics.median(map(of, times))
    peers = {mode: (median(lambda t, m=mode: t[m]), median(lambda t, m=mode: t["Hush"] / t[m])) for mode in RUNS}
    print(row("medians", median(lambda t: t["Hush"]), peers))


def row(name: str, hush: float, peers: dict[str, tuple[float, float]]) -> str:
    return f"| {name} | {hush:.0f} | {' | '.join(f'{peer:.0f}, {ratio:.3f}' for peer, ratio in peers.values())} |"


if __name__ == "__main__":
    main()

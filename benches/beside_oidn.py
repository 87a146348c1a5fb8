"""Times Hush's bench and Open Image Denoise's own benchmark in turn, so that both meet the same machine.

pip install pyoidn==2.5.1.0
python benches/beside_oidn.py [PAIRS]

The ratio of a pair is that of two runs of ten frames of 1080p, one right after the other; below 1 Hush is the faster one.
"""

from __future__ import annotations

import json
import os
import re
import statistics
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent


def run(command: list[str], env: dict[str, str]) -> str:
    return subprocess.run(command, check=True, capture_output=True, text=True, cwd=ROOT, env=env).stdout


def hush_milliseconds() -> float:
    """The median frame of Hush's bench, from the numbers that it leaves for its next run."""
    env = {name: value for name, value in os.environ.items() if not name.startswith("HUSH_BENCH")}
    run(["cargo", "bench", "--quiet", "--locked", "--bench", "denoise"], env)
    metadata = json.loads(run(["cargo", "metadata", "--format-version", "1", "--no-deps", "--locked"], env))
    measured = Path(metadata["target_directory"]) / "criterion" / "denoise" / "1920x1080 window 2" / "new" / "estimates.json"
    return json.loads(measured.read_text())["median"]["point_estimate"] / 1e6


def oidn_milliseconds(oidn: Path) -> float:
    env = os.environ | {"LD_LIBRARY_PATH": str(oidn / "lib")}
    text = run([str(oidn / "bin" / "oidnBenchmark"), "-r", "RT.hdr_alb_nrm.1920x1080", "-n", "10"], env)
    found = re.search(r"([0-9.]+) msec/image", text)
    if found is None:
        raise SystemExit(f"oidnBenchmark printed no time:\n{text}")
    return float(found[1])


def main() -> None:
    pairs = int(sys.argv[1]) if len(sys.argv) > 1 else 5
    spec = find_spec("pyoidn")
    if spec is None or spec.origin is None:
        raise SystemExit("pyoidn is not installed: pip install pyoidn==2.5.1.0")
    oidn = Path(spec.origin).parent / "oidn"
    times = []
    for _ in range(pairs):
        hush, peer = hush_milliseconds(), oidn_milliseconds(oidn)
        times.append((hush, peer))
        print(f"Hush {hush:.0f} ms, OIDN {peer:.0f} ms, ratio {hush / peer:.3f}", flush=True)
    median = statistics.median
    print(f"medians: Hush {median(t[0] for t in times):.0f} ms, OIDN {median(t[1] for t in times):.0f} ms, ", end="")
    print(f"ratio of pairs {median(a / b for a, b in times):.3f}")


if __name__ == "__main__":
    main()

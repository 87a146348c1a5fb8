"""Times Hush's bench and Open Image Denoise's own benchmark in turn, so that both meet the same machine.

cargo build --release --bench denoise
pip install pyoidn==2.5.1.0
python benches/beside_oidn.py [PAIRS]
"""

from __future__ import annotations

import os
import re
import statistics
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
NUMBER = r"([0-9.]+)"


def milliseconds(command: list[str], pattern: str, env: dict[str, str] | None = None) -> float:
    """Runs a command and returns the number that `pattern` finds in what it prints."""
    text = subprocess.run(command, check=True, capture_output=True, text=True, cwd=ROOT, env=env).stdout
    found = re.search(pattern, text)
    if found is None:
        raise SystemExit(f"{command[0]} printed no time:\n{text}")
    return float(found[1])


def main() -> None:
    pairs = int(sys.argv[1]) if len(sys.argv) > 1 else 5
    spec = find_spec("pyoidn")
    if spec is None or spec.origin is None:
        raise SystemExit("pyoidn is not installed: pip install pyoidn==2.5.1.0")
    oidn = Path(spec.origin).parent / "oidn"
    env = os.environ | {"LD_LIBRARY_PATH": str(oidn / "lib")}
    hush_command = ["cargo", "bench", "--quiet", "--bench", "denoise", "--", "1920", "1080", "2", "4"]
    oidn_command = [str(oidn / "bin" / "oidnBenchmark"), "-r", "RT.hdr_alb_nrm.1920x1080", "-n", "4"]
    times = []
    for _ in range(pairs):
        hush = milliseconds(hush_command, NUMBER + r" ms/frame")
        peer = milliseconds(oidn_command, NUMBER + r" msec/image", env)
        times.append((hush, peer))
        print(f"Hush {hush:.0f} ms, OIDN {peer:.0f} ms, ratio {hush / peer:.3f}", flush=True)
    median = statistics.median
    print(f"medians: Hush {median(t[0] for t in times):.0f} ms, OIDN {median(t[1] for t in times):.0f} ms, ", end="")
    print(f"ratio of pairs {median(a / b for a, b in times):.3f}")


if __name__ == "__main__":
    main()

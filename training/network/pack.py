"""Packs shots, code and weights for a machine without a network that has PyTorch, NumPy and safetensors.

    python -m training.network.pack runs/pack --shots runs/shots --weights models/hush.safetensors

It writes pack.000, pack.001 … of at most --chunk megabytes, pack.sha256 and unpack.sh. Bring the folder over, in as many steps and in
whatever order it takes, and there:

    sh unpack.sh FOLDER && FOLDER/train --device cuda --batch 64 --rate 2e-3 --seconds 540 --every 60
    FOLDER/export --out weights.safetensors

FOLDER/train trains on the shots of the pack, in FOLDER/run, from the weights of the pack; a second start goes on. --resume packs a
checkpoint that it goes on from. PYTHON names another interpreter than python3.
"""

from __future__ import annotations

import argparse
import tarfile
from collections.abc import Iterator
from pathlib import Path

from training.data.shots import shot_paths
from training.shots.cycles.pack import UNPACK, Chunks, script

ROOT = Path(__file__).resolve().parents[2]
CODE = ("*.py", "*.h", "*.cpp", "*.cu")
TRAIN = '--shots "$here/shots" --out "$here/run"'
EXPORT = '"$here/run/checkpoint.pt" --shots "$here/shots"'
START = """#!/bin/sh
here=$(cd "$(dirname "$0")" && pwd)
export PYTHONPATH="$here/code" PYTHONUNBUFFERED=1
exec "${PYTHON:-python3}" -m MODULE ARGUMENTS "$@"
"""


def code() -> Iterator[Path]:
    """What training imports: the whole of its package but for the benchmark and its tests."""
    for pattern in CODE:
        for path in sorted((ROOT / "training").rglob(pattern)):
            if "benchmark" not in path.parts and not path.name.startswith(("test_", "example_")):
                yield path


def contents(shots: list[Path], weights: Path | None, resume: Path | None) -> Iterator[tuple[Path, str]]:
    """Each file with its name in the pack: code and weights first."""
    for path in code():
        yield path, f"code/{path.relative_to(ROOT)}"
    if weights:
        yield weights, f"start{weights.suffix}"
    if resume:
        yield resume, "run/checkpoint.pt"
    for path in shots:
        yield path, f"shots/{path.name}"


def programs(weights: Path | None) -> Iterator[tuple[str, str]]:
    """The programs of the pack: name and text."""
    start = f' --start "$here/start{weights.suffix}"' if weights else ""
    for module, arguments in (("train", TRAIN + start), ("export", EXPORT)):
        yield module, START.replace("MODULE", f"training.network.{module}").replace("ARGUMENTS", arguments)


def write(output: Path, shots: list[Path], weights: Path | None, resume: Path | None, size: int) -> int:
    """Writes a pack into a folder, in pieces of at most `size` bytes, and returns their number."""
    output.mkdir(parents=True, exist_ok=True)
    for old in output.glob("pack.*"):
        old.unlink()
    # Shots are compressed as they are: so is the pack.
    with Chunks(output, size) as pieces, tarfile.open(fileobj=pieces, mode="w|") as pack:
        for name, text in programs(weights):
            about, content = script(text)
            about.name = name
            pack.addfile(about, content)
        for path, name in contents(shots, weights, resume):
            pack.add(path.resolve(), name, recursive=False)
    (output / "unpack.sh").write_text(UNPACK.replace("tar -xJ", "tar -x"))
    return len(pieces.sums)


def main() -> None:
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("output", type=Path, help="folder for the pieces")
    p.add_argument("--shots", type=Path, nargs="+", required=True, help="folders of shots")
    p.add_argument("--weights", type=Path, help="a weights file or a checkpoint to start from")
    p.add_argument("--resume", type=Path, help="a checkpoint to go on from")
    p.add_argument("--chunk", type=int, default=60, help="megabytes of a piece at most")
    a = p.parse_args()
    found = shot_paths(a.shots)
    pieces = write(a.output, found, a.weights, a.resume, a.chunk * 1_000_000)
    print(f"{len(found)} shots, {pieces} pieces in {a.output}")


if __name__ == "__main__":
    main()

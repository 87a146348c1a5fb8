"""Denoises a shot in chunks, as the tasks of a render farm would: python examples/farm_wrapper.py SHOT OUTPUT --frames 1-48

Each chunk is one call of `hush denoise --frames A-B --json`. Its events tell how far it is and why a frame failed; its exit code whether
to try again. Chunks may be retried and repeated freely: frames that are there are skipped, and their bits do not depend on the chunk.
"""

from __future__ import annotations

import argparse
import json
import re
import shutil
import subprocess
import sys
import time

# What `hush denoise` exits with.
GOOD, NOTHING, PARTLY, SWITCHED_OFF, STOPPED = 0, 1, 2, 3, 130
# A killed or interrupted task and one with bad frames may go better; the others would end the same way.
WORTH_RETRYING = {PARTLY, STOPPED}


def chunks(frames: str, size: int) -> list[str]:
    """`1-48` in pieces of `size` frames: `1-8`, `9-16`, ….

    >>> chunks("1-10,20", 4)
    ['1-4', '5-8', '9-10', '20-20']
    >>> chunks("-3-1", 4)
    ['-3-0', '1-1']
    """
    pieces = []
    for part in frames.split(","):
        ends = re.fullmatch(r"\s*(-?\d+)\s*(?:-\s*(-?\d+))?\s*", part)
        if not ends:
            raise SystemExit(f"--frames: {part!r} is no frame or range: write 1-48,60")
        first, last = int(ends[1]), int(ends[2] or ends[1])
        pieces += [f"{start}-{min(start + size - 1, last)}" for start in range(first, last + 1, size)]
    return pieces


def run(command: list[str], name: str) -> int:
    """One task: passes on what its events say, and returns its exit code."""
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        for line in process.stdout or []:
            event = json.loads(line)
            match event["event"]:
                case "frame":
                    print(f"[{name}] frame {event['frame']} {event['status']} ({event['finished']}/{event['frames']})", flush=True)
                case "warning" | "error":
                    print(f"[{name}] {event['event']}: {event['message']}", file=sys.stderr, flush=True)
                case "done" if event["failed"] or event["missing"]:
                    print(f"[{name}] failed: {event['failed']}, missing: {event['missing'] or 'none'}", file=sys.stderr, flush=True)
    # A process that a signal ended has a negative code.
    return process.returncode if process.returncode >= 0 else STOPPED


def merged(codes: list[int]) -> int:
    """One exit code for the shot: that of all chunks where they agree, else 2, for a part of it is there.

    >>> merged([0, 0]), merged([0, 1]), merged([1, 1]), merged([3, 3]), merged([0, 130])
    (0, 2, 1, 3, 2)
    """
    return codes[0] if len(set(codes)) == 1 else PARTLY


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split(":")[0] + ".")
    parser.add_argument("shot", help="folder of the rendered frames")
    parser.add_argument("output", help="folder for the denoised ones, the same for all chunks")
    parser.add_argument("--frames", required=True, help="such as 1-48 or 1-48,60-72")
    parser.add_argument("--chunk", type=int, default=8, help="frames of a chunk; 8 to 32 are a good size")
    parser.add_argument("--retries", type=int, default=1, help="further tries for a chunk with failed frames")
    parser.add_argument("--hush", default="hush", help="the program")
    arguments, options = parser.parse_known_args()
    if shutil.which(arguments.hush) is None:
        raise SystemExit(f"--hush: there is no program {arguments.hush} on the path: give its whole path")
    codes = []
    # On a farm these are tasks on machines; they may write into one folder at once.
    for piece in chunks(arguments.frames, arguments.chunk):
        command = [arguments.hush, "denoise", arguments.shot, "--output", arguments.output, f"--frames={piece}", "--json", *options]
        code = run(command, piece)
        for attempt in range(arguments.retries):
            if code not in WORTH_RETRYING:
                break
            time.sleep(attempt)
            print(f"[{piece}] exit code {code}, trying again", file=sys.stderr, flush=True)
            code = run(command, piece)
        codes.append(code)
    print(f"{len(codes)} chunks, exit codes {codes}")
    return merged(codes)


if __name__ == "__main__":
    sys.exit(main())

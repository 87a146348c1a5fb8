# SPDX-FileCopyrightText: 2026 Hush authors
# SPDX-License-Identifier: Apache-2.0
"""Denoises in a process of its own, so that Blender stays usable. Not part of the add-on's module: `job.py` starts it.

The first line of standard input is the job as JSON: `path` (folders to import from) and `runs` (`arguments` of
`hush.denoise_sequence`, and `warnings` that are told first).
A second line, or the end of the input as when Blender ends, stops it after the frame in hand. On standard output each event is a line
of JSON with the number of its `run`; the last one is `finished` with the `results`, or `refused` with a `message`.
"""

import json
import os
import signal
import sys
import threading
from collections.abc import Callable
from typing import Any


def main() -> int:
    """Does the job; 0 where all runs came to their end."""
    # Ctrl-C goes to Blender too, which then says what to do.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    tell = speaker()
    job = json.loads(sys.stdin.readline())
    stopped = listen()
    sys.path[:0] = job["path"]
    try:
        import hush
    except ImportError as error:
        tell({"event": "refused", "message": f"The Hush library does not load: {error}"})
        return 1
    results = []
    for number, run in enumerate(job["runs"]):
        arguments = run["arguments"]
        if isinstance(arguments["lam"], dict):
            arguments["lam"] = {int(frame): value for frame, value in arguments["lam"].items()}
        progress = lambda event, number=number: tell({**event, "run": number})
        try:
            for message in run["warnings"]:
                progress({"event": "warning", "kind": "note", "message": message})
            results.append(hush.denoise_sequence(**arguments, progress=progress, cancel=stopped.is_set))
        except (OSError, ValueError, TypeError, MemoryError, hush.HushError) as error:
            tell({"event": "refused", "run": number, "message": str(error) or type(error).__name__})
            return 1
        if stopped.is_set():
            break
    tell({"event": "finished", "results": results, "stopped": stopped.is_set()})
    return 0


def listen() -> threading.Event:
    """Set once a further line, or the end of the input, says to stop."""
    stopped = threading.Event()

    def wait() -> None:
        sys.stdin.readline()
        stopped.set()

    threading.Thread(target=wait, daemon=True).start()
    return stopped


def speaker() -> Callable[[dict[str, Any]], None]:
    """Writes events to the real standard output; whatever else prints goes to standard error."""
    lines = os.fdopen(os.dup(1), "w", encoding="utf-8", buffering=1)
    os.dup2(2, 1)

    def tell(event: dict[str, Any]) -> None:
        try:
            lines.write(json.dumps(event) + "\n")
        except OSError:
            # Blender is gone; the end of the input stops the run.
            pass

    return tell


if __name__ == "__main__":
    sys.exit(main())

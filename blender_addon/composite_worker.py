# SPDX-FileCopyrightText: 2026 Hush authors
# SPDX-License-Identifier: Apache-2.0
"""Composites a copy of the artist's file in a Blender of its own. Not part of the add-on's module: `composite.py` starts it.

The first line of standard input is the job as JSON, see `composite_plan.work`. A second line, or the end of the input as when the other
Blender ends, stops it after the frame in hand. On standard output each event is a line of JSON, see `composite_run`; the last one is
`finished`, or `refused` with a `message`.
"""

import importlib
import json
import shutil
import signal
import sys
import types
from pathlib import Path


def main() -> int:
    """Does the job; 0 where it came to its end."""
    # Ctrl-C goes to the other Blender too, which then says what to do.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # The add-on's files without the add-on: its own `__init__` is not run.
    parts = types.ModuleType("hush_parts")
    parts.__path__ = [str(Path(__file__).parent)]
    sys.modules["hush_parts"] = parts
    worker = importlib.import_module("hush_parts.worker")
    tell = worker.speaker()
    work = json.loads(sys.stdin.readline())
    stopped = worker.listen()
    sys.path[:0] = [path for path in work["path"] if path not in sys.path]
    try:
        importlib.import_module("hush_parts.composite_run").run(work, tell, stopped)
    except Exception as error:
        tell({"event": "refused", "message": f"{error}" or type(error).__name__})
        return 1
    finally:
        shutil.rmtree(work["aside"], ignore_errors=True)
    tell({"event": "finished", "stopped": stopped.is_set()})
    return 0


if __name__ == "__main__":
    sys.exit(main())

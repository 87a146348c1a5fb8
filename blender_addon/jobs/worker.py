# SPDX-FileCopyrightText: 2026 Hush authors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Does the work of a job in a process of its own, so that Blender stays usable. Not part of the add-on's module: `job.py` starts it.

The first line of standard input is the work as JSON: `module` (whose `run` does it), `path` (folders to import from), and what the module
wants. A second line, or the end of the input as when Blender ends, stops it as soon as it can be. On standard output each event is a line
of JSON; the last one is `finished` with what `run` returned, or `refused` with a `message`.
"""

import importlib
import json
import os
import signal
import sys
import threading
import types
from collections.abc import Callable
from pathlib import Path
from typing import Any


def main() -> int:
    """Does the work; 0 where it came to its end."""
    # Ctrl-C goes to Blender too, which then says what to do.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # The add-on's files without the add-on: its own `__init__` is not run.
    parts = types.ModuleType("hush_parts")
    parts.__path__ = [str(Path(__file__).parents[1])]
    sys.modules["hush_parts"] = parts
    tell = _speaker()
    work = json.loads(sys.stdin.readline())
    stopped = _listen()
    sys.path[:0] = [path for path in work["path"] if path not in sys.path]
    try:
        end = importlib.import_module(f"hush_parts.{work['module']}").run(work, tell, stopped)
    except ImportError as error:
        end = {"event": "refused", "message": f"The Hush library does not load: {error}"}
    except Exception as error:
        end = {"event": "refused", "message": str(error) or type(error).__name__}
    tell({"event": "finished", **end})
    return int(end.get("event") == "refused")


def _listen() -> threading.Event:
    """Set once a further line, or the end of the input, says to stop."""
    stopped = threading.Event()

    def wait() -> None:
        sys.stdin.readline()
        stopped.set()

    threading.Thread(target=wait, daemon=True).start()
    return stopped


def _speaker() -> Callable[[dict[str, Any]], None]:
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

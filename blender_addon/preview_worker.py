# SPDX-FileCopyrightText: 2026 Hush authors
# SPDX-License-Identifier: Apache-2.0
"""Denoises one frame in a process of its own. Not part of the add-on's module: `preview_job.py` starts it.

The first line of standard input is the job as JSON: `path` (folders to import from), `folder` (where to put the images, as .npy),
`file` (the frame's), `border` (left, bottom, right, top, each 0…1, or null) and `arguments` (of `hush.preview`). A second line, or the
end of the input as when Blender ends, stops it. On standard output each event is a line of JSON: `progress` with a `fraction`; the last
one is `finished` with what `hush.preview` tells besides the images, or `refused` with a `message`.
"""

import importlib
import json
import os
import signal
import sys
import types
from pathlib import Path
from typing import Any

IMAGES = ("noisy", "denoised", "previous", "flicker", "noisy_flicker")


def main() -> int:
    """Does the job; 0 where the images are there."""
    # Ctrl-C goes to Blender too, which then says what to do.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # The add-on's files without the add-on: its own `__init__` is not run.
    parts = types.ModuleType("hush_parts")
    parts.__path__ = [str(Path(__file__).parent)]
    sys.modules["hush_parts"] = parts
    worker = importlib.import_module("hush_parts.worker")
    tell = worker.speaker()
    job = json.loads(sys.stdin.readline())
    stopped = worker.listen()
    sys.path[:0] = job["path"]
    try:
        import hush
        import numpy as np
    except ImportError as error:
        tell({"event": "refused", "message": f"The Hush library does not load: {error}"})
        return 1
    try:
        arguments, notes = _fitted(hush, job)
        progress = lambda fraction: tell({"event": "progress", "fraction": fraction})
        told = hush.preview(**arguments, progress=progress, cancel=stopped.is_set)
        for name in IMAGES:
            image = told.pop(name, None)
            if image is not None:
                np.save(os.path.join(job["folder"], f"{name}.npy"), image)
    except (OSError, ValueError, TypeError, MemoryError, hush.HushError) as error:
        tell({"event": "refused", "message": str(error) or type(error).__name__})
        return 1
    tell({**told, "event": "finished", "notes": [*notes, *told["notes"]]})
    return 0


def _fitted(hush: Any, job: dict[str, Any]) -> tuple[dict[str, Any], list[str]]:  # noqa: ANN401 (the module)
    """The arguments with the border in the file's pixels, and without view layers that the file does not have; what was left out."""
    arguments, file = job["arguments"], job["file"]
    layout = hush.inspect(file)
    if job["border"] is not None:
        arguments["region"] = _pixels(job["border"], layout["columns"], layout["rows"])
    there = {layer["name"] for layer in layout["layers"]}
    strange = [name for name in arguments["layers"] if name not in there]
    arguments["layers"] = [name for name in arguments["layers"] if name in there]
    if arguments["vector_layer"] and arguments["vector_layer"] not in there:
        strange.append(arguments["vector_layer"])
        arguments["vector_layer"] = None
    if not strange or there == {""}:
        return arguments, []
    return arguments, [f"{os.path.basename(file)} has no view layer {' and '.join(strange)}, only {', '.join(sorted(there))}"]


def _pixels(border: list[float], columns: int, rows: int) -> tuple[int, int, int, int] | None:
    """The border as x, y, width, height from the upper left corner; None for the whole frame."""
    left, bottom, right, top = (min(max(value, 0.0), 1.0) for value in border)
    x, end = int(left * columns), max(int(left * columns) + 1, round(right * columns))
    y, low = int((1 - top) * rows), max(int((1 - top) * rows) + 1, round((1 - bottom) * rows))
    x, y = min(x, columns - 1), min(y, rows - 1)
    region = (x, y, min(end, columns) - x, min(low, rows) - y)
    return None if region == (0, 0, columns, rows) else region


if __name__ == "__main__":
    sys.exit(main())

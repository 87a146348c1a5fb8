# SPDX-FileCopyrightText: 2026 Hush authors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Denoises one frame into images. Only for the process that does it.

Events: `progress` with a `fraction`; the last one has what `hush.preview` tells besides the images.
"""

import os
import threading
from collections.abc import Callable
from typing import Any

import hush
import numpy as np

IMAGES = ("noisy", "denoised", "previous", "flicker", "noisy_flicker")


def run(work: dict[str, Any], tell: Callable[[dict[str, Any]], None], stopped: threading.Event) -> dict[str, Any]:
    """Puts the images, as .npy, into the `folder` of the work.

    Of the frame there are its `file`, the `border` (left, bottom, right, top, each 0…1, or null) and `arguments` of `hush.preview`.
    """
    arguments, notes = _fitted(work)
    progress = lambda fraction: tell({"event": "progress", "fraction": fraction})
    made = hush.preview(**arguments, progress=progress, cancel=stopped.is_set)
    for name in IMAGES:
        image = made.pop(name, None)
        if image is not None:
            np.save(os.path.join(work["folder"], f"{name}.npy"), image)
    return {**made, "notes": [*notes, *made["notes"]]}


def _fitted(work: dict[str, Any]) -> tuple[dict[str, Any], list[str]]:
    """The arguments with the border in the file's pixels, and without view layers that the file does not have; what was left out."""
    arguments, file = work["arguments"], work["file"]
    layout = hush.inspect(file)
    if work["border"] is not None:
        arguments["region"] = _pixels(work["border"], layout["columns"], layout["rows"])
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

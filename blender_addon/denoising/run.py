# SPDX-FileCopyrightText: 2026 Hush authors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Denoises the sequences of a shot, one after the other. Only for the process that denoises.

Events are those of `hush.denoise_sequence`, each with the number of its `run`.
"""

import threading
from collections.abc import Callable
from typing import Any

import hush


def run(work: dict[str, Any], tell: Callable[[dict[str, Any]], None], stopped: threading.Event) -> dict[str, Any]:
    """Does the `runs` of the work, each with `arguments` of `hush.denoise_sequence` and `warnings` that come first."""
    results = []
    for number, one in enumerate(work["runs"]):
        arguments = one["arguments"]
        if isinstance(arguments["lam"], dict):
            arguments["lam"] = {int(frame): value for frame, value in arguments["lam"].items()}
        progress = lambda event, number=number: tell({**event, "run": number})
        for message in one["warnings"]:
            progress({"event": "warning", "kind": "note", "message": message})
        try:
            results.append(hush.denoise_sequence(**arguments, progress=progress, cancel=stopped.is_set))
        except (OSError, ValueError, TypeError, MemoryError, hush.HushError) as error:
            return {"event": "refused", "run": number, "message": str(error) or type(error).__name__}
        if stopped.is_set():
            break
    return {"results": results, "stopped": stopped.is_set()}

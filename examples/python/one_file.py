"""EXR files to denoised ones: the same layers, passes, metadata and compression, with only the beauty's pixels changed.

Wants the wheel: python examples/python/one_file.py [INPUT.exr OUTPUT_FOLDER]
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path
from typing import Any

import hush

sample = Path(__file__).resolve().parents[2] / "samples" / "shot" / "frame_0004.exr"
arguments = [Path(argument) for argument in sys.argv[1:]]
source = arguments[0] if arguments else sample
output = arguments[1] if len(arguments) > 1 else Path(tempfile.mkdtemp(prefix="hush"))


def tell(event: dict[str, Any]) -> None:
    """Hears of everything that happens: these are the events that `hush denoise --json` prints."""
    if event["event"] == "frame":
        print(f"frame {event['frame']}: {event['status']} in {event['seconds']:.2f} s")


# A folder or a pattern such as frame_####.exr in place of the file would be the whole shot. The rendered files are never written to.
summary = hush.denoise_sequence(source, output, keep_noisy=True, progress=tell)
written = output / source.name
print(f"wrote {written}, {summary['written']} of {summary['frames']} frames")
assert written.is_file() and not summary["failed"]

"""What the renderer of the benchmark is told; a file without bpy, as the process that starts the others must not have it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Settings:
    """Where the frames go, the middle of what frames they are (1: whole ones), and on what they are rendered."""

    cache: Path
    scale: int
    threads: int
    device: str

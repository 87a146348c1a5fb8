"""What the renderer of training shots is told; a file without bpy, as the process that starts the others must not have it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Quality:
    """How long things are rendered: noisy takes of each frame; of each half of a reference the samples a pixel at most, the noise
    threshold of adaptive sampling and the seconds at most."""

    takes: int
    samples: int
    threshold: float
    seconds: float


@dataclass(frozen=True)
class Settings:
    """Where the shots go, how they are rendered and on what; `size` is a shot's side in pixels, `largest` how many times that the side of
    the frame that it is a part of."""

    output: Path
    assets: Path
    size: int
    largest: float
    quality: Quality
    threads: int
    device: str

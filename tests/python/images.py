"""Reading multilayer EXR files with the official package, and comparing images."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR


@dataclass
class Part:
    """One part of a file: its attributes (without what the writer derives) and its channels' pixels."""

    attributes: dict[str, Any]
    channels: dict[str, np.ndarray]


def parts(path: Path) -> dict[str, Part]:
    """All parts of a file by name."""
    found = {}
    for part in OpenEXR.File(str(path), separate_channels=True).parts:
        attributes = {name: value for name, value in part.header.items() if name not in ("channels", "chunkCount")}
        found[part.name()] = Part(attributes, {name: channel.pixels for name, channel in part.channels.items()})
    return found


def channels(path: Path) -> dict[str, np.ndarray]:
    """All channels of a file by name."""
    return {name: pixels for part in parts(path).values() for name, pixels in part.channels.items()}


def layer(path: Path, name: str) -> np.ndarray:
    """The R, G and B of a pass such as `ViewLayer.Combined`, (height, width, 3), float32."""
    planes = channels(path)
    return np.stack([planes[f"{name}.{c}"] for c in "RGB"], -1).astype(np.float32)


def combined(path: Path) -> np.ndarray:
    return layer(path, "ViewLayer.Combined")


def frames(folder: Path) -> list[Path]:
    return sorted(folder.glob("*.exr"))


def smape(image: np.ndarray, reference: np.ndarray) -> float:
    """Symmetric mean absolute percentage error with the field's ε of 0.01; 0 is equal."""
    return float(np.mean(np.abs(image - reference) / (np.abs(image) + np.abs(reference) + 1e-2)))


def flicker(images: list[np.ndarray], references: list[np.ndarray]) -> float:
    """How much the error changes from frame to frame, after the curve x / (1 + x); what moves in the reference does not count."""
    curve = lambda x: np.clip(x, 0, None) / (1 + np.clip(x, 0, None))
    errors = [curve(image) - curve(reference) for image, reference in zip(images, references, strict=True)]
    return float(np.mean([np.abs(b - a).mean() for a, b in zip(errors, errors[1:], strict=False)]))

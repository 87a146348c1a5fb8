"""Small shots of multilayer EXR files, made from noise: two view layers, guides, motion vectors."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import OpenEXR

Passes = dict[str, np.ndarray]
HEIGHT, WIDTH = 45, 67


def passes(number: int, height: int = HEIGHT, width: int = WIDTH, seed: int = 0) -> Passes:
    """The passes of one frame as `hush.Denoiser.push` names them, float32."""
    random = np.random.default_rng([seed, number])
    image = lambda channels: random.random((height, width, channels), np.float32)
    vector = 4 * image(4) - 2
    return {
        "color": np.exp(4 * image(3) - 2).astype(np.float32),
        "albedo": image(3),
        "normal": 2 * image(3) - 1,
        "depth": 1 + 20 * image(1)[:, :, 0],
        "vector": vector.astype(np.float32),
    }


def write_frame(path: Path, layers: dict[str, Passes]) -> None:
    """Writes a single-part file with these view layers, as Blender 4 does."""
    names = {
        "color": ("Combined", "RGB"),
        "albedo": ("Denoising Albedo", "RGB"),
        "normal": ("Denoising Normal", "XYZ"),
        "depth": ("Denoising Depth", "Z"),
        "vector": ("Vector", "XYZW"),
        "mask": ("Hush Lambda", "X"),
    }
    channels = {}
    for layer, found in layers.items():
        for name, image in found.items():
            title, letters = names[name]
            for i, letter in enumerate(letters):
                plane = image if image.ndim == 2 else image[:, :, i]
                channels[f"{layer}.{title}.{letter}"] = np.ascontiguousarray(plane)
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File(header, channels).write(str(path))


def write_shot(folder: Path, count: int, layers: tuple[str, ...] = ("ViewLayer",)) -> Path:
    """Writes frames 1…count into the folder; each layer has noise of its own."""
    folder.mkdir(parents=True, exist_ok=True)
    for number in range(1, count + 1):
        frame = {layer: passes(number, seed=i) for i, layer in enumerate(layers)}
        write_frame(folder / f"f_{number:04d}.exr", frame)
    return folder

"""Random BSDFs, textures and skies for Mitsuba's scenes."""

from __future__ import annotations

import colorsys
import math
import random
from typing import Any

import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

Plugin = dict[str, Any]
METALS = ("Au", "Ag", "Al", "Cu", "Cr", "W", "Ni_palik", "none")


def rgb(r: random.Random, strength: float = 1.0) -> Plugin:
    """A nearly white light colour."""
    warm = r.gauss(0, 0.25)
    return {"type": "rgb", "value": [strength * math.exp(warm), strength, strength * math.exp(-warm)]}


def colour(r: random.Random) -> list[float]:
    return list(colorsys.hsv_to_rgb(r.random(), r.random() ** 1.5 * 0.95, r.uniform(0.05, 0.95)))


def noise(rng: np.random.Generator, size: int, octaves: int) -> NDArray[np.float32]:
    """Tiling value noise in [0, 1]."""
    out = np.zeros((size, size))
    for k in range(octaves):
        cells = 4 << k
        coarse = rng.random((cells, cells))
        at = np.arange(size) * cells / size
        low, part = at.astype(int), (at % 1)
        part = part * part * (3 - 2 * part)
        high = (low + 1) % cells
        rows = coarse[low] * (1 - part)[:, None] + coarse[high] * part[:, None]
        out += (rows[:, low] * (1 - part) + rows[:, high] * part) * 0.6**k
    return ((out - out.min()) / max(np.ptp(out), 1e-9)).astype(np.float32)


def pattern(r: random.Random) -> NDArray[np.float32]:
    """A picture of 128×128 in [0, 1]: marble, wood, bricks, dots or speckles."""
    rng = np.random.default_rng(r.randrange(1 << 31))
    size = 128
    v, u = np.meshgrid(np.arange(size) / size, np.arange(size) / size, indexing="ij")
    rough = noise(rng, size, 5)
    kind = r.choice(("marble", "wood", "bricks", "dots", "speckles", "soft"))
    if kind == "marble":
        mask = 0.5 + 0.5 * np.sin(2 * np.pi * (2 * u + 2 * v + 2 * rough))
    elif kind == "wood":
        mask = (8 * u + 1.5 * rough + 0.1 * np.sin(2 * np.pi * v)) % 1
    elif kind == "bricks":
        row = np.floor(v * 8)
        mask = (((u * 4 + 0.5 * (row % 2)) % 1 > 0.06) & ((v * 8) % 1 > 0.1)) * (0.7 + 0.3 * rough)
    elif kind == "dots":
        mask = (np.hypot((u * 6) % 1 - 0.5, (v * 6) % 1 - 0.5) < 0.3).astype(float)
    elif kind == "speckles":
        mask = (rng.random((size, size)) < 0.3).astype(float)
    else:
        mask = rough
    one, two = np.array(colour(r)), np.array(colour(r))
    return np.clip(one + (two - one) * mask[..., None], 0, 1).astype(np.float32)


def bitmap(pixels: NDArray[np.float32], repeat: float) -> Plugin:
    to_uv = mi.ScalarTransform3f().scale([repeat, repeat])
    return {"type": "bitmap", "bitmap": mi.Bitmap(pixels), "raw": True, "to_uv": to_uv}


def reflectance(r: random.Random, big: bool) -> Plugin:
    """A colour or a texture; big surfaces mostly have one, repeated more often."""
    repeat = r.uniform(2, 10) if big else r.uniform(0.7, 3)
    kind = r.random()
    if kind < (0.2 if big else 0.45):
        return {"type": "rgb", "value": colour(r)}
    if kind < (0.4 if big else 0.55):
        to_uv = mi.ScalarTransform3f().scale([repeat, repeat])
        pair = {f"color{k}": {"type": "rgb", "value": colour(r)} for k in (0, 1)}
        return {"type": "checkerboard", "to_uv": to_uv, **pair}
    return bitmap(pattern(r), repeat / 2)


def painted(r: random.Random) -> Plugin:
    value = r.uniform(0.5, 0.9)
    return {"type": "twosided", "side": {"type": "diffuse", "reflectance": {"type": "rgb", "value": [value] * 3}}}


def random_bsdf(r: random.Random, shiny: float, closed: bool, big: bool = False) -> Plugin:
    """A BSDF, metal or clear with probability `shiny`; clear ones only for closed shapes."""
    if r.random() < shiny:
        kind = r.choice(("metal", "metal", "mirror", "glass", "frosted") if closed else ("metal", "metal", "metal", "mirror"))
        if kind == "glass":
            return {"type": "dielectric"}
        if kind == "frosted":
            return {"type": "roughdielectric", "alpha": r.uniform(0.05, 0.4)}
        if kind == "mirror":
            return {"type": "twosided", "side": {"type": "conductor", "material": r.choice(METALS)}}
        metal = {"type": "roughconductor", "material": r.choice(METALS), "alpha": r.uniform(0.05, 0.45)}
        return {"type": "twosided", "side": metal}
    base = reflectance(r, big)
    kind = r.choice(("diffuse", "diffuse", "roughplastic", "plastic", "principled"))
    if kind == "diffuse":
        bsdf: Plugin = {"type": "diffuse", "reflectance": base}
    elif kind == "principled":
        bsdf = {"type": "principled", "base_color": base, "roughness": r.uniform(0.15, 0.9), "metallic": r.choice((0.0, 0.0, r.random()))}
    else:
        bsdf = {"type": kind, "diffuse_reflectance": base} | ({"alpha": r.uniform(0.05, 0.4)} if kind == "roughplastic" else {})
    if r.random() < 0.15:
        height = noise(np.random.default_rng(r.randrange(1 << 31)), 128, 5)[..., None]
        bump = bitmap(height, r.uniform(1, 4))
        bsdf = {"type": "bumpmap", "height": bump, "scale": r.uniform(0.02, 0.15), "bsdf": bsdf}
    return {"type": "twosided", "side": bsdf}


def sky(r: random.Random, strength: float) -> Plugin:
    """An environment: plain, or a picture with a horizon, clouds and perhaps a soft sun."""
    if r.random() < 0.2:
        return {"type": "constant", "radiance": rgb(r, strength)}
    rng = np.random.default_rng(r.randrange(1 << 31))
    height, width = 64, 128
    up = np.cos((np.arange(height) + 0.5) / height * np.pi)[:, None, None]
    zenith, horizon, earth = (np.array(colour(r)) * s for s in (0.8, 1.3, 0.4))
    mix = np.abs(up) ** 0.5
    pixels = np.where(up > 0, horizon + (zenith - horizon) * mix, earth + (horizon * 0.5 - earth) * (1 - mix))
    pixels = np.broadcast_to(pixels, (height, width, 3)) + 0.8 * noise(rng, width, 5)[:height, :, None] ** 2
    pixels = pixels / pixels.mean()
    if r.random() < 0.5:
        row, column, size = r.uniform(6, 28), r.uniform(0, width), r.uniform(1.0, 3.0)
        rows, columns = np.meshgrid(np.arange(height), np.arange(width), indexing="ij")
        away = ((rows - row) ** 2 + ((columns - column + width / 2) % width - width / 2) ** 2) / size**2
        pixels = pixels + np.exp(-away)[..., None] * r.uniform(20, 120) / size
    return {"type": "envmap", "bitmap": mi.Bitmap((strength * pixels).astype(np.float32))}

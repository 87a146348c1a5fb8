"""The file of a shot, as every renderer's script writes it and `training/data/shots.py` reads it, and which shots are not worth one.

Arrays of 16 bits are kept as planes of bytes, the high ones first: deflate finds little in halves as they are. Numpy alone.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

Passes = dict[str, np.ndarray]

FORMAT = 2
VECTOR_STEPS = 128  # a pixel
VECTOR_MOST = 255.0  # pixels, either way
BACKGROUND = 1e9  # from here on depth is background, as Blender 5.2 writes it
BRIGHTEST = 65000.0  # that a half takes with room to spare
MANTISSA = 8  # bits that a noisy half keeps of its 10


def dull(probe: Passes) -> str:
    """Why a shot is not worth rendering, from a few samples; empty if it is."""
    brightness = probe["color"].mean(-1)
    depth = probe["depth"]
    mean, covered = float(brightness.mean()), float(((depth > 0) & (depth < BACKGROUND)).mean())
    if not 1e-3 <= mean <= 200:
        return f"mean brightness {mean:.4f}"
    if brightness.std() / (mean + 1e-6) < 0.08:
        return "flat"
    return f"only {covered:.2f} covered" if covered < 0.25 else ""


def half(a: np.ndarray) -> np.ndarray:
    return np.clip(np.nan_to_num(a, posinf=BRIGHTEST, neginf=-BRIGHTEST), -BRIGHTEST, BRIGHTEST).astype(np.float16)


def coarse_half(a: np.ndarray) -> np.ndarray:
    """Halves of MANTISSA bits, 0.1 % apart from the truth on average: far below the noise of what is stored so."""
    drop = 10 - MANTISSA
    bits = half(a).view(np.uint16).astype(np.uint32)
    return ((bits + (1 << (drop - 1)) >> drop) << drop).astype(np.uint16).view(np.float16)


def unit(a: np.ndarray) -> np.ndarray:
    return np.round(np.clip(a, 0, 1) * 255).astype(np.uint8)


def signed(a: np.ndarray) -> np.ndarray:
    return np.round(np.clip(a, -1, 1) * 127).astype(np.int8)


def front(depth: np.ndarray) -> np.ndarray:
    """Depth with the background at 0, as Blender wrote it until 5.1."""
    return np.where(np.isfinite(depth) & (depth < BACKGROUND), depth, 0.0)


def steps(vector: np.ndarray) -> np.ndarray:
    """Motion vectors as whole VECTOR_STEPS of a pixel."""
    return np.round(np.clip(np.nan_to_num(vector), -VECTOR_MOST, VECTOR_MOST) * VECTOR_STEPS).astype(np.int16)


def planes(a: np.ndarray) -> np.ndarray:
    """An array of 16 bits a value as (2, …) bytes: all high ones, then all low ones."""
    bits = np.ascontiguousarray(a).view(np.uint16)
    return np.stack((bits >> 8, bits & 255)).astype(np.uint8)


def whole(split: np.ndarray, kind: type[np.generic]) -> np.ndarray:
    """The array of `planes`."""
    return (split[0].astype(np.uint16) << 8 | split[1]).view(kind)


def first(a: np.ndarray) -> np.ndarray:
    """(…, rows, columns, channels) with the channels first."""
    return np.moveaxis(a, -1, -3)


def save(target: Path, takes: Sequence[Sequence[Passes]], references: Sequence[Sequence[Passes]], meta: dict[str, object]) -> None:
    """Writes a shot aside and moves it into place.

    takes: of each the frames' passes color, albedo, normal, depth and vector, (rows, columns, channels); all takes show the same
    frames, and the vectors of the first are kept. references: of the middle frame and the one before (or of the middle one alone) the
    halves, which are independent renders, one or two; color and albedo count. Where every frame has it, `part` is what a part of the
    light gives of `color`. meta has `seed` and `spp`, of each take.
    """
    of = lambda name: first(np.stack([np.stack([frame[name] for frame in take]) for take in takes]))
    clean = lambda name: first(np.stack([np.stack([part[name] for part in halves]) for halves in references]))
    aside = target.with_suffix(".part.npz")
    in_parts = {"part": planes(half(of("part"))), "part_halves": planes(half(clean("part")))} if "part" in takes[0][0] else {}
    np.savez_compressed(
        aside,
        color=planes(coarse_half(of("color"))),
        albedo=unit(of("albedo")),
        normal=signed(of("normal")),
        depth=planes(coarse_half(front(of("depth")[:, :, 0]))),
        vector=planes(steps(first(np.stack([frame["vector"] for frame in takes[0]])))),
        halves=planes(half(clean("color"))),
        ref_albedo=unit(clean("albedo").mean(1)),
        **in_parts,
        meta=json.dumps({"format": FORMAT, **meta}),
    )
    aside.replace(target)


@dataclass
class StoredTake:
    """A noisy take: samples a pixel; color, albedo, normal (n, 3, rows, columns) and depth (n, rows, columns); part as color, or None."""

    spp: int
    color: np.ndarray
    albedo: np.ndarray
    normal: np.ndarray
    depth: np.ndarray
    part: np.ndarray | None = None


@dataclass
class Stored:
    """What a shot's file holds, floats of 32 bits: vector (n, 4, rows, columns); halves (references, 1 or 2, 3, rows, columns), of the
    middle frame and the one before; ref_albedo (references or 1, 3, rows, columns); part_halves as halves, or None."""

    takes: list[StoredTake]
    vector: np.ndarray
    halves: np.ndarray
    ref_albedo: np.ndarray
    meta: dict[str, Any]
    part_halves: np.ndarray | None = None


def load(path: Path) -> Stored:
    """Reads a shot, also of the first format: one take, references of one half."""
    floats = lambda a: a.astype(np.float32)
    with np.load(path) as z:
        meta = json.loads(str(z["meta"]))
        albedo, normal = floats(z["albedo"]) / 255, floats(z["normal"]) / 127
        if meta.get("format", 1) == 1:
            depth = floats(z["depth"])
            depth = np.where(depth < float(np.float16(BRIGHTEST)), depth, 0.0)  # 5.2's background, clamped when it was written
            take = StoredTake(meta["spp"], floats(first(z["color"])), first(albedo), first(normal), depth)
            halves = floats(first(np.stack([z[name] for name in ("ref", "ref_before") if name in z])))[:, None]
            return Stored([take], floats(first(z["vector"])), halves, floats(first(z["ref_albedo"])[None]) / 255, meta)
        color, depth = floats(whole(z["color"], np.float16)), floats(whole(z["depth"], np.float16))
        vector, halves = floats(whole(z["vector"], np.int16)) / VECTOR_STEPS, floats(whole(z["halves"], np.float16))
        ref_albedo = floats(z["ref_albedo"]) / 255
        part, part_halves = (floats(whole(z[name], np.float16)) if name in z else None for name in ("part", "part_halves"))
    parts = [None] * len(color) if part is None else part
    takes = [StoredTake(*passes) for passes in zip(meta["spp"], color, albedo, normal, depth, parts, strict=True)]
    return Stored(takes, vector, halves, ref_albedo, meta, part_halves)

"""What every renderer's script needs: the file of a shot, which `training/data/shots.py` reads, and which shots are not worth one."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

Passes = dict[str, np.ndarray]


def dull(probe: Passes) -> str:
    """Why a shot is not worth rendering, from a few samples; empty if it is."""
    brightness = probe["color"].mean(-1)
    mean, covered = float(brightness.mean()), float((probe["depth"] > 0).mean())
    if not 1e-3 <= mean <= 200:
        return f"mean brightness {mean:.4f}"
    if brightness.std() / (mean + 1e-6) < 0.08:
        return "flat"
    return f"only {covered:.2f} covered" if covered < 0.25 else ""


def half(a: np.ndarray) -> np.ndarray:
    return np.clip(np.nan_to_num(a, posinf=65000, neginf=-65000), -65000, 65000).astype(np.float16)


def unit(a: np.ndarray) -> np.ndarray:
    return np.round(np.clip(a, 0, 1) * 255).astype(np.uint8)


def save(target: Path, noisy: list[Passes], reference: Passes, meta: dict[str, object], before: Passes | None = None) -> None:
    """Writes a shot aside and moves it into place. Passes are color, albedo, normal, depth and vector, (rows, columns, channels);
    of the references color and albedo count."""
    stacked = {name: np.stack([frame[name] for frame in noisy]) for name in ("color", "albedo", "normal", "depth", "vector")}
    aside = target.with_suffix(".part.npz")
    np.savez_compressed(
        aside,
        color=half(stacked["color"]),
        albedo=unit(stacked["albedo"]),
        normal=np.round(np.clip(stacked["normal"], -1, 1) * 127).astype(np.int8),
        depth=half(stacked["depth"][..., 0]),
        vector=half(stacked["vector"]),
        ref=half(reference["color"]),
        ref_albedo=unit(reference["albedo"]),
        meta=json.dumps(meta),
        **({"ref_before": half(before["color"])} if before else {}),
    )
    aside.replace(target)

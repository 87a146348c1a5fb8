"""What λ does on the benchmark's shots: how much of the noise and how much of the detail is left, as a table and a figure."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np

from training.benchmark import tables
from training.benchmark.frames import Image, Take, beauty, frame, numbers

WINDOW = 2


class Denoiser(Protocol):
    def denoise(self, take: Take, output: Path, window: int, lam: float = 1.0) -> Path: ...

    def scores(self, take: Take, folder: Path) -> tables.Scores: ...


@dataclass(frozen=True)
class Point:
    """Means over the shots at a number of samples and a λ; `noise` and `detail` are shares of 1."""

    spp: int
    lam: float
    noise: float
    detail: float
    smape: float | None
    relmse: float | None
    flicker: float | None


def blurred(image: Image) -> Image:
    """Binomial 5×5, edges repeated."""
    weights = np.array([1, 4, 6, 4, 1], np.float32) / 16
    for axis in (0, 1):
        pad = [(2, 2) if a == axis else (0, 0) for a in range(image.ndim)]
        wide, size = np.pad(image, pad, "edge"), image.shape[axis]
        image = sum(w * wide.take(range(i, i + size), axis) for i, w in enumerate(weights))
    return image


def fine(image: Image, level: Image) -> Image:
    """What a blur takes away, relative to the reference's local brightness: linear in the image, so noise has mean 0 in it."""
    return (image - blurred(image)) / level


def shares(noisy: Image, denoised: Image, reference: Image) -> tuple[float, float]:
    """(noise, detail) left of a frame. Detail: the part of the reference's fine structure that is in the result, by regression.
    Noise: root mean square of the fine structure that is not the reference's, over that of the noisy frame."""
    gain = 0.4 / max(float(reference.mean()), 1e-6)
    level = np.maximum(blurred(np.maximum(reference, 0)) * gain, 0) + np.float32(0.05)
    n, d, r = (fine(image * gain, level).ravel() for image in (noisy, denoised, reference))
    # Fireflies would decide a square by themselves.
    n, d, r = (np.clip(x, -4, 4).astype(np.float64) for x in (n, d, r))
    detail = float(d @ r) / max(float(r @ r), 1e-12)
    left, before = d - detail * r, n - float(n @ r) / max(float(r @ r), 1e-12) * r
    return math.sqrt(float(left @ left) / max(float(before @ before), 1e-12)), detail


def frames(take: Take, folder: Path) -> Iterator[tuple[float, float]]:
    for n in numbers(take.reference):
        yield shares(*(beauty(frame(where, n)) for where in (take.noisy, folder, take.reference)))


def curves(takes: Sequence[Take], lambdas: Sequence[float], hush: Denoiser, out: Path) -> list[Point]:
    """A point for each number of samples and λ."""
    found = []
    for spp in sorted({take.spp for take in takes}):
        chosen = [take for take in takes if take.spp == spp]
        for lam in lambdas:
            left, scores = [], []
            for take in chosen:
                folder = hush.denoise(take, out / take.shot / f"{spp}spp-lambda{lam:g}", WINDOW, lam)
                left.append(np.mean(list(frames(take, folder)), 0))
                scores.append(hush.scores(take, folder))
            noise, detail = (float(x) for x in np.mean(left, 0))
            means = {
                metric: tables.mean(tables.score(metric, score[metric]) for score in scores) for metric in ("smape", "relmse", "flicker")
            }
            found.append(Point(spp, lam, noise, detail, **means))
    return found


def report(points: Sequence[Point]) -> str:
    """The curves as tables, and whether they rise throughout."""
    parts = []
    for spp in sorted({p.spp for p in points}):
        line = [p for p in points if p.spp == spp]
        rows = [
            [f"{p.lam:g}", *(tables.number(x, 3) for x in (p.noise, p.detail)), *map(tables.number, (p.smape, p.relmse, p.flicker))]
            for p in line
        ]
        parts.append(tables.table([f"λ, {spp} spp", "noise left", "detail left", "SMAPE", "relMSE", "flicker"], rows))
        for name in ("noise", "detail"):
            rises = tables.monotone([getattr(p, name) for p in line])
            parts.append(f"{name.capitalize()} left at {spp} spp {'rises with λ throughout' if rises else 'does NOT rise throughout'}.")
    return "\n\n".join(parts)


def figure(points: Sequence[Point]) -> str:
    """Noise and detail left against λ (log scale), as SVG."""
    wide, high, left, top = 420, 240, 52, 16
    most = max(1.0, *(p.detail for p in points), *(p.noise for p in points))
    most = math.ceil(most * 10) / 10
    last = max(math.log2(max(p.lam for p in points)), 1.0)
    x, y = (lambda lam: left + wide * math.log2(lam) / last), (lambda share: top + high * (1 - share / most))
    colours = {"noise": ("#c0392b", "noise left"), "detail": ("#1f6f8b", "detail left")}
    across, down = left + wide + 110, top + high + 46
    parts = [f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {across} {down}" font-family="sans-serif" font-size="12">']
    parts.append(f'<rect width="{across}" height="{down}" fill="#fff"/>')
    for step in range(round(most / 0.2) + 1):
        share = 0.2 * step
        if share <= most + 1e-6:
            parts.append(f'<path d="M{left} {y(share):.1f}H{left + wide}" stroke="#ddd"/>')
            parts.append(f'<text x="{left - 8}" y="{y(share) + 4:.1f}" text-anchor="end">{share:.1f}</text>')
    for lam in sorted({p.lam for p in points}):
        parts.append(f'<text x="{x(lam):.1f}" y="{top + high + 18}" text-anchor="middle">{lam:g}</text>')
    parts.append(f'<text x="{left + wide / 2}" y="{top + high + 38}" text-anchor="middle">λ</text>')
    labels: list[tuple[float, str, str]] = []
    for order, spp in enumerate(sorted({p.spp for p in points})):
        line = [p for p in points if p.spp == spp]
        dash = ' stroke-dasharray="6 4"' if order else ""
        for name, (colour, title) in colours.items():
            path = " ".join(f"{x(p.lam):.1f},{y(getattr(p, name)):.1f}" for p in line)
            parts.append(f'<polyline points="{path}" fill="none" stroke="{colour}" stroke-width="2"{dash}/>')
            labels.append((y(getattr(line[-1], name)) + 4, colour, f"{title}, {spp} spp"))
    below = 0.0
    for wanted, colour, text in sorted(labels):
        below = max(wanted, below + 14)  # names may not cover each other
        parts.append(f'<text x="{left + wide + 6}" y="{below:.1f}" fill="{colour}">{text}</text>')
    return "\n".join([*parts, "</svg>"]) + "\n"

"""How many samples OIDN, as Cycles runs it, needs for Hush's error at ±2: a table and a figure; numbers in, text out.

Errors are means over the shots: relMSE without the references' noise, and SMAPE, which has that noise in it, so that the two look more
alike the better they are. Between the numbers of samples that were measured OIDN's curve is a straight line in the logarithms of samples
and error; beyond them nothing is guessed.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from training.benchmark import tables

METHOD = "window2"
METRICS = {"unbiased_relmse": "relMSE without the references' noise", "smape": "SMAPE"}
AT = (4, 8, 16, 32)
# Error by samples.
Curve = Mapping[int, float]


@dataclass(frozen=True)
class Equal:
    """The samples that the peer needs for the error that Hush has at `spp`: None where its curve does not reach that error, which is
    then either below (`beyond`) or above all of it."""

    spp: int
    error: float
    needed: float | None
    beyond: bool = False


def curve(results: tables.Results, method: str, metric: str) -> dict[int, float]:
    """Mean errors over the shots by the samples that all shots have; one that is not above 0 is left out, having no logarithm."""
    shots = sorted({shot for shot, _ in results})
    spp = [n for n in sorted({n for _, n in results}) if all((shot, n) in results for shot in shots)]
    found = {n: tables.averaged(results, method, metric, shots, [n]) for n in spp}
    return {n: value for n, value in found.items() if value is not None and value > 0}


def needed(peer: Curve, error: float) -> float | None:
    """The fewest samples at which the peer's error falls to `error`; None where it never does between its first and last number."""
    line = sorted(peer.items())
    for (n0, e0), (n1, e1) in zip(line, line[1:], strict=False):
        if e1 <= error <= e0:
            share = (math.log(e0) - math.log(error)) / (math.log(e0) - math.log(e1)) if e0 > e1 else 0.0
            return n0 * (n1 / n0) ** share
    return None


def equals(ours: Curve, peer: Curve) -> list[Equal]:
    """For each of Hush's numbers of samples that are asked for and were measured."""
    found = []
    for spp in AT:
        if spp in ours and peer:
            samples = needed(peer, ours[spp])
            found.append(Equal(spp, ours[spp], samples, samples is None and ours[spp] < min(peer.values())))
    return found


def share_of(results: tables.Results, metric: str, spp: int) -> float | None:
    """How many times Hush's samples the peer needs."""
    ours = curve(results, METHOD, metric)
    samples = needed(curve(results, tables.PEER, metric), ours[spp]) if spp in ours else None
    return None if samples is None else samples / spp


def words(equal: Equal, peer: Curve, error: float | None) -> list[str]:
    """Two cells: samples, and how many times Hush's that is."""
    if equal.needed is None:
        few, many = min(peer), max(peer)
        return [f"more than {many}", f"> {many / equal.spp:.1f}×"] if equal.beyond else [f"fewer than {few}", f"< {few / equal.spp:.1f}×"]
    return [f"{equal.needed:.1f}", f"{equal.needed / equal.spp:.2f}{'' if error is None else f' ± {error:.2f}'}×"]


def report(results: tables.Results) -> str:
    """A table a metric."""
    parts = []
    for metric, title in METRICS.items():
        ours, peer = (curve(results, method, metric) for method in (METHOD, tables.PEER))
        rows = []
        for equal in equals(ours, peer):
            error = tables.standard_error(lambda r, m=metric, n=equal.spp: share_of(r, m, n), results, metric)
            rows.append([str(equal.spp), tables.number(equal.error, 5), *words(equal, peer, error)])
        head = ["samples for Hush, window ±2", title, "samples for OIDN as Cycles runs it", "times as many"]
        if rows:
            parts.append(tables.table(head, rows))
        parts.append(tables.table([title, *map(str, peer)], [["OIDN as Cycles runs it", *(tables.number(e, 5) for e in peer.values())]]))
    return "\n\n".join(parts)


def figure(results: tables.Results) -> str:
    """Error against samples, both on log scales, a panel a metric; arrows lead from Hush's points to the peer's curve, as SVG."""
    wide, high, left, top, right = 330, 230, 56, 34, 24
    across, down = 2 * (left + wide + right), top + high + 46
    parts = [f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {across} {down}" font-family="sans-serif" font-size="12">']
    parts.append(f'<rect width="{across}" height="{down}" fill="#fff"/>')
    parts.append('<defs><marker id="tip" orient="auto" markerWidth="7" markerHeight="7" refX="6" refY="3.5">')
    parts.append('<path d="M0 0L7 3.5L0 7z" fill="#555"/></marker></defs>')
    for order, (metric, title) in enumerate(METRICS.items()):
        ours, peer = (curve(results, method, metric) for method in (METHOD, tables.PEER))
        if not ours or not peer:
            continue
        parts += panel(ours, peer, title, (left + order * (left + wide + right), top, wide, high))
    return "\n".join([*parts, "</svg>"]) + "\n"


def panel(ours: Curve, peer: Curve, title: str, place: tuple[float, float, float, float]) -> list[str]:
    """One metric's curves in a rectangle: left, top, width, height."""
    left, top, wide, high = place
    spp, errors = sorted({*ours, *peer}), [*ours.values(), *peer.values()]
    low, most = math.log(min(errors) / 1.15), math.log(max(errors) * 1.15)
    x = lambda n: left + wide * math.log(n / spp[0]) / max(math.log(spp[-1] / spp[0]), 1e-9)
    y = lambda e: top + high * (most - math.log(e)) / (most - low)
    parts = [f'<text x="{left}" y="{top - 14}" font-weight="bold">{title}</text>']
    for value in ticks(math.exp(low), math.exp(most)):
        parts.append(f'<path d="M{left} {y(value):.1f}h{wide}" stroke="#ddd"/>')
        parts.append(f'<text x="{left - 6}" y="{y(value) + 4:.1f}" text-anchor="end">{value:g}</text>')
    for n in spp:
        parts.append(f'<text x="{x(n):.1f}" y="{top + high + 18}" text-anchor="middle">{n}</text>')
    parts.append(f'<text x="{left + wide / 2}" y="{top + high + 38}" text-anchor="middle">samples a pixel</text>')
    # The curves fall: there is room for a name above the upper one's beginning and below the lower one's end.
    names = ((peer, "#c0392b", "OIDN as Cycles runs it", 0, "start", (14, 4)), (ours, "#1f6f8b", "Hush, ±2", -1, "end", (-12, 4)))
    for line, colour, name, at, anchor, (across, down) in names:
        points = [(x(n), y(e)) for n, e in sorted(line.items())]
        path = " ".join(f"{px:.1f},{py:.1f}" for px, py in points)
        parts.append(f'<polyline points="{path}" fill="none" stroke="{colour}" stroke-width="2"/>')
        parts += [f'<circle cx="{px:.1f}" cy="{py:.1f}" r="3" fill="{colour}"/>' for px, py in points]
        px, py = points[at]
        parts.append(f'<text x="{px + across:.1f}" y="{py + down:.1f}" text-anchor="{anchor}" fill="{colour}">{name}</text>')
    for equal in equals(ours, peer):
        if equal.needed is None:
            continue
        height = y(equal.error)
        start, end = x(equal.spp), x(equal.needed)
        parts.append(f'<path d="M{start:.1f} {height:.1f}H{end:.1f}" stroke="#555" stroke-dasharray="4 3" marker-end="url(#tip)"/>')
        text = f"{equal.needed / equal.spp:.1f}×"
        parts.append(f'<text x="{(start + end) / 2:.1f}" y="{height - 5:.1f}" text-anchor="middle" fill="#333">{text}</text>')
    return parts


def ticks(low: float, high: float) -> list[float]:
    """1, 2 and 5 times powers of ten between two numbers."""
    first, last = math.floor(math.log10(low)), math.ceil(math.log10(high))
    every = [float(f"{digit}e{power}") for power in range(first, last + 1) for digit in (1, 2, 5)]
    return [value for value in every if low <= value <= high]

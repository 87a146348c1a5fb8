"""Means, ratios to OIDN, targets and markdown tables of the benchmark; numbers in, text out."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

METRICS = {"smape": "SMAPE", "relmse": "relMSE", "flip": "FLIP", "flicker": "flicker"}
METHODS = {
    "noisy": "noisy",
    "oidn_high": "OIDN 2.5.1 high",
    "oidn_clean_aux": "OIDN 2.5.1 high, clean_aux",
    "window0": "Hush, window 0",
    "window1": "Hush, window ±1",
    "window2": "Hush, window ±2",
    "window3": "Hush, window ±3",
}
PEER = "oidn_high"
Scores = Mapping[str, float | None]
# Scores by (shot, samples), then method.
Results = Mapping[tuple[str, int], Mapping[str, Scores]]


@dataclass(frozen=True)
class Target:
    """At most `limit` times the peer's score."""

    method: str
    metric: str
    limit: float


TARGETS = (
    Target("window2", "smape", 0.8),
    Target("window2", "relmse", 0.8),
    Target("window2", "flicker", 0.5),
    Target("window0", "smape", 1.1),
)


def mean(values: Iterable[float | None]) -> float | None:
    """Of the numbers that are there; None if there are none."""
    there = [value for value in values if value is not None]
    return sum(there) / len(there) if there else None


def averaged(results: Results, method: str, metric: str, shots: Sequence[str], spp: Sequence[int]) -> float | None:
    """Mean over takes, each of the same weight."""
    return mean(results[shot, n][method].get(metric) for shot in shots for n in spp if (shot, n) in results)


def ratio(results: Results, target: Target, shots: Sequence[str], spp: Sequence[int]) -> float | None:
    """The method's mean score over the peer's; None where one is missing or the peer's is 0."""
    ours, theirs = (averaged(results, method, target.metric, shots, spp) for method in (target.method, PEER))
    return ours / theirs if ours is not None and theirs else None


def verdict(found: float | None, limit: float) -> str:
    return "not measured" if found is None else "met" if found <= limit else "missed"


def number(value: float | None, digits: int = 4) -> str:
    return "–" if value is None else f"{value:.{digits}f}"


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def validation_table(scores: Mapping[str, Sequence[tuple[float, float]]]) -> str:
    """A row a method; the mean SMAPE and relMSE over the validation shots."""
    head = [f"{len(next(iter(scores.values())))} shots", METRICS["smape"], METRICS["relmse"]]
    return table(head, [[name, *(number(mean(column)) for column in zip(*pairs, strict=True))] for name, pairs in scores.items()])


def score_table(results: Results, shots: Sequence[str], spp: Sequence[int]) -> str:
    """A row a method; the four metrics, the mean over these shots and samples."""
    title = f"{', '.join(shots)}; {' and '.join(map(str, spp))} spp"
    rows = []
    for method, name in METHODS.items():
        if all(method in scores for scores in results.values()):
            rows.append([name, *(number(averaged(results, method, metric, shots, spp)) for metric in METRICS)])
    return table([title, *METRICS.values()], rows)


def target_table(results: Results, shots: Sequence[str], spp: Sequence[int]) -> str:
    """The targets: ratios at each number of samples and over all, and whether the last meets them."""
    rows = []
    for target in TARGETS:
        every = ratio(results, target, shots, spp)
        cells = [f"{METHODS[target.method]}: {METRICS[target.metric]} at most {target.limit}×"]
        cells += [number(ratio(results, target, shots, [n]), 2) for n in spp]
        rows.append([*cells, number(every, 2), verdict(every, target.limit)])
    return table(["over OIDN high", *(f"{n} spp" for n in spp), "all", "target"], rows)


def shot_ratio_table(results: Results, shots: Sequence[str], spp: Sequence[int]) -> str:
    """The same ratios shot by shot."""
    head = ["over OIDN high", *(f"{METHODS[t.method].removeprefix('Hush, ')} {METRICS[t.metric]}" for t in TARGETS)]
    takes = [(shot, n) for shot in shots for n in spp if (shot, n) in results]
    rows = [[f"{shot}, {n} spp", *(number(ratio(results, target, [shot], [n]), 2) for target in TARGETS)] for shot, n in takes]
    return table(head, rows)


def monotone(values: Sequence[float | None]) -> bool:
    """Whether they never fall; a missing one is left out."""
    there = [value for value in values if value is not None]
    return all(a <= b for a, b in zip(there, there[1:], strict=False))


def replaced(document: str, name: str, text: str) -> str:
    """The document with what stands between its two markers of that name replaced; ValueError if they are not there."""
    start, end = f"<!-- {name}: written by training/benchmark/run.py -->", f"<!-- end of {name} -->"
    before, found, rest = document.partition(start)
    _, closed, after = rest.partition(end)
    if not found or not closed:
        raise ValueError(f"no {start} … {end}")
    return f"{before}{start}\n{text}\n{end}{after}"


def report(results: Results, coverage: Mapping[str, int]) -> str:
    """Every table, under what was measured."""
    shots = list(dict.fromkeys(shot for shot, _ in results))
    spp = sorted({n for _, n in results})
    parts = [f"References: {', '.join(f'{shot} {coverage[shot]} frames' for shot in shots)}."]
    parts += [target_table(results, shots, spp), shot_ratio_table(results, shots, spp)]
    parts += [score_table(results, shots, [n]) for n in spp]
    if len(spp) > 1:
        parts.append(score_table(results, shots, spp))
    if len(shots) > 1:
        parts += [score_table(results, [shot], [n]) for shot in shots for n in spp if (shot, n) in results]
    return "\n\n".join(parts)

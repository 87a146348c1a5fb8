"""Scores, ratios to OIDN as Cycles runs it, their standard errors, targets and markdown tables of the benchmark; numbers in, text out."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

METRICS = {
    "smape": "SMAPE",
    "relmse": "relMSE",
    "flip": "FLIP",
    "flicker": "flicker",
    "unbiased_relmse": "unbiased relMSE",
    "unbiased_flicker": "unbiased flicker",
}
METHODS = {
    "noisy": "noisy",
    "oidn_clean_aux": "OIDN as Cycles runs it",
    "oidn_high": "OIDN high, raw guides",
    "oidn_fast": "OIDN fast, raw guides",
    "window0": "Hush, window 0",
    "window1": "Hush, window ±1",
    "window2": "Hush, window ±2",
    "window3": "Hush, window ±3",
}
PEER = "oidn_clean_aux"
# What the targets are about.
IN_RATIOS = (PEER, "window0", "window2")
OVER = "over OIDN as Cycles runs it"
# By metric, frame by frame; None where a frame has none. Of unbiased flicker the squares, which may be below 0.
Scores = Mapping[str, Sequence[float | None]]
# Scores by (shot, samples), then method. All methods of a take have the same frames.
Results = Mapping[tuple[str, int], Mapping[str, Scores]]


@dataclass(frozen=True)
class Target:
    """At most `limit` times the peer's score; on the means over the takes, or on each of them."""

    method: str
    metric: str
    limit: float
    every_shot: bool = False


TARGETS = (
    Target("window2", "smape", 0.8),
    Target("window2", "unbiased_relmse", 0.6),
    Target("window2", "unbiased_flicker", 0.45),
    Target("window0", "smape", 1.05),
    Target("window0", "unbiased_relmse", 1.1),
    Target("window2", "smape", 1.0, every_shot=True),
    Target("window2", "unbiased_relmse", 1.0, every_shot=True),
)
# Beside the targets: FLIP, which neither Hush nor OIDN is trained on, and the flicker of a frame alone.
BESIDE = (Target("window2", "flip", 1.0), Target("window0", "flip", 1.0), Target("window0", "unbiased_flicker", 1.0))


def mean(values: Iterable[float | None]) -> float | None:
    """Of the numbers that are there; None if there are none."""
    there = [value for value in values if value is not None]
    return sum(there) / len(there) if there else None


def score(metric: str, by_frame: Sequence[float | None]) -> float | None:
    """Of a take: the mean over its frames; of unbiased flicker the root of the mean, 0 where that is below 0."""
    found = mean(by_frame)
    return math.sqrt(max(0.0, found)) if found is not None and metric == "unbiased_flicker" else found


def averaged(results: Results, method: str, metric: str, shots: Sequence[str], spp: Sequence[int]) -> float | None:
    """Mean over takes, each of the same weight."""
    return mean(score(metric, results[shot, n][method].get(metric, [])) for shot in shots for n in spp if (shot, n) in results)


def ratio(results: Results, method: str, metric: str, shots: Sequence[str], spp: Sequence[int]) -> float | None:
    """The method's mean score over the peer's; None where one is missing or the peer's is not above 0."""
    ours, theirs = (averaged(results, name, metric, shots, spp) for name in (method, PEER))
    return ours / theirs if ours is not None and theirs is not None and theirs > 0 else None


def without(results: Results, takes: Sequence[tuple[str, int]], index: int) -> Results:
    """The results without one frame of some takes, in all methods."""
    cut = lambda scores: {m: [*by[:index], *by[index + 1 :]] for m, by in scores.items()}
    return {**results, **{take: {name: cut(scores) for name, scores in results[take].items()} for take in takes}}


def standard_error(statistic: Callable[[Results], float | None], results: Results, metric: str) -> float | None:
    """Of a statistic of one metric, by the jackknife: each frame of each shot is left out in turn, in all methods and at all numbers of
    samples at once, so that what these share does not count twice: the reference's noise and what the frame shows. Each frame of each
    pass has noise of its own, so this holds the noise of the references, that of the rendered frames, and the differences between
    frames; not those between shots. None where a shot that has the metric has it in one frame only.
    """
    variance, measured = 0.0, False
    for shot in dict.fromkeys(shot for shot, _ in results):
        takes = [take for take in results if take[0] == shot]
        there = [[i for i, v in enumerate(results[take][PEER].get(metric, [])) if v is not None] for take in takes]
        frames = sorted(set.intersection(*map(set, there)))
        if not any(there):
            continue
        measured = True
        found = [statistic(without(results, takes, i)) for i in frames]
        numbers = [value for value in found if value is not None]
        if len(frames) < 2 or len(numbers) < len(frames):
            return None
        count, middle = len(numbers), sum(numbers) / len(numbers)
        # Two changes in a row share a frame: ¼ of their variance, as for differences of independent numbers.
        shared = 1 + (count - 1) / (2 * count) if metric == "unbiased_flicker" else 1.0
        variance += shared * (count - 1) / count * sum((value - middle) ** 2 for value in numbers)
    return math.sqrt(variance) if measured else None


def chosen(results: Results, shots: Sequence[str], spp: Sequence[int]) -> Results:
    """The takes of these shots and samples."""
    return {take: results[take] for take in results if take[0] in shots and take[1] in spp}


def verdict(found: float | None, limit: float) -> str:
    return "not measured" if found is None else "met" if found <= limit else "missed"


def number(value: float | None, digits: int = 4) -> str:
    return "–" if value is None else f"{value:.{digits}f}"


def with_error(statistic: Callable[[Results], float | None], results: Results, metric: str, digits: int) -> str:
    """A number, with its standard error where the metric is an unbiased one."""
    value = statistic(results)
    error = standard_error(statistic, results, metric) if metric.startswith("unbiased") and value is not None else None
    return number(value, digits) + ("" if error is None else f" ± {error:.{digits}f}")


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def validation_table(scores: Mapping[str, Sequence[tuple[float, float]]]) -> str:
    """A row a method; the mean SMAPE and relMSE over the validation shots."""
    head = [f"{len(next(iter(scores.values())))} shots", METRICS["smape"], METRICS["relmse"]]
    return table(head, [[name, *(number(mean(column)) for column in zip(*pairs, strict=True))] for name, pairs in scores.items()])


def score_table(results: Results, shots: Sequence[str], spp: Sequence[int]) -> str:
    """A row a method; the metrics, the mean over these shots and samples."""
    title, takes = f"{', '.join(shots)}; {' and '.join(map(str, spp))} spp", chosen(results, shots, spp)
    cell = lambda method, metric: with_error(lambda r: averaged(r, method, metric, shots, spp), takes, metric, 4)
    measured = [method for method in METHODS if all(method in scores for scores in takes.values())]
    return table([title, *METRICS.values()], [[METHODS[method], *(cell(method, metric) for metric in METRICS)] for method in measured])


def ratio_cell(results: Results, target: Target, shots: Sequence[str], spp: Sequence[int]) -> tuple[float | None, str]:
    """The ratio that a target is about, as a number and as text: of the means, or the largest of any shot at any of these samples."""
    over = lambda takes: lambda r: ratio(r, target.method, target.metric, *takes)
    cell = lambda *takes: with_error(over(takes), chosen(results, *takes), target.metric, 2)
    if not target.every_shot:
        return over((shots, spp))(results), cell(shots, spp)
    takes = [([shot], [n]) for shot in shots for n in spp if (shot, n) in results]
    found = [value for take in takes if (value := over(take)(results)) is not None]
    if not found or len(found) < len(takes):
        return None, number(None)
    worst = max(takes, key=lambda take: over(take)(results) or 0.0)
    return max(found), f"{cell(*worst)} ({worst[0][0]})"


def name_of(target: Target) -> str:
    return f"{METHODS[target.method]}: {METRICS[target.metric]} at most {target.limit}×{' on every shot' if target.every_shot else ''}"


def in_mid_shot(metric: str, by_frame: Sequence[float | None], frames: Sequence[int], there: Sequence[int]) -> list[float | None]:
    """A score by frame, None for `frames` that have not two of the shot's frames, which are `there`, on both sides; of changes, those
    between two that have them."""
    inner = {frame for frame in frames if {frame - 2, frame - 1, frame + 1, frame + 2} <= set(there)}
    kept = {frame for frame in inner if frame - 1 in inner} if "flicker" in metric else inner
    return [value if frame in kept else None for frame, value in zip(frames, by_frame, strict=True)]


def target_table(results: Results, shots: Sequence[str], spp: Sequence[int], which: str = "") -> str:
    """The targets: ratios at each number of samples and over all, and whether the last meets them. `which` says of which frames."""
    rows = []
    for target in TARGETS:
        found, text = ratio_cell(results, target, shots, spp)
        rows.append([name_of(target), *(ratio_cell(results, target, shots, [n])[1] for n in spp), text, verdict(found, target.limit)])
    return table([f"{', '.join(shots)}{which}; {OVER}", *(f"{n} spp" for n in spp), "all", "target"], rows)


def shot_ratio_table(results: Results, groups: Sequence[Sequence[str]], spp: Sequence[int], which: str = "") -> str:
    """The same ratios, and those of `BESIDE`, shot by shot; below them of the means over all samples of each shot and each group, of
    which the first has all shots."""
    targets = [*(target for target in TARGETS if not target.every_shot), *BESIDE]
    head = [f"{OVER}{which}", *(f"{METHODS[t.method].removeprefix('Hush, ')} {METRICS[t.metric]}" for t in targets)]
    takes = [(f"{shot}, {n} spp", [shot], [n]) for shot in groups[0] for n in spp if (shot, n) in results]
    takes += [(", ".join(group), group, spp) for group in (*([shot] for shot in groups[0]), *groups)] if len(spp) > 1 else []
    return table(head, [[name, *(ratio_cell(results, target, *take)[1] for target in targets)] for name, *take in takes])


def monotone(values: Sequence[float | None]) -> bool:
    """Whether they never fall; a missing one is left out."""
    there = [value for value in values if value is not None]
    return all(a <= b for a, b in zip(there, there[1:], strict=False))


def replaced(document: str, name: str, text: str, by: str = "run.py") -> str:
    """The document with what stands between its two markers of that name replaced; ValueError if they are not there."""
    start, end = f"<!-- {name}: written by training/benchmark/{by} -->", f"<!-- end of {name} -->"
    before, found, rest = document.partition(start)
    _, closed, after = rest.partition(end)
    if not found or not closed:
        raise ValueError(f"no {start} … {end}")
    return f"{before}{start}\n{text}\n{end}{after}"


def report(results: Results, mid_shot: Results, first_shots: Sequence[str], ratios_only: bool = False) -> str:
    """Every table; those of the first shots by themselves where there are others, and the targets by `mid_shot`, the results without
    the frames at the ends of the shots. `ratios_only`: those of the peer's shares."""
    shots = list(dict.fromkeys(shot for shot, _ in results))
    spp = sorted({n for _, n in results})
    first = [shot for shot in first_shots if shot in shots]
    groups = [shots] + ([first] if first and len(first) < len(shots) else [])
    parts = [target_table(results, group, spp) for group in groups]
    parts += [target_table(mid_shot, group, spp, ", frames with a whole window") for group in groups]
    parts += [shot_ratio_table(results, groups, spp), shot_ratio_table(mid_shot, groups, spp, ", frames with a whole window")]
    if ratios_only:
        return "\n\n".join(parts)
    for group in groups:
        parts += [score_table(results, group, [n]) for n in spp]
        if len(spp) > 1:
            parts.append(score_table(results, group, spp))
    if len(shots) > 1:
        parts += [score_table(results, [shot], [n]) for shot in shots for n in spp if (shot, n) in results]
    return "\n\n".join(parts)

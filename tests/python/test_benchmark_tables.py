"""Means, ratios and verdicts of the benchmark's tables; no Blender, no PyTorch, no OIDN."""

from __future__ import annotations

import sys

import pytest
from conftest import ROOT

sys.path.append(str(ROOT))

from training.benchmark import tables  # noqa: E402


def scores(smape: float, relmse: float = 0.1, flicker: float | None = 0.1) -> dict[str, float | None]:
    return {"smape": smape, "relmse": relmse, "flip": 0.1, "flicker": flicker}


def results() -> dict[tuple[str, int], dict[str, dict[str, float | None]]]:
    """Two shots at two numbers of samples; Hush ±2 at half OIDN's SMAPE on one shot and at 1.5 times on the other."""
    found = {}
    for shot, factor in (("a", 0.5), ("b", 1.5)):
        for spp, level in ((4, 0.2), (32, 0.1)):
            methods = {method: scores(level) for method in tables.METHODS}
            methods["window2"] = scores(level * factor, relmse=0.08, flicker=0.05)
            found[shot, spp] = methods
    return found


TARGET = tables.Target("window2", "smape", 0.8)


def test_a_ratio_is_of_the_means_over_takes() -> None:
    assert tables.ratio(results(), TARGET, ["a"], [4]) == pytest.approx(0.5)
    assert tables.ratio(results(), TARGET, ["a", "b"], [4, 32]) == pytest.approx((0.1 + 0.05 + 0.3 + 0.15) / 0.6)


def test_what_was_not_measured_is_neither_met_nor_missed() -> None:
    found = results()
    for take in found.values():
        take["window2"]["flicker"] = None
    flicker = tables.Target("window2", "flicker", 0.5)
    assert tables.ratio(found, flicker, ["a", "b"], [4, 32]) is None
    assert tables.verdict(None, 0.5) == "not measured"
    assert "| not measured |" in tables.target_table(found, ["a", "b"], [4, 32])


def test_a_missing_score_is_left_out_of_the_mean_and_not_taken_for_0() -> None:
    assert tables.mean([0.2, None, 0.4]) == pytest.approx(0.3)
    assert tables.mean([None]) is None


@pytest.mark.parametrize(("found", "said"), [(0.8, "met"), (0.79, "met"), (0.801, "missed")])
def test_a_target_is_met_at_its_limit(found: float, said: str) -> None:
    assert tables.verdict(found, 0.8) == said


def test_the_target_table_has_a_line_for_each_target_of_the_benchmark() -> None:
    lines = tables.target_table(results(), ["a", "b"], [4, 32]).splitlines()
    assert lines[2:] == [
        "| Hush, window ±2: SMAPE at most 0.8× | 1.00 | 1.00 | 1.00 | missed |",
        "| Hush, window ±2: relMSE at most 0.8× | 0.80 | 0.80 | 0.80 | met |",
        "| Hush, window ±2: flicker at most 0.5× | 0.50 | 0.50 | 0.50 | met |",
        "| Hush, window 0: SMAPE at most 1.1× | 1.00 | 1.00 | 1.00 | met |",
    ]


def test_a_method_that_was_not_run_has_no_row() -> None:
    found = results()
    for take in found.values():
        del take["window3"]
    rows = tables.score_table(found, ["a", "b"], [4]).splitlines()[2:]
    assert [row.split(" | ")[0] for row in rows] == [f"| {name}" for name in tables.METHODS.values() if name != "Hush, window ±3"]
    assert rows[-1] == "| Hush, window ±2 | 0.2000 | 0.0800 | 0.1000 | 0.0500 |"


def test_the_report_tells_how_many_frames_were_scored() -> None:
    text = tables.report(results(), {"a": 8, "b": 2})
    assert text.startswith("References: a 8 frames, b 2 frames.")
    assert "a, b; 4 and 32 spp" in text
    assert "| b, 32 spp | 1.50 | 0.80 | 0.50 | 1.00 |" in text


def test_a_curve_that_falls_is_not_called_monotone() -> None:
    assert tables.monotone([0.1, 0.1, 0.3])
    assert not tables.monotone([0.1, 0.3, 0.29])
    assert tables.monotone([0.1, None, 0.3])


def test_only_what_is_between_the_markers_is_replaced() -> None:
    document = "before\n<!-- x: written by training/benchmark/run.py -->\nold\n<!-- end of x -->\nafter\n"
    once = tables.replaced(document, "x", "new")
    assert once == "before\n<!-- x: written by training/benchmark/run.py -->\nnew\n<!-- end of x -->\nafter\n"
    assert tables.replaced(once, "x", "new") == once
    with pytest.raises(ValueError, match="written by"):
        tables.replaced("no markers", "x", "new")

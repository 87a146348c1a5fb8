"""Means, ratios, standard errors and verdicts of the benchmark's tables; no Blender, no PyTorch, no OIDN."""

from __future__ import annotations

import math
import random
import sys

import pytest
from conftest import ROOT

sys.path.append(str(ROOT))

from training.benchmark import tables  # noqa: E402

FRAMES = 4


def scores(smape: float, relmse: float = 0.1, flicker: float = 0.1) -> dict[str, list[float | None]]:
    """The same in every frame; of unbiased flicker the square."""
    every = {"smape": smape, "relmse": relmse, "flip": 0.1, "unbiased_relmse": relmse}
    changes = {"flicker": flicker, "unbiased_flicker": flicker**2}
    return {**{m: [v] * FRAMES for m, v in every.items()}, **{m: [None, *[v] * (FRAMES - 1)] for m, v in changes.items()}}


def results() -> dict[tuple[str, int], dict[str, dict[str, list[float | None]]]]:
    """Two shots at two numbers of samples; Hush ±2 at half OIDN's SMAPE on one shot and at 1.5 times on the other."""
    found = {}
    for shot, factor in (("a", 0.5), ("b", 1.5)):
        for spp, level in ((4, 0.2), (32, 0.1)):
            methods = {method: scores(level) for method in tables.METHODS}
            methods["window2"] = scores(level * factor, relmse=0.08, flicker=0.04)
            found[shot, spp] = methods
    return found


def test_the_peer_is_oidn_as_cycles_runs_it_and_simpler_modes_are_further_rows() -> None:
    assert tables.METHODS[tables.PEER] == "OIDN as Cycles runs it"
    assert [m for m in tables.METHODS if m.startswith("oidn")] == ["oidn_clean_aux", "oidn_high", "oidn_fast"]
    found = results()
    for take in found.values():
        take["oidn_high"] = scores(99.0)
    assert tables.ratio(found, "window2", "smape", ["a"], [4]) == pytest.approx(0.5)


def test_a_ratio_is_of_the_means_over_takes() -> None:
    assert tables.ratio(results(), "window2", "smape", ["a"], [4]) == pytest.approx(0.5)
    assert tables.ratio(results(), "window2", "smape", ["a", "b"], [4, 32]) == pytest.approx((0.1 + 0.05 + 0.3 + 0.15) / 0.6)


def test_unbiased_flicker_is_the_root_of_the_mean_of_the_squares() -> None:
    assert tables.score("unbiased_flicker", [None, 0.09, -0.01]) == pytest.approx(0.2)
    assert tables.score("unbiased_flicker", [None, 0.01, -0.02]) == 0
    assert tables.score("flicker", [None, 0.2, 0.4]) == pytest.approx(0.3)
    assert tables.ratio(results(), "window2", "unbiased_flicker", ["a", "b"], [4]) == pytest.approx(0.4)


def test_what_was_not_measured_is_neither_met_nor_missed() -> None:
    found = results()
    for take in found.values():
        take["window2"]["unbiased_flicker"] = []
    assert tables.ratio(found, "window2", "unbiased_flicker", ["a", "b"], [4, 32]) is None
    assert tables.verdict(None, 0.5) == "not measured"
    assert "unbiased flicker at most 0.45× | – | – | – | not measured |" in tables.target_table(found, ["a", "b"], [4, 32])


def test_a_peer_below_the_noise_gives_no_ratio() -> None:
    found = results()
    for take in found.values():
        take[tables.PEER]["unbiased_relmse"] = [-0.1] * FRAMES
    assert tables.ratio(found, "window2", "unbiased_relmse", ["a"], [4]) is None


def test_a_missing_score_is_left_out_of_the_mean_and_not_taken_for_0() -> None:
    assert tables.mean([0.2, None, 0.4]) == pytest.approx(0.3)
    assert tables.mean([None]) is None


@pytest.mark.parametrize(("found", "said"), [(0.8, "met"), (0.79, "met"), (0.801, "missed")])
def test_a_target_is_met_at_its_limit(found: float, said: str) -> None:
    assert tables.verdict(found, 0.8) == said


def test_the_target_table_has_a_line_for_each_target_of_the_benchmark() -> None:
    lines = tables.target_table(results(), ["a", "b"], [4, 32]).splitlines()
    assert lines[0] == "| a, b; over OIDN as Cycles runs it | 4 spp | 32 spp | all | target |"
    sure = "0.80 ± 0.00"
    assert lines[2:] == [
        "| Hush, window ±2: SMAPE at most 0.8× | 1.00 | 1.00 | 1.00 | missed |",
        f"| Hush, window ±2: unbiased relMSE at most 0.6× | {sure} | {sure} | {sure} | missed |",
        "| Hush, window ±2: unbiased flicker at most 0.45× | 0.40 ± 0.00 | 0.40 ± 0.00 | 0.40 ± 0.00 | met |",
        "| Hush, window 0: SMAPE at most 1.05× | 1.00 | 1.00 | 1.00 | met |",
        "| Hush, window 0: unbiased relMSE at most 1.1× | 1.00 ± 0.00 | 1.00 ± 0.00 | 1.00 ± 0.00 | met |",
        "| Hush, window ±2: SMAPE at most 1.0× on every shot | 1.50 (b) | 1.50 (b) | 1.50 (b) | missed |",
        f"| Hush, window ±2: unbiased relMSE at most 1.0× on every shot | {sure} (a) | {sure} (a) | {sure} (a) | met |",
    ]


def test_one_bad_shot_misses_the_target_of_every_shot_though_the_mean_is_good() -> None:
    found = results()
    found["b", 32]["window2"]["unbiased_relmse"] = [0.11] * FRAMES
    target = next(t for t in tables.TARGETS if t.every_shot and t.metric == "unbiased_relmse")
    worst, text = tables.ratio_cell(found, target, ["a", "b"], [4, 32])
    assert (worst, text) == (pytest.approx(1.1), "1.10 ± 0.00 (b)")
    assert tables.ratio(found, "window2", "unbiased_relmse", ["a", "b"], [4, 32]) < 1.0
    del found["a", 4]["window2"]["unbiased_relmse"]
    assert tables.ratio_cell(found, target, ["a", "b"], [4, 32]) == (None, "–"), "a shot that was not measured is not met"


def test_the_standard_error_is_how_far_the_mean_scatters() -> None:
    """Of many made-up measurements with independent frames, the jackknife's error of a mean and of a ratio is their spread."""
    draw, found, told = random.Random(1), [], []
    of = lambda r: tables.ratio(r, "window2", "unbiased_relmse", ["a", "b"], [4])
    for _ in range(400):
        made: dict[tuple[str, int], dict[str, dict[str, list[float | None]]]] = {}
        for shot, level in (("a", 0.1), ("b", 0.3)):
            shared = [draw.gauss(0, 0.02) for _ in range(8)]  # the references' noise, which both methods meet
            peer, ours = ([level * k + s + draw.gauss(0, 0.01) for s in shared] for k in (1.0, 0.5))
            made[shot, 4] = {tables.PEER: {"unbiased_relmse": peer}, "window2": {"unbiased_relmse": ours}}
        found.append(of(made))
        told.append(tables.standard_error(of, made, "unbiased_relmse"))
    middle = sum(found) / len(found)
    spread = math.sqrt(sum((value - middle) ** 2 for value in found) / (len(found) - 1))
    assert middle == pytest.approx(0.5, abs=0.01)
    assert math.sqrt(sum(t * t for t in told) / len(told)) == pytest.approx(spread, rel=0.1)


def test_noise_that_all_numbers_of_samples_share_is_not_taken_for_independent() -> None:
    """The references of a shot are the same at all of them."""
    draw, found, told = random.Random(3), [], []
    of = lambda r: tables.averaged(r, tables.PEER, "unbiased_relmse", ["a", "b"], [4, 32])
    for _ in range(400):
        made = {}
        for shot in ("a", "b"):
            shared = [draw.gauss(0, 0.02) for _ in range(8)]
            for spp in (4, 32):
                made[shot, spp] = {tables.PEER: {"unbiased_relmse": [0.1 + s + draw.gauss(0, 0.005) for s in shared]}}
        found.append(of(made))
        told.append(tables.standard_error(of, made, "unbiased_relmse"))
    middle = sum(found) / len(found)
    spread = math.sqrt(sum((value - middle) ** 2 for value in found) / (len(found) - 1))
    assert math.sqrt(sum(t * t for t in told) / len(told)) == pytest.approx(spread, rel=0.1)


def test_changes_that_share_a_frame_make_the_error_larger() -> None:
    """The mean of squared differences of independent numbers scatters more than if the differences were independent."""
    draw, found, told = random.Random(2), [], []
    of = lambda r: tables.mean(r["a", 4][tables.PEER]["unbiased_flicker"])
    for _ in range(600):
        first, second = ([draw.gauss(0, 1) for _ in range(25)] for _ in range(2))
        changes = [(a1 - a0) * (b1 - b0) for a0, a1, b0, b1 in zip(first, first[1:], second, second[1:], strict=False)]
        made = {("a", 4): {tables.PEER: {"unbiased_flicker": [None, *changes]}}}
        found.append(of(made))
        told.append(tables.standard_error(of, made, "unbiased_flicker"))
    spread = math.sqrt(sum(value**2 for value in found) / len(found))
    assert math.sqrt(sum(t * t for t in told) / len(told)) == pytest.approx(spread, rel=0.1)


def test_one_frame_has_no_standard_error() -> None:
    found = results()
    for method in found["a", 4].values():
        method["unbiased_relmse"] = [0.1]
    assert tables.standard_error(lambda r: 1.0, tables.chosen(found, ["a"], [4]), "unbiased_relmse") is None
    assert "0.1000 |" in tables.score_table(found, ["a"], [4])


def test_mid_shot_are_the_frames_with_a_whole_window() -> None:
    by_frame = [float(n) for n in range(1, 9)]
    assert tables.in_mid_shot("smape", by_frame, range(1, 9), range(1, 9)) == [None, None, 3, 4, 5, 6, None, None]
    assert tables.in_mid_shot("unbiased_flicker", by_frame, range(1, 9), range(1, 9)) == [None, None, None, 4, 5, 6, None, None]
    assert tables.in_mid_shot("smape", [3.0, 4.0, 6.0], [3, 4, 6], range(1, 9)) == [3, 4, 6], "frames without a reference still help"
    assert tables.in_mid_shot("flicker", [None, 4.0, 6.0], [3, 4, 6], range(1, 9)) == [None, 4, None]


def test_a_method_that_was_not_run_has_no_row() -> None:
    found = results()
    for take in found.values():
        del take["window3"]
    rows = tables.score_table(found, ["a", "b"], [4]).splitlines()[2:]
    assert [row.split(" | ")[0] for row in rows] == [f"| {name}" for name in tables.METHODS.values() if name != "Hush, window ±3"]
    assert rows[-1] == "| Hush, window ±2 | 0.2000 | 0.0800 | 0.1000 | 0.0400 | 0.0800 ± 0.0000 | 0.0400 ± 0.0000 |"


def test_the_first_shots_have_tables_of_their_own_once_there_are_others() -> None:
    text = tables.report(results(), results(), ["a", "b", "c"])
    assert text.startswith("| a, b; over OIDN") and "a, b; 4 and 32 spp" in text
    assert "| b, 32 spp | 1.50 | 0.80 ± 0.00 | 0.40 ± 0.00 | 1.00 | 1.00 ± 0.00 |" in text
    apart = tables.report(results(), results(), ["a"])
    assert "| a, b; over OIDN" in apart and "| a; over OIDN" in apart and "| a; 4 and 32 spp |" in apart
    assert "| a; over OIDN" not in text


def test_the_ratios_of_each_shot_stand_there_with_and_without_the_ends() -> None:
    inner = results()
    inner["b", 32]["window2"] = scores(0.1) | {"flip": [0.08] * FRAMES}
    text = tables.report(results(), inner, ["a"])
    ends, whole = (part.splitlines() for part in text.split("\n\n") if "window ±2 FLIP" in part)
    assert "frames with a whole window" in whole[0] and "whole window" not in ends[0]
    titles = ["a, 4 spp", "a, 32 spp", "b, 4 spp", "b, 32 spp", "a", "b", "a, b", "a"]
    assert [row.split(" | ")[0].removeprefix("| ") for row in whole[2:]] == titles
    assert whole[5].endswith("| 0.80 | 1.00 | 1.00 ± 0.00 |") and ends[5].endswith("| 1.00 | 1.00 | 1.00 ± 0.00 |")
    assert ends[8].startswith("| a, b | 1.00 | 0.80 ± 0.00 | 0.40 ± 0.00 |"), "of the means over all"


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

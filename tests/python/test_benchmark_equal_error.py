"""How many samples the peer needs for Hush's error, on curves whose answer is known; no Blender, no PyTorch, no OIDN."""

from __future__ import annotations

import math
import random
import sys
import xml.etree.ElementTree as ElementTree

import pytest
from conftest import ROOT

sys.path.append(str(ROOT))

from training.benchmark import equal_error, tables  # noqa: E402

SPP = (2, 4, 8, 16, 32, 64, 128)


def results(ours: float, theirs: float, slope: float, noise: float = 0.0, seed: int = 1) -> dict:
    """Errors that fall as samples^-slope, `ours` and `theirs` at one sample, in two shots of eight frames."""
    draw = random.Random(seed)
    found = {}
    for shot, level in (("a", 0.5), ("b", 1.5)):
        for spp in SPP:
            frames = lambda at, scale=level * spp**-slope: [at * scale * (1 + noise * draw.gauss(0, 1)) for _ in range(8)]
            both = {tables.PEER: frames(theirs), equal_error.METHOD: frames(ours)}
            found[shot, spp] = {method: {"smape": by, "unbiased_relmse": by} for method, by in both.items()}
    return found


def test_on_a_power_law_the_answer_is_exact() -> None:
    """Error c·n^-s: k times less error is k^(1/s) times the samples, wherever the numbers that were measured lie."""
    found = results(0.6, 1.0, 0.8)
    ours, peer = (equal_error.curve(found, method, "unbiased_relmse") for method in (equal_error.METHOD, tables.PEER))
    assert ours[4] == pytest.approx(0.6 * 4**-0.8)
    for equal in equal_error.equals(ours, peer):
        assert equal.needed == pytest.approx(equal.spp * 0.6 ** (-1 / 0.8))
    assert [equal.spp for equal in equal_error.equals(ours, peer)] == list(equal_error.AT)


def test_between_two_numbers_it_goes_straight_in_logarithms() -> None:
    assert equal_error.needed({4: 1.0, 64: 0.01}, 0.1) == pytest.approx(16)
    assert equal_error.needed({4: 1.0, 16: 0.5, 64: 0.4}, 0.5) == pytest.approx(16)
    assert equal_error.needed({4: 1.0, 8: 1.0}, 1.0) == pytest.approx(4)
    # A curve that noise makes rise is met where it is met first.
    assert equal_error.needed({4: 1.0, 8: 0.4, 16: 0.6, 32: 0.2}, 0.5) == pytest.approx(4 * 2 ** (math.log(2) / math.log(2.5)))


def test_beyond_what_was_measured_nothing_is_guessed() -> None:
    peer = {4: 1.0, 64: 0.1}
    assert equal_error.needed(peer, 0.09) is None and equal_error.needed(peer, 1.1) is None
    below, above = equal_error.equals({16: 0.05}, peer), equal_error.equals({16: 2.0}, peer)
    assert equal_error.words(below[0], peer, None) == ["more than 64", "> 4.0×"]
    assert equal_error.words(above[0], peer, None) == ["fewer than 4", "< 0.2×"]
    far = results(1e-6, 1.0, 0.8)
    assert "marker-end" not in equal_error.figure(far) and "more than 128" in equal_error.report(far)


def test_an_error_below_its_noise_has_no_point() -> None:
    found = results(0.6, 1.0, 0.8)
    for shot in ("a", "b"):
        found[shot, 128][tables.PEER]["unbiased_relmse"] = [-1e-5] * 8
    assert list(equal_error.curve(found, tables.PEER, "unbiased_relmse")) == [2, 4, 8, 16, 32, 64]


def test_a_number_of_samples_that_one_shot_lacks_is_left_out() -> None:
    found = results(0.6, 1.0, 0.8)
    del found["b", 16]
    assert list(equal_error.curve(found, tables.PEER, "smape")) == [2, 4, 8, 32, 64, 128]


def test_the_report_tells_the_factor_and_how_sure_it_is() -> None:
    text = equal_error.report(results(0.5, 1.0, 1.0, noise=0.1))
    factors = [line.split(" | ")[3].removesuffix(" |") for line in text.splitlines() if line.startswith(("| 4 |", "| 32 |"))]
    assert len(factors) == 4
    for factor in factors:
        value, _, error = factor.removesuffix("×").partition(" ± ")
        # 16 frames of 10 % in four points: within a few of its own standard errors of 2, and not surer than it can be.
        assert abs(float(value) - 2) < 4 * float(error) and 0.02 < float(error) < 0.3


def test_the_error_of_the_factor_is_its_spread() -> None:
    found, told = [], []
    for seed in range(60):
        made = results(0.5, 1.0, 1.0, noise=0.1, seed=seed)
        of = lambda r: equal_error.share_of(r, "unbiased_relmse", 8)
        found.append(of(made))
        told.append(tables.standard_error(of, made, "unbiased_relmse"))
    middle = sum(found) / len(found)
    spread = math.sqrt(sum((value - middle) ** 2 for value in found) / (len(found) - 1))
    assert math.sqrt(sum(t * t for t in told) / len(told)) == pytest.approx(spread, rel=0.3)


def test_the_figure_has_both_curves_and_the_arrows() -> None:
    text = equal_error.figure(results(0.5, 1.0, 1.0))
    drawn = ElementTree.fromstring(text)
    svg = "{http://www.w3.org/2000/svg}"
    assert len(drawn.findall(f"{svg}polyline")) == 4
    points = [[tuple(map(float, p.split(","))) for p in line.get("points", "").split()] for line in drawn.findall(f"{svg}polyline")]
    assert all(x1 > x0 and y1 > y0 for line in points for (x0, y0), (x1, y1) in zip(line, line[1:], strict=False)), "errors fall"
    arrows = [path for path in drawn.findall(f"{svg}path") if path.get("marker-end")]
    assert len(arrows) == 2 * len(equal_error.AT)
    assert sum(label.text == "2.0×" for label in drawn.iter(f"{svg}text")) == 2 * len(equal_error.AT)
    width, height = map(float, drawn.get("viewBox", "").split()[2:])
    assert all(50 <= x <= width - 20 and 20 <= y <= height - 40 for line in points for x, y in line)

"""Previews in Python: the arrays, the sheet, and what they take from beside the frames."""

from __future__ import annotations

import inspect as introspect
from pathlib import Path

import hush
import numpy as np
import pytest
from exr_shots import HEIGHT, WIDTH, write_shot
from images import channels, layer


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A shot of five small frames with two view layers."""
    return write_shot(tmp_path_factory.mktemp("small") / "shot", 5, ("Near", "Far"))


def test_a_preview_is_what_a_run_writes(small: Path, tmp_path: Path) -> None:
    done = hush.denoise_sequence(small, tmp_path, frames=[3], lam=4, layers=["Far"])
    assert done["written"] == 1
    told = hush.preview(small, 3, lam=4, layers=["Far"])
    assert told["denoised"].dtype == np.float32 and told["denoised"].shape == (HEIGHT, WIDTH, 3)
    assert (told["layer"], told["lam"], told["window"], told["neighbours"]) == ("Far", 4.0, 2, [1, 2, 4, 5])
    assert (told["region"], told["columns"], told["rows"]) == ((0, 0, WIDTH, HEIGHT), WIDTH, HEIGHT)
    assert np.array_equal(told["denoised"], layer(tmp_path / "f_0003.exr", "Far.Combined"))
    assert np.array_equal(told["noisy"], layer(small / "f_0003.exr", "Far.Combined"))
    assert told["flicker"] is None and told["previous"] is None and told["change"] is None and told["noisy_flicker"] is None


def test_a_sheet_is_never_written_over_a_frame(small: Path, tmp_path: Path) -> None:
    frame = small / "f_0003.exr"
    before = frame.read_bytes()
    for output in (frame, tmp_path / "sheet.jpg"):
        with pytest.raises(ValueError, match=r"ends in \.png"):
            hush.preview_sheet(small, 3, output)
    linked = tmp_path / "linked.png"
    linked.symlink_to(frame)
    with pytest.raises(ValueError, match="one of the frames"):
        hush.preview_sheet(small, 3, linked)
    assert frame.read_bytes() == before


def test_a_region_and_its_flicker(small: Path) -> None:
    whole = hush.preview(small, 3, flicker=True, layers=["Near"])
    part = hush.preview(small, 3, flicker=True, layers=["Near"], region=(11, 7, 20, 16))
    cut = np.s_[7:23, 11:31]
    for name in ("denoised", "noisy"):
        assert np.allclose(part[name], whole[name][cut], rtol=1e-3, atol=1e-4)
    for name in ("flicker", "noisy_flicker", "previous"):
        assert np.allclose(part[name], whole[name][cut], atol=2e-3, equal_nan=True)
    assert whole["flicker"].shape == (HEIGHT, WIDTH)
    assert np.isclose(np.nanmean(whole["flicker"]), whole["change"], atol=1e-5)
    # By hand at one pixel: where the point was, and how much it changed.
    vector = np.stack([channels(small / "f_0003.exr")[f"Near.Vector.{c}"] for c in "XY"], -1)
    now, last = (layer(small / f"f_{n:04d}.exr", "Near.Combined").astype(np.float64) for n in (3, 2))
    x, y = 30 + vector[20, 30, 0], 20 - vector[20, 30, 1]
    left, top = int(np.floor(x)), int(np.floor(y))
    fx, fy = x - left, y - top
    four = last[top : top + 2, left : left + 2]
    before = (1 - fy) * ((1 - fx) * four[0, 0] + fx * four[0, 1]) + fy * ((1 - fx) * four[1, 0] + fx * four[1, 1])
    ratio = np.mean(np.abs(now[20, 30] - before) / (np.abs(now[20, 30]) + before))
    assert np.isclose(whole["noisy_flicker"][20, 30], ratio, rtol=0.1)


def test_settings_beside_the_frames_count_unless_given(small: Path, tmp_path: Path) -> None:
    frames = write_shot(tmp_path / "shot", 3)
    (frames / "hush.toml").write_text("lambda = [[1, 1], [3, 9]]\nwindow = 1\n")
    told = hush.preview(frames, 2)
    assert (told["lam"], told["window"], told["neighbours"]) == (5.0, 1, [1, 3])
    assert hush.preview(frames, 2, lam=2, window=0)["lam"] == 2.0
    assert hush.preview(frames, 2, settings=False)["window"] == 2
    other = tmp_path / "other.toml"
    other.write_text("lambda = 7\n")
    assert hush.preview(frames, 2, settings=other)["lam"] == 7.0


def test_a_sheet(small: Path, tmp_path: Path) -> None:
    steps: list[float] = []
    out = tmp_path / "sheet.png"
    told = hush.preview_sheet(small, 3, out, lam=(1, 4), window=(0, 2), flicker=True, before_after=0.5, exposure=1, progress=steps.append)
    assert out.read_bytes().startswith(b"\x89PNG")
    assert [(t["window"], t["lam"]) for t in told["tiles"]] == [(0, 1.0), (0, 4.0), (2, 1.0), (2, 4.0)]
    assert all(0 < t["change"] < t["noisy_change"] for t in told["tiles"])
    assert steps[0] == 0.0 and steps[-1] == 1.0 and steps == sorted(steps)


def test_what_is_refused(small: Path, tmp_path: Path) -> None:
    for error, arguments in (
        (ValueError, {"frame": 9}),
        (ValueError, {"lam": 0.5}),
        (ValueError, {"window": 4}),
        (ValueError, {"region": (0, 0, WIDTH + 1, 1)}),
        (TypeError, {"layers": 3}),
        (TypeError, {"region": (1, 2)}),
        (OSError, {"inputs": tmp_path / "nowhere"}),
    ):
        with pytest.raises(error):
            hush.preview(**{"inputs": small, "frame": 3, **arguments})
    with pytest.raises(hush.HushError, match="stopped"):
        hush.preview(small, 3, cancel=lambda: True)
    with pytest.raises(ZeroDivisionError):
        hush.preview(small, 3, progress=lambda _: 1 / 0)
    with pytest.raises(ValueError, match="before_after"):
        hush.preview_sheet(small, 3, tmp_path / "a.png", before_after=2)
    assert not (tmp_path / "a.png").exists()
    for call, name, wrong in (
        (hush.preview, "lam", [1, 4]),
        (hush.preview, "window", 1.5),
        (hush.preview_sheet, "lam", "1,4"),
        (hush.preview_sheet, "window", [0, "2"]),
        (hush.preview_sheet, "output", b"a.png"),
    ):
        with pytest.raises(TypeError, match=f"^{name}: expected"):
            call(**{"inputs": small, "frame": 3, **({"output": tmp_path / "a.png"} if call is hush.preview_sheet else {}), name: wrong})


def test_whatever_gives_numbers_will_do(small: Path, tmp_path: Path) -> None:
    """Arrays and generators too."""
    settings = {"lam": np.array([1, 4], np.float32), "window": (window for window in (0,)), "region": (0, 0, 8, 8)}
    told = hush.preview_sheet(small, 3, tmp_path / "sheet.png", **settings)
    assert [(tile["window"], tile["lam"]) for tile in told["tiles"]] == [(0, 1.0), (0, 4.0)]
    assert hush.preview(small, 3, lam=np.float32(4), window=np.int64(0), region=(0, 0, 8, 8))["lam"] == 4.0


def test_the_sheet_takes_what_the_preview_takes() -> None:
    one, sheet = (introspect.signature(f).parameters for f in (hush.preview, hush.preview_sheet))
    assert set(sheet) - set(one) == {"output", "before_after", "exposure"} and not set(one) - set(sheet)

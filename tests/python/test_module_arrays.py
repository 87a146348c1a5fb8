"""The Python module on NumPy arrays: what it takes, what it refuses, and the same bits as for files."""

from __future__ import annotations

import gc
import os
import subprocess
import sys
import threading
import time
from pathlib import Path

import hush
import numpy as np
import pytest
from exr_shots import HEIGHT, WIDTH, Passes, passes, write_frame, write_shot
from images import combined

MODEL = Path(__file__).resolve().parents[2] / "models" / "hush.safetensors"


@pytest.fixture(scope="module")
def frame() -> Passes:
    return passes(1)


@pytest.fixture(scope="module")
def clean(frame: Passes) -> np.ndarray:
    return hush.denoise(**frame)


def same(a: np.ndarray, b: np.ndarray) -> bool:
    return a.dtype == b.dtype and a.shape == b.shape and a.tobytes() == b.tobytes()


def resident() -> float:
    """MiB of memory that this process holds."""
    status = Path("/proc/self/status").read_text()
    return int(status.split("VmRSS:")[1].split()[0]) / 1024


def test_an_image_is_denoised_and_the_input_is_not_touched(frame: Passes, clean: np.ndarray) -> None:
    before = {name: image.copy() for name, image in frame.items()}
    again = hush.denoise(frame["color"], frame["albedo"], frame["normal"], frame["depth"], frame["vector"])
    assert same(again, clean)
    assert (clean.dtype, clean.shape) == (np.float32, (HEIGHT, WIDTH, 3))
    assert clean.flags.writeable
    assert clean.flags.owndata or clean.base is not None
    assert np.isfinite(clean).all()
    assert clean.std() < 0.5 * frame["color"].std()
    assert all(same(image, before[name]) for name, image in frame.items())


def test_guides_and_lambda_matter_and_vectors_of_a_lone_frame_do_not(frame: Passes, clean: np.ndarray) -> None:
    without = lambda name: {key: image for key, image in frame.items() if key != name}
    for name in ("albedo", "normal", "depth"):
        assert not same(hush.denoise(**without(name)), clean), name
    assert same(hush.denoise(**without("vector")), clean)
    noisy = frame["color"]
    kept = hush.denoise(**frame, lam=64)
    assert np.abs(kept - noisy).mean() < np.abs(clean - noisy).mean()


def half_and_half() -> np.ndarray:
    """λ 1 on the left, 64 on the right."""
    lam = np.ones((HEIGHT, WIDTH), np.float32)
    lam[:, WIDTH // 2 :] = 64
    return lam


def test_lambda_may_be_an_array(frame: Passes, clean: np.ndarray) -> None:
    kept = hush.denoise(**frame, lam=64)
    assert same(hush.denoise(**frame, lam=np.ones((HEIGHT, WIDTH), np.float32)), clean)
    assert same(hush.denoise(**frame, lam=np.full((HEIGHT, WIDTH), 64.0)), kept)
    assert same(hush.denoise(**frame, lam=np.float32(64)), kept)
    assert same(hush.denoise(**frame, lam=np.array(64.0)), kept)
    with pytest.raises(TypeError, match="lam: "):
        hush.denoise(**frame, lam="64")  # type: ignore[arg-type]
    mixed = hush.denoise(**frame, lam=half_and_half())
    apart = lambda other, where: np.abs(mixed - other)[:, where].mean()
    for where, near, far in ((slice(0, WIDTH // 4), clean, kept), (slice(3 * WIDTH // 4, None), kept, clean)):
        assert apart(near, where) < 0.5 * apart(far, where)
    for layout in (np.asfortranarray(half_and_half()), np.repeat(half_and_half(), 2, 1)[:, ::2]):
        assert same(hush.denoise(**frame, lam=layout), mixed)
    (pushed,) = hush.Denoiser(window=0).push(**frame, lam=half_and_half())
    assert same(pushed.color, mixed)


def test_odd_values_of_lambda_are_told_and_odd_arrays_refused(frame: Passes) -> None:
    lam = half_and_half()
    lam[0, :4] = np.nan, 0, 1e9, -np.inf
    sound = half_and_half()
    sound[0, :4] = 7, 1, 64, 1
    denoiser = hush.Denoiser(window=0, lam=7)
    with pytest.warns(UserWarning, match=r"lam: holds values outside 1…64 or NaN, in 4 pixels"):
        (told,) = denoiser.push(**frame, lam=lam)
    (quiet,) = denoiser.push(**frame, lam=sound)
    assert same(told.color, quiet.color)
    for shape in ((WIDTH, HEIGHT), (HEIGHT, WIDTH, 1), (1, 1)):
        with pytest.raises(ValueError, match=r"lam: shape .*expected \(45, 67\) like color, or a number"):
            hush.denoise(**frame, lam=np.ones(shape, np.float32))
    with pytest.raises(TypeError, match=r"lam: expected float32"):
        hush.denoise(**frame, lam=np.ones((HEIGHT, WIDTH), int))  # type: ignore[arg-type]


def test_any_layout_of_float32_gives_the_same_bits(frame: Passes, clean: np.ndarray) -> None:
    wide = {name: np.zeros((2 * HEIGHT, 3 * WIDTH, *image.shape[2:]), np.float32) for name, image in frame.items()}
    for name, image in frame.items():
        wide[name][::2, ::3] = image
    strided = {name: image[::2, ::3] for name, image in wide.items()}
    flipped = {name: np.ascontiguousarray(image[::-1, ::-1])[::-1, ::-1] for name, image in frame.items()}
    fortran = {name: np.asfortranarray(image) for name, image in frame.items()}
    for layout in (strided, flipped, fortran):
        assert not any(image.flags.c_contiguous for image in layout.values())
        assert same(hush.denoise(**layout), clean)


def test_read_only_and_unaligned_and_swapped_arrays_are_taken(frame: Passes, clean: np.ndarray) -> None:
    color = frame["color"].copy()
    color.flags.writeable = False
    assert same(hush.denoise(**{**frame, "color": color}), clean)
    packed = np.zeros((HEIGHT, WIDTH, 3), np.dtype([("flag", "u1"), ("value", "f4")]))
    packed["value"] = color
    assert not packed["value"].flags.aligned
    assert same(hush.denoise(**{**frame, "color": packed["value"]}), clean)
    assert same(hush.denoise(**{**frame, "color": color.astype(">f4")}), clean)


def test_other_floats_are_converted(frame: Passes, clean: np.ndarray) -> None:
    assert same(hush.denoise(**{name: image.astype(np.float64) for name, image in frame.items()}), clean)
    halves = {name: image.astype(np.float16) for name, image in frame.items()}
    assert same(hush.denoise(**halves), hush.denoise(**{name: image.astype(np.float32) for name, image in halves.items()}))


def test_alpha_is_denoised_too(frame: Passes, clean: np.ndarray) -> None:
    alpha = np.random.default_rng(1).random((HEIGHT, WIDTH, 1), np.float32)
    result = hush.denoise(**{**frame, "color": np.concatenate([frame["color"], alpha], -1)})
    assert result.shape == (HEIGHT, WIDTH, 4)
    assert np.allclose(result[:, :, :3], clean, rtol=1e-5)
    assert 0 <= result[:, :, 3].min() and result[:, :, 3].max() <= 1
    assert result[:, :, 3].std() < 0.5 * alpha.std()


def test_the_result_goes_where_it_is_wanted(frame: Passes, clean: np.ndarray) -> None:
    out = np.zeros_like(frame["color"])
    assert hush.denoise(**frame, out=out) is out
    assert same(out, clean)
    place = frame["color"].copy()
    assert hush.denoise(**{**frame, "color": place}, out=place) is place
    assert same(place, clean)
    half_of_it = np.zeros((HEIGHT, 2 * WIDTH, 3), np.float32)[:, ::2]
    for bad in (half_of_it, np.zeros_like(clean, np.float64), [1.0]):
        with pytest.raises(TypeError, match="out"):
            hush.denoise(**frame, out=bad)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match=r"out: shape \(2, 2, 3\), expected \(45, 67, 3\) like color"):
        hush.denoise(**frame, out=np.zeros((2, 2, 3), np.float32))
    clean_view = clean.copy()
    clean_view.flags.writeable = False
    with pytest.raises(ValueError, match="out"):
        hush.denoise(**frame, out=clean_view)
    with pytest.raises(ValueError, match="out: color cannot be written"):
        hush.denoise(**{**frame, "color": clean_view}, out=clean_view)
    with pytest.raises(ValueError, match="give color itself"):
        hush.denoise(**{**frame, "color": place}, out=place[:])


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork here")
def test_a_forked_process_denoises_with_an_engine_of_its_own(tmp_path: Path) -> None:
    program = """
import multiprocessing, sys, hush, numpy as np
color = np.full((16, 16, 3), 0.5, np.float32)
clean, denoiser = hush.denoise(color), hush.Denoiser(window=0)
def child(answers):
    try:
        denoiser.push(color)
    except hush.HushError as error:
        answers.put((str(error), hush.denoise(color).tobytes(), hush.Denoiser(window=0).push(color)[0].color.tobytes()))
context = multiprocessing.get_context("fork")
answers = context.Queue()
process = context.Process(target=child, args=(answers,))
process.start()
message, *images = answers.get(timeout=60)
assert "forked" in message, message
assert images == [clean.tobytes()] * 2
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=120, check=False, cwd=tmp_path)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize(
    ("name", "shape", "expected"),
    [
        ("color", (HEIGHT, WIDTH), "(height, width, 3)"),
        ("color", (HEIGHT, WIDTH, 5), "(height, width, 3)"),
        ("color", (0, WIDTH, 3), "(height, width, 3)"),
        ("color", (3,), "(3,)"),
        ("albedo", (HEIGHT, WIDTH, 4), "(45, 67, 3) like color"),
        ("albedo", (WIDTH, HEIGHT, 3), "(67, 45, 3), expected (45, 67, 3)"),
        ("normal", (HEIGHT, WIDTH), "(45, 67, 3)"),
        ("depth", (HEIGHT, WIDTH, 1), "(45, 67) like color"),
        ("vector", (HEIGHT, WIDTH, 2), "(45, 67, 4)"),
    ],
)
def test_wrong_shapes_are_named(frame: Passes, name: str, shape: tuple[int, ...], expected: str) -> None:
    wrong = {**frame, name: np.ones(shape, np.float32)}
    for call in (hush.denoise, hush.Denoiser().push):
        with pytest.raises(ValueError) as error:
            call(**wrong)
        assert str(error.value).startswith(f"{name}: shape ")
        assert expected in str(error.value)


@pytest.mark.parametrize("wrong", [np.ones((HEIGHT, WIDTH, 3), np.uint8), [[[1.0, 1.0, 1.0]]], None, "color", np.array([object()])])
def test_wrong_types_are_named(frame: Passes, wrong: object) -> None:
    for name in ("color", "albedo"):
        if name == "albedo" and wrong is None:
            continue
        with pytest.raises(TypeError, match=f"{name}: expected .*float32"):
            hush.denoise(**{**frame, name: wrong})


@pytest.mark.parametrize(
    ("setting", "value", "error"),
    [
        ("lam", 0.99, ValueError),
        ("lam", 64.5, ValueError),
        ("lam", float("nan"), ValueError),
        ("lam", "much", TypeError),
        ("memory", 0, ValueError),
        ("threads", 0, ValueError),
        ("threads", 5000, ValueError),
        ("model", "/nowhere/weights.safetensors", FileNotFoundError),
        ("model", __file__, hush.HushError),
        ("renderer", "arnold", ValueError),
    ],
)
def test_bad_settings_are_refused(frame: Passes, setting: str, value: object, error: type[Exception]) -> None:
    with pytest.raises(error):
        hush.denoise(frame["color"], **{setting: value})
    with pytest.raises(error):
        hush.Denoiser(**{setting: value})


def test_the_window_is_bounded() -> None:
    for window in (-1, hush.MAX_WINDOW + 1):
        with pytest.raises(ValueError, match="window"):
            hush.Denoiser(window=window)


def test_threads_memory_and_model_do_not_change_a_bit(frame: Passes, clean: np.ndarray) -> None:
    assert same(hush.denoise(**frame, threads=1), clean)
    assert same(hush.denoise(**frame, memory=1), clean)
    assert same(hush.denoise(**frame, model=MODEL), clean)


def test_each_renderer_has_its_encoder(frame: Passes, clean: np.ndarray) -> None:
    assert same(hush.denoise(**frame, renderer="cycles"), clean)
    other = hush.denoise(**frame, renderer="mitsuba")
    assert np.isfinite(other).all() and not same(other, clean)


def test_a_denoiser_gives_each_frame_back_once_and_in_order() -> None:
    denoiser = hush.Denoiser(window=2, lam=4)
    assert (denoiser.window, denoiser.lam, denoiser.pending) == (2, 4.0, 0)
    assert denoiser.flush() == []
    ready = []
    for number in range(5):
        got = denoiser.push(**passes(number), tag=f"frame {number}" if number % 2 else None)
        assert len(got) == (1 if number >= 2 else 0)
        ready += got
    assert denoiser.pending == 2
    rest = denoiser.flush()
    assert (len(rest), denoiser.pending) == (2, 0)
    assert [result.tag for result in ready + rest] == [0, "frame 1", 2, "frame 3", 4]
    # After flush nothing of the old shot helps.
    denoiser.push(**passes(9))
    (alone,) = denoiser.flush()
    assert alone.tag == 5
    assert same(alone.color, hush.denoise(**passes(9), lam=4))


def test_a_mask_in_files_is_an_array_of_lambda(tmp_path: Path) -> None:
    mask = np.clip((np.arange(WIDTH, dtype=np.float32) - 30) / 8, 0, 1)[None, :].repeat(HEIGHT, 0)
    (tmp_path / "shot").mkdir()
    for number in (1, 2, 3):
        write_frame(tmp_path / "shot" / f"f_{number:04d}.exr", {"ViewLayer": {**passes(number), "mask": mask}})
    settings = {"lam": 2, "lambda_pass": "Hush Lambda", "lambda_masked": {1: 32, 3: 32}}
    done = hush.denoise_sequence(tmp_path / "shot", tmp_path / "out", **settings)
    assert done["written"] == 3 and not done["failed"], done
    denoiser = hush.Denoiser(window=2)
    results = [each for number in (1, 2, 3) for each in denoiser.push(**passes(number), lam=2 * np.float32(16) ** mask)] + denoiser.flush()
    for number, result in enumerate(results, 1):
        written = combined(tmp_path / "out" / f"f_{number:04d}.exr")
        assert np.allclose(written, result.color, rtol=1e-3, atol=1e-5), np.abs(written / result.color - 1).max()
    checked = hush.check_sequence(tmp_path / "shot", tmp_path / "out", **{**settings, "lambda_masked": 8})
    assert {(frame["state"], frame["kind"]) for frame in checked["frames"]} == {("stale", "lambda_masked")}
    with pytest.raises(hush.HushError, match="Depth Mask"):
        hush.denoise_sequence(tmp_path / "shot", tmp_path / "other", lambda_pass="Depth Mask")
    shown = hush.preview(tmp_path / "shot", 2, lam=2, window=2, lambda_pass="Hush Lambda", lambda_masked=32)["denoised"]
    assert np.array_equal(shown, combined(tmp_path / "out" / "f_0002.exr"))


def test_a_refused_frame_is_not_taken() -> None:
    denoiser = hush.Denoiser(window=1)
    with pytest.raises(ValueError, match="lam"):
        denoiser.push(**passes(1), lam=0)
    with pytest.raises(ValueError, match="albedo"):
        denoiser.push(passes(1)["color"], albedo=passes(1, height=2)["albedo"])
    assert denoiser.pending == 0


def test_light_passes_come_along(frame: Passes) -> None:
    direct = (frame["color"] * 0.25).astype(np.float32)
    denoiser = hush.Denoiser(window=0)
    (result,) = denoiser.push(**frame, aovs={"Direct": direct, "Indirect": frame["color"] - direct})
    assert list(result.aovs) == ["Direct", "Indirect"]
    assert np.allclose(result.aovs["Direct"] + result.aovs["Indirect"], result.color, rtol=1e-4, atol=1e-5)
    with pytest.raises(ValueError, match=r'aovs\["Direct"\]: shape'):
        denoiser.push(**frame, aovs={"Direct": direct[1:]})
    with pytest.raises(TypeError, match="aovs"):
        denoiser.push(**frame, aovs={1: direct})  # type: ignore[dict-item]


@pytest.mark.parametrize("second_pass", [False, True])
@pytest.mark.parametrize("window", range(hush.MAX_WINDOW + 1))
def test_a_denoiser_has_the_bits_of_the_files(tmp_path: Path, window: int, second_pass: bool) -> None:
    count = 6
    shot = write_shot(tmp_path / "shot", count)
    keys = {1: 1.0, 5: 9.0}
    done = hush.denoise_sequence(shot, tmp_path / "out", window=window, lam=keys, second_pass=second_pass)
    assert done["written"] == count
    denoiser = hush.Denoiser(window=window, second_pass=second_pass)
    results = []
    for number in range(1, count + 1):
        results += denoiser.push(**passes(number), lam=min(1 + 2.0 * (number - 1), 9), tag=number)
    results += denoiser.flush()
    assert [result.tag for result in results] == list(range(1, count + 1))
    for result in results:
        assert same(result.color, combined(tmp_path / "out" / f"f_{result.tag:04d}.exr")), result.tag


def test_other_threads_run_meanwhile() -> None:
    """A thread that sleeps a millisecond at a time gets on as long as the image is worked on."""
    big = passes(1, 540, 960)
    counted, stop = [0], threading.Event()

    def count() -> None:
        while not stop.is_set():
            counted[0] += 1
            time.sleep(0.001)

    thread = threading.Thread(target=count)
    thread.start()
    try:
        for call in (lambda: hush.denoise(**big), lambda: hush.Denoiser(window=0).push(**big)):
            before, began = counted[0], time.monotonic()
            call()
            seconds, steps = time.monotonic() - began, counted[0] - before
            assert steps > 20 * seconds + 2, f"{steps} steps in {seconds:.2f} s"
    finally:
        stop.set()
        thread.join()


def test_one_denoiser_serves_several_threads() -> None:
    denoiser = hush.Denoiser(window=1)
    results: list[hush.Denoised] = []
    push = lambda number: results.extend(denoiser.push(**passes(number), tag=number))
    threads = [threading.Thread(target=push, args=(number,)) for number in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    results += denoiser.flush()
    assert sorted(result.tag for result in results) == list(range(8))


def test_memory_comes_back() -> None:
    frames = [passes(number, 136, 240) for number in range(3)]

    def work() -> None:
        denoiser = hush.Denoiser(window=1)
        for frame in frames:
            denoiser.push(**frame, tag=object())
            hush.denoise(**frame)
        denoiser.flush()
        gc.collect()

    for _ in range(3):
        work()
    before = resident()
    for _ in range(30):
        work()
    # An image takes 0.4 MiB, six are made each time: a leak of any of them would show.
    assert resident() - before < 8, f"{before:.0f} MiB before, {resident():.0f} MiB after"

"""The Python module on NumPy arrays: what it takes, what it refuses, and the same bits as for files."""

from __future__ import annotations

import gc
import threading
import time
from pathlib import Path

import hush
import numpy as np
import pytest
from exr_shots import HEIGHT, WIDTH, Passes, passes, write_shot
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


@pytest.mark.parametrize("window", range(hush.MAX_WINDOW + 1))
def test_a_denoiser_has_the_bits_of_the_files(tmp_path: Path, window: int) -> None:
    count = 6
    shot = write_shot(tmp_path / "shot", count)
    keys = {1: 1.0, 5: 9.0}
    done = hush.denoise_sequence(shot, tmp_path / "out", window=window, lam=keys)
    assert done["written"] == count
    denoiser = hush.Denoiser(window=window)
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

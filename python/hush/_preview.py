"""One frame of a shot by several settings, for whoever chooses them. Nothing is written but the sheet."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from typing import Any, SupportsFloat, SupportsIndex, Unpack

from . import _hush
from ._sequence import refuse_bytes, shot_options
from ._settings import Path, ShotSettings


def preview(
    inputs: Path | Iterable[Path],
    frame: int,
    *,
    lam: float | None = None,
    window: int | None = None,
    region: tuple[int, int, int, int] | None = None,
    flicker: bool = False,
    progress: Callable[[float], object] | None = None,
    cancel: Callable[[], object] | None = None,
    **settings: Unpack[ShotSettings],
) -> dict[str, Any]:
    """Denoises one frame of a shot, or a part of one, in memory. Only the frames that help it are read.

    What is not given is what the shot's own settings say, else the default. The result is that of
    `denoise_sequence`; of a region it is the same to 1e-3 of each value. The GIL is released while it works.

    Args:
        inputs: A folder, a pattern (`frame_####.exr`, `frame_%04d.exr`, a glob), a file, or several of them; one sequence in all.
        frame: Number of the frame.
        lam: λ from 1 (cleanest) to 64 (keeps grain and the detail hidden in it).
        window: Frames on each side that help, 0 to 3.
        region: (x, y, width, height) in pixels from the upper left corner; None for the whole frame. The rest is not computed.
        flicker: Also compare with the frame before, which is then denoised too.
        progress: Called in this thread with how far it is, 0…1.
        cancel: Called in this thread between the steps; the work stops once it returns true.
        **settings: See `ShotSettings`; of several view layers the first is shown.

    Returns:
        `noisy` and `denoised`, float32 of (height, width, 3), or 4 with alpha, linear; with `flicker` also `previous`, the denoised
        frame before along the motion, (height, width, 3), and `flicker` and `noisy_flicker`, (height, width): the mean over the
        channels of |now − before| / (|now| + |before| + 0.01) at an exposure that brings the frame to 0.18. NaN is where nothing comes
        from the frame before; None where it, or its motion vectors, are not there. `change` is the mean of `flicker`. Also `frame`,
        `region`, `columns` and `rows` of the whole frame, `layer`, `lam`, `window`, `neighbours` (frame numbers that helped), `seconds`
        (spent denoising), and `notes`: what is odd about the frames, and what to change in Blender.

    Raises:
        TypeError: An argument of the wrong type.
        ValueError: A setting out of range, no such frame, a region that reaches beyond the frame.
        OSError: A file that cannot be read.
        HushError: A file that is no usable EXR, a window without a Vector pass, unusable weights; "stopped" after `cancel`.
    """
    options = shot_options(inputs, None, settings, ShotSettings)
    lams = _numbers("lam", () if lam is None else (lam,), SupportsFloat)
    windows = _numbers("window", () if window is None else (window,), SupportsIndex)
    options.update(frame=frame, lams=lams, windows=windows, region=region, flicker=flicker)
    return _hush.preview(options, progress, cancel)


def preview_sheet(
    inputs: Path | Iterable[Path],
    frame: int,
    output: Path,
    *,
    lam: float | Iterable[float] | None = None,
    window: int | Iterable[int] | None = None,
    region: tuple[int, int, int, int] | None = None,
    before_after: float | None = None,
    flicker: bool = False,
    exposure: float = 0.0,
    progress: Callable[[float], object] | None = None,
    cancel: Callable[[], object] | None = None,
    **settings: Unpack[ShotSettings],
) -> dict[str, Any]:
    """Writes a sheet of tiles as PNG: the frame as rendered and by each λ with each window, as `hush preview` does.

    Tone: linear light to sRGB, no view transform. The arguments are those of `preview`, and:

    Args:
        output: The PNG, whose name ends in `.png`; it appears whole or not at all.
        lam: One λ or several.
        window: One window or several.
        before_after: Show the rendered frame left of this place, 0…1 of the width, in each denoised tile.
        exposure: Show it this many stops brighter.

    Returns:
        `frame`, `region`, `columns`, `rows`, `notes`, and `tiles`, each with `layer`, `lam`, `window`, `neighbours`, `seconds`, `change`
        and `noisy_change` (None without `flicker`).

    Raises:
        The same as `preview`.
    """
    options = shot_options(inputs, None, settings, ShotSettings)
    refuse_bytes(output=output)
    lams, windows = _numbers("lam", lam, SupportsFloat), _numbers("window", window, SupportsIndex)
    options.update(frame=frame, lams=lams, windows=windows, region=region, flicker=flicker)
    options.update(sheet=os.fspath(output), before_after=before_after, exposure=exposure)
    return _hush.preview_sheet(options, progress, cancel)


def _numbers(name: str, value: Any, kind: type) -> list[Any]:  # noqa: ANN401 (a number or several, or what is neither)
    """A number or several, as a list; none for None."""
    if value is None:
        return []
    try:
        numbers = [value] if isinstance(value, str) else list(value)
    except TypeError:
        numbers = [value]
    wrong = next((each for each in numbers if not isinstance(each, kind)), None)
    if wrong is not None:
        raise TypeError(f"{name}: expected {'whole ' if kind is SupportsIndex else ''}numbers, got {wrong!r}")
    return numbers

"""One frame of a shot by several settings, for whoever chooses them. Nothing is written but the sheet."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from typing import Any, Literal

from . import _hush

Path = str | os.PathLike[str]


def preview(
    inputs: Path | Sequence[Path],
    frame: int,
    *,
    lam: float | None = None,
    window: int | None = None,
    region: tuple[int, int, int, int] | None = None,
    flicker: bool = False,
    layers: Sequence[str] = (),
    view: str | None = None,
    vector_layer: str | None = None,
    albedo: bool = True,
    normal: bool = True,
    depth: bool = True,
    vector: bool = True,
    memory: int | None = None,
    threads: int | None = None,
    model: Path | None = None,
    renderer: str | None = None,
    settings: Path | Literal[False] | None = None,
    progress: Callable[[float], object] | None = None,
    cancel: Callable[[], object] | None = None,
) -> dict[str, Any]:
    """Denoises one frame of a shot, or a part of one, in memory. Only the frames that help it are read.

    What is not given is what the `hush.toml` or `hush.json` beside the frames says, else the default. The result is that of
    `denoise_sequence`; of a region it is the same to 1e-3 of each value. The GIL is released while it works.

    Args:
        inputs: A folder, a pattern (`frame_####.exr`, `frame_%04d.exr`, a glob), a file, or several of them; one sequence in all.
        frame: Number of the frame.
        lam: λ from 1 (cleanest) to 64 (keeps grain and the detail hidden in it).
        window: Frames on each side that help, 0 to 3.
        region: (x, y, width, height) in pixels from the upper left corner; None for the whole frame. The rest is not computed.
        flicker: Also compare with the frame before, which is then denoised too.
        layers: View layer to show; of several the first.
        view: Stereo view to show.
        vector_layer: View layer to take the Vector pass from.
        albedo: Use Denoising Albedo.
        normal: Use Denoising Normal.
        depth: Use Denoising Depth or Depth.
        vector: Use motion vectors; without them neighbours cannot help.
        memory: Bytes for the frames in the window and the computing; None for 3.1 GiB.
        threads: Threads, 1 to 4096; None for all cores.
        model: Other weights, a safetensors file.
        renderer: What made the frames: "cycles" or "mitsuba".
        settings: A settings file in place of the one beside the frames; False for none.
        progress: Called in this thread with how far it is, 0…1.
        cancel: Called in this thread between the steps; the work stops once it returns true.

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
    given = dict(locals())
    given.update(lams=[] if lam is None else [lam], windows=[] if window is None else [window])
    return _hush.preview(_options(given), progress, cancel)


def preview_sheet(
    inputs: Path | Sequence[Path],
    frame: int,
    output: Path,
    *,
    lam: float | Sequence[float] | None = None,
    window: int | Sequence[int] | None = None,
    region: tuple[int, int, int, int] | None = None,
    before_after: float | None = None,
    flicker: bool = False,
    exposure: float = 0.0,
    layers: Sequence[str] = (),
    view: str | None = None,
    vector_layer: str | None = None,
    albedo: bool = True,
    normal: bool = True,
    depth: bool = True,
    vector: bool = True,
    memory: int | None = None,
    threads: int | None = None,
    model: Path | None = None,
    renderer: str | None = None,
    settings: Path | Literal[False] | None = None,
    progress: Callable[[float], object] | None = None,
    cancel: Callable[[], object] | None = None,
) -> dict[str, Any]:
    """Writes a sheet of tiles as PNG: the frame as rendered and by each λ with each window, as `hush preview` does.

    Tone: linear light to sRGB, no view transform. The arguments are those of `preview`, and:

    Args:
        output: The PNG; it appears whole or not at all.
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
    given = dict(locals())
    given.update(lams=_several(lam), windows=_several(window), output=os.fspath(output))
    return _hush.preview_sheet(_options(given), progress, cancel)


def _several(value: Any) -> list[Any]:  # noqa: ANN401 (a number or several)
    if value is None:
        return []
    return list(value) if isinstance(value, Sequence) else [value]


def _options(given: dict[str, Any]) -> dict[str, Any]:
    """The arguments in the types that the Rust half takes."""
    options = dict(given)
    if isinstance(options["inputs"], (str, os.PathLike)):
        options["inputs"] = [options["inputs"]]
    if isinstance(options["layers"], str):
        name = options["layers"]
        raise TypeError(f"layers: expected a sequence of names, got the string {name!r}: write ({name!r},)")
    options["look_beside"] = options["settings"] is not False
    options["settings"] = options["settings"] or None
    return options

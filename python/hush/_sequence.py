"""Shots on disk."""

from __future__ import annotations

import json
import operator
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

from . import _hush

Path = str | os.PathLike[str]


def denoise_sequence(
    inputs: Path | Sequence[Path],
    output: Path,
    *,
    frames: str | Iterable[int] | None = None,
    lam: float | Mapping[int, float] = 1.0,
    window: int | None = None,
    layers: Sequence[str] = (),
    view: str | None = None,
    vector_layer: str | None = None,
    aovs: Sequence[str] = (),
    albedo: bool = True,
    normal: bool = True,
    depth: bool = True,
    vector: bool = True,
    keep_noisy: bool = False,
    overwrite: bool = False,
    strict: bool = False,
    memory: int | None = None,
    threads: int | None = None,
    model: Path | None = None,
    renderer: str | None = None,
    progress: Callable[[dict[str, Any]], object] | None = None,
    cancel: Callable[[], object] | None = None,
) -> dict[str, Any]:
    """Denoises the multilayer EXR files of a shot into another folder, under the same names.

    Frames that are there already, made from the same input with the same settings, are skipped. Every file appears whole or not at all;
    a run that was stopped is continued by calling this again. The GIL is released while it works.

    Args:
        inputs: A folder, a pattern (`frame_####.exr`, `frame_%04d.exr`, a glob), a file, or several of them; one sequence in all. Of
            files that are named, the others of their sequence beside them are not written, but help.
        output: The folder to write to, created if need be; never the folder of the inputs.
        frames: Frames to write, `"1-48,60"` or numbers; None for all. The ones beside them still help.
        lam: λ from 1 (cleanest) to 64 (keeps grain and the detail hidden in it), or a mapping from frame number to λ: linear between
            its keys, constant before the first and after the last.
        window: Frames on each side that help, 0 to 3; None for 2 where there is a Vector pass, else 0.
        layers: View layers to denoise; none for the one with the most samples, `("all",)` for all.
        view: Stereo view to denoise; None for all.
        vector_layer: View layer to take the Vector pass from; None for `Hush Vectors`, which Prepare Shot makes, else the layer that
            is denoised.
        aovs: Light passes to denoise along, or `("all",)`.
        albedo: Use Denoising Albedo.
        normal: Use Denoising Normal.
        depth: Use Denoising Depth or Depth.
        vector: Use motion vectors; without them neighbours cannot help.
        keep_noisy: Keep the input beside the result as `Noisy Image`.
        overwrite: Write every frame again, also over files that Hush did not write.
        strict: Stop at the first bad or missing frame.
        memory: Bytes for the frames in the window and the computing; None for 3.1 GiB. Less is slower and gives the same bits.
        threads: Threads, 1 to 4096; None for all cores. Any number gives the same bits.
        model: Other weights, a safetensors file.
        renderer: What made the frames, one that the weights have an encoder for: "cycles" or "mitsuba"; None for the first, Cycles.
        progress: Called in this thread with each event as a dict, see "JSON events" in the README. The run waits for it.
        cancel: Called in this thread at least every tenth of a second; the run stops after the frame in hand once it returns true.

    Returns:
        The fields of the `done` event: `frames`, `written`, `skipped`, `failed`, `degraded`, `missing`, `interrupted`, `stopped`,
        `seconds`. A bad frame does not raise, it is listed in `failed`; what ended the run early, such as a full disk, is in `stopped`.

    Raises:
        TypeError: An argument of the wrong type.
        ValueError: A setting out of range, inputs that are no single sequence, none of the frames there, an output folder that holds
            the inputs.
        OSError: A file or folder that is not there or cannot be read or written; FileExistsError where the output folder holds files
            of these names that Hush did not write.
        HushError: Files that are no usable EXR, a window without a Vector pass, unusable weights.
        KeyboardInterrupt: Ctrl-C, after the frame in hand. What `progress` or `cancel` raise comes through in the same way.
    """
    told = None if progress is None else lambda event: progress(_read(event))
    return _read(_hush.denoise_sequence(_options(locals()), told, cancel))


def plan_sequence(
    inputs: Path | Sequence[Path],
    output: Path,
    *,
    frames: str | Iterable[int] | None = None,
    lam: float | Mapping[int, float] = 1.0,
    window: int | None = None,
    layers: Sequence[str] = (),
    view: str | None = None,
    vector_layer: str | None = None,
    aovs: Sequence[str] = (),
    albedo: bool = True,
    normal: bool = True,
    depth: bool = True,
    vector: bool = True,
    keep_noisy: bool = False,
    overwrite: bool = False,
    strict: bool = False,
    memory: int | None = None,
    threads: int | None = None,
    model: Path | None = None,
    renderer: str | None = None,
) -> dict[str, Any]:
    """Tells what `denoise_sequence` would do with the same arguments, from the files' headers alone. Writes nothing.

    Returns:
        `settings`; `frames`, each with `frame`, `source`, `output`, `action` (`denoise`, `skip`, `fail`), `reason` and `neighbours`
        (frame numbers that will help); `warnings`; `missing` (first and last of each gap).

    Raises:
        The same as `denoise_sequence`.
    """
    return _read(_hush.plan_sequence(_options(locals())))


def inspect(path: Path) -> dict[str, Any]:
    """Tells what an EXR file holds, what Hush will use of it and what is missing, as `hush inspect --json` does.

    Returns:
        `layout` (size, parts, passes), `uses`, `missing` (with advice), `light_passes`, `notes`, `problem` (None where it can be denoised).

    Raises:
        OSError: The file is not there or cannot be read.
        HushError: It is no usable EXR file.
    """
    return _read(_hush.inspect(path))


def _read(text: str) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(text)
    return found


def _options(given: dict[str, Any]) -> dict[str, Any]:
    """The arguments in the types that the Rust half takes."""
    options = dict(given)
    if isinstance(options["inputs"], (str, os.PathLike)):
        options["inputs"] = [options["inputs"]]
    frames, lam = options["frames"], options["lam"]
    if frames is not None and not isinstance(frames, str):
        options["frames"] = ",".join(str(operator.index(frame)) for frame in frames)
    if isinstance(lam, Mapping):
        options["lam"] = list(lam.items())
    else:
        options["lam"] = [(0, lam)]
    for name in ("aovs", "layers"):
        if isinstance(options[name], str):
            raise TypeError(f"{name}: expected a sequence of names, got the string {options[name]!r}: write ({options[name]!r},)")
    return options

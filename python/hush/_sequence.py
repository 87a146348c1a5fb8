"""Shots on disk."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterable
from typing import Any, Unpack, get_type_hints

from . import _hush
from ._settings import Path, SequenceSettings, ShotSettings


def denoise_sequence(
    inputs: Path | Iterable[Path] | None = None,
    output: Path | None = None,
    *,
    progress: Callable[[dict[str, Any]], object] | None = None,
    cancel: Callable[[], object] | None = None,
    **settings: Unpack[SequenceSettings],
) -> dict[str, Any]:
    """Denoises the multilayer EXR files of a shot into another folder, under the same names, as `hush denoise` does.

    Frames that are there already, made from the same input with the same settings, are skipped. Every file appears whole or not at all;
    a run that was stopped is continued by calling this again. The GIL is released while it works.

    Args:
        inputs: A folder, a pattern (`frame_####.exr`, `frame_%04d.exr`, a glob), a file, or several of them; one sequence in all. Of
            files that are named, the others of their sequence beside them are not written, but help. None for what `settings` or
            `usd` name.
        output: The folder to write to, created if need be; never the folder of the inputs. None for what the shot's settings say.
        progress: Called in this thread with each event as a dict, see "JSON events" in docs/command-line.md. The run waits for it.
        cancel: Called in this thread at least every tenth of a second; the run stops after the frame in hand once it returns true.
        **settings: See `SequenceSettings`. Values that come from files are told by a warning of kind `setting` that names the file.

    Returns:
        The fields of the `done` event: `frames`, `written`, `skipped`, `failed`, `degraded`, `missing`, `interrupted`, `stopped`,
        `seconds`. A bad frame does not raise, it is listed in `failed`; what ended the run early, such as a full disk, is in `stopped`.

    Raises:
        TypeError: An argument of the wrong type, or of a name that is none.
        ValueError: A setting out of range, inputs that are no single sequence, none of the frames there, an output folder that holds
            the inputs, or better frames than this run would make.
        OSError: A file or folder that is not there or cannot be read or written; FileExistsError where the output folder holds files
            of these names that Hush did not write.
        HushError: Files that are no usable EXR, a window without a Vector pass, unusable weights, a shot that is switched off.
        KeyboardInterrupt: Ctrl-C, after the frame in hand. What `progress` or `cancel` raise comes through in the same way.
    """
    told = None if progress is None else lambda event: progress(_read(event))
    return _read(_hush.denoise_sequence(_options(inputs, output, settings), told, cancel))


def dry_run_sequence(
    inputs: Path | Iterable[Path] | None = None, output: Path | None = None, **settings: Unpack[SequenceSettings]
) -> dict[str, Any]:
    """Tells what `denoise_sequence` would do with the same arguments, from the files' headers alone, as `hush denoise --dry-run` does.
    Writes nothing.

    Returns:
        `settings`: λ, the window, the weights, the rules, and whatever else is not as by default; `frames`, each with `frame`, `source`,
        `output`, `action` (`denoise`, `skip`, `fail`), `reason` and `neighbours` (frame numbers that will help); `warnings`; `missing`
        (first and last of each gap).

    Raises:
        The same as `denoise_sequence`.
    """
    return _read(_hush.dry_run_sequence(_options(inputs, output, settings)))


def survey_sequence(
    inputs: Path | Iterable[Path] | None = None, *, timing: bool = True, **settings: Unpack[SequenceSettings]
) -> dict[str, Any]:
    """Tells what is left out of a shot, why, and the time that it saves, as `hush survey --json` does. Looks at the pixels of every
    frame; with `timing` it denoises one, in turn with and without. Writes nothing.

    Returns:
        `sequence`, `window`, `frames` (each with `left_out`), `rules` (each with `rule`, `on`, `bound`, `why`, `frames`, `mean`, `most`),
        `unread` and `unread_share` (passes that are not used), `time`, `failed` (frames that cannot be read).

    Raises:
        The same as `denoise_sequence`.
    """
    return _read(_hush.survey_sequence(_options(inputs, None, settings), timing))


def check_sequence(
    inputs: Path | Iterable[Path] | None = None, output: Path | None = None, **settings: Unpack[SequenceSettings]
) -> dict[str, Any]:
    """Tells which denoised frames are current: what `denoise_sequence` with the same arguments would give. Writes nothing.

    Returns:
        `frames`: each frame of `frames`, or else each that is rendered or denoised, as a dict: `frame`; `state`, one of `current`, `stale`
        (a denoised file is there, but is not what denoising now would give), `missing` (rendered, not denoised), `unrendered`; `kind`
        and `reason` of a stale or failed one; `source` and `output`, the files that are there; `columns` and `rows` of the output.
        `counts`: how many frames are in each state.

    Raises:
        The same as `denoise_sequence`, but not for frames that are missing or bad.
    """
    return SequenceCheck().check(inputs, output, **settings)


class SequenceCheck:
    """`check_sequence` with a memory: asked again, a file that did not change costs a `stat`. Safe to share between threads."""

    def __init__(self) -> None:
        self._check = _hush.SequenceCheck()

    def check(
        self, inputs: Path | Iterable[Path] | None = None, output: Path | None = None, **settings: Unpack[SequenceSettings]
    ) -> dict[str, Any]:
        """As `check_sequence`."""
        return _read(self._check.check(_options(inputs, output, settings)))


def inspect(path: Path) -> dict[str, Any]:
    """Tells what an EXR file holds, what Hush will use of it and what is missing, as `hush inspect --json` does.

    Returns:
        The file's layout (`columns`, `rows`, `layers` with their passes, `compression` and more), and `uses`, `missing` (with advice),
        `light_passes`, `notes`, `problem` (None where it can be denoised).

    Raises:
        OSError: The file is not there or cannot be read.
        HushError: It is no usable EXR file.
    """
    return _read(_hush.inspect(path))


def _read(text: str) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(text)
    return found


def _options(inputs: Path | Iterable[Path] | None, output: Path | None, settings: SequenceSettings) -> dict[str, Any]:
    return shot_options(inputs, output, settings, SequenceSettings)


def shot_options(
    inputs: Path | Iterable[Path] | None, output: Path | None, settings: ShotSettings, known: type[ShotSettings]
) -> dict[str, Any]:
    """The arguments of a function as the Rust half takes them; `known` tells which settings there are."""
    unknown = settings.keys() - get_type_hints(known).keys()
    if unknown:
        raise TypeError(f"{sorted(unknown)[0]}: there is no such setting; there are {', '.join(get_type_hints(known))}")
    options: dict[str, Any] = dict(settings)
    refuse_bytes(inputs=inputs, output=output, **options)
    try:
        options["inputs"] = [] if inputs is None else [inputs] if isinstance(inputs, (str, os.PathLike)) else list(inputs)
    except TypeError as error:
        raise TypeError(f"inputs: {error}") from None
    if output is not None:
        options["output"] = output
    if isinstance(options.get("usd"), os.PathLike):
        options["usd"] = os.fspath(options["usd"])
    return options


def refuse_bytes(**arguments: object) -> None:
    """Refuses paths as bytes in words; they would be taken for lists of numbers."""
    for name, value in arguments.items():
        if isinstance(value, bytes):
            raise TypeError(f"{name}: expected str or os.PathLike, got bytes; os.fsdecode makes a str of a path")

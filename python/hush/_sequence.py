"""Shots on disk."""

from __future__ import annotations

import json
import operator
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, Literal, TypedDict, Unpack, get_type_hints

from . import _hush

Path = str | os.PathLike[str]


class ShotSettings(TypedDict, total=False):
    """What to read of a shot and how to compute: the keyword arguments of every function that takes a shot.

    What is not given, or None, is what the shot's own settings say: `hush.toml` or `hush.json` beside the frames, and the USD stage
    that it names; else the default. What is given here wins.
    """

    settings: Path | Literal[False] | None
    """Another settings file than the one beside the frames; False for none."""
    usd: Path | None
    """A USD stage to take settings from, `shot.usda` or `shot.usda@/Render/Pass`, in place of the one that the settings file names."""
    enable: bool | None
    """True denoises also where the shot's settings switch it off."""
    layers: Sequence[str] | None
    """View layers to denoise; default the one with the most samples, `("all",)` for all."""
    view: str | None
    """Stereo view to denoise; default all."""
    vector_layer: str | None
    """View layer to take the Vector pass from; default `Hush Vectors`, which Prepare Shot makes, else the layer that is denoised."""
    aovs: Sequence[str] | None
    """Light passes to denoise along, or `("all",)`; default none."""
    guides: Sequence[str] | None
    """Guides that may be used, of `albedo`, `normal`, `depth`, `vector`; default all. Without `vector` neighbours cannot help."""
    passes: Mapping[str, str] | None
    """What the passes are called where not as Blender calls them, by `beauty`, `albedo`, `normal`, `depth`, `vector`."""
    skip: Sequence[str] | None
    """The rules by which work may be left out, such as `("constant", "still")`; `()` computes everything. Default: every rule with a
    known bound."""
    model: Path | None
    """Other weights, a safetensors file."""
    renderer: str | None
    """What made the frames, one that the weights have an encoder for: `cycles` (default) or `mitsuba`."""
    memory: int | None
    """Bytes for the frames in the window and the computing; default 3.1 GiB. Less is slower and gives the same bits."""
    threads: int | None
    """Threads, 1 to 4096; default all cores. Any number gives the same bits."""


class SequenceSettings(ShotSettings, total=False):
    """How a shot is denoised: `ShotSettings`, and which frames are made how."""

    frames: str | Iterable[int] | None
    """Frames to write, `"1-48,60"` or numbers; default all. The ones beside them still help."""
    lam: float | Mapping[int, float] | None
    """λ from 1 (cleanest, the default) to 64 (keeps grain and the detail hidden in it), or a mapping from frame number to λ: linear
    between its keys, constant before the first and after the last."""
    window: int | None
    """Frames on each side that help, 0 to 3; default 2 where there is a Vector pass, else 0."""
    keep_noisy: bool | None
    """Keep the input beside the result as `Noisy Image`; default False."""
    overwrite: bool
    """Write every frame again, also over files that Hush did not write; default False."""
    strict: bool
    """Stop at the first bad or missing frame; default False."""


def denoise_sequence(
    inputs: Path | Sequence[Path] | None = None,
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


def plan_sequence(
    inputs: Path | Sequence[Path] | None = None, output: Path | None = None, **settings: Unpack[SequenceSettings]
) -> dict[str, Any]:
    """Tells what `denoise_sequence` would do with the same arguments, from the files' headers alone. Writes nothing.

    Returns:
        `settings`; `frames`, each with `frame`, `source`, `output`, `action` (`denoise`, `skip`, `fail`), `reason` and `neighbours`
        (frame numbers that will help); `warnings`; `missing` (first and last of each gap).

    Raises:
        The same as `denoise_sequence`.
    """
    return _read(_hush.plan_sequence(_options(inputs, output, settings)))


def check_sequence(
    inputs: Path | Sequence[Path] | None = None, output: Path | None = None, **settings: Unpack[SequenceSettings]
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
        self, inputs: Path | Sequence[Path] | None = None, output: Path | None = None, **settings: Unpack[SequenceSettings]
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


def _options(inputs: Path | Sequence[Path] | None, output: Path | None, settings: SequenceSettings) -> dict[str, Any]:
    """The arguments in the types that the Rust half takes."""
    options = shot_options(inputs, output, settings, SequenceSettings)
    frames = options.get("frames")
    if frames is not None and not isinstance(frames, str):
        options["frames"] = ",".join(str(operator.index(frame)) for frame in frames)
    if "lam" in options:
        lam = options["lam"]
        options["lam"] = list(lam.items()) if isinstance(lam, Mapping) else [(0, lam)]
    return options


def shot_options(
    inputs: Path | Sequence[Path] | None, output: Path | None, settings: ShotSettings, known: type[ShotSettings]
) -> dict[str, Any]:
    """The same for settings of any function; `known` tells which there are."""
    unknown = settings.keys() - get_type_hints(known).keys()
    if unknown:
        raise TypeError(f"{sorted(unknown)[0]}: there is no such setting; there are {', '.join(get_type_hints(known))}")
    options: dict[str, Any] = {name: value for name, value in settings.items() if value is not None}
    try:
        options["inputs"] = [] if inputs is None else [inputs] if isinstance(inputs, (str, os.PathLike)) else list(inputs)
    except TypeError as error:
        raise TypeError(f"inputs: {error}") from None
    options["output"] = output
    if options.get("settings") is False:
        options["settings"], options["no_settings"] = None, True
    if "usd" in options:
        options["usd"] = os.fspath(options["usd"])
    for name in ("aovs", "layers", "guides", "skip"):
        if isinstance(options.get(name), str):
            raise TypeError(f"{name}: expected a sequence of names, got the string {options[name]!r}: write ({options[name]!r},)")
        if name in options:
            options[name] = list(options[name])
    if "passes" in options:
        options["passes"] = dict(options["passes"])
    return options

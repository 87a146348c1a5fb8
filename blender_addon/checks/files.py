# SPDX-FileCopyrightText: 2026 Hush authors
# SPDX-License-Identifier: GPL-3.0-or-later
"""What Check Shot finds on the disk: folders, rendered frames, and denoised ones that are out of date."""

import errno
import os
import shutil
import tempfile
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

import bpy

from .. import messages, paths, shot, status
from .problem import ERROR, INFO, Problem, problem

# Where Blender writes the rendered frames.
RENDERED = "in Output › Output Path"


def file_problems(scene: bpy.types.Scene, patterns: list[Path], output: Path, frames: range, *, write: bool) -> Iterator[Problem]:
    """All that is not right with a shot's files. With `write` it is tried whether folders can be written to, else only asked."""
    try:
        import hush
    except ImportError as error:
        yield problem("library", "library", ERROR, reason=messages.of_error(error))
        hush = None
    if any(pattern.parent == output for pattern in patterns):
        yield problem("folder", "folder_same", ERROR, folder=output)
    wrong = why_not_writable(output, write=write)
    if wrong:
        yield Problem("folder", wrong, level=ERROR)
    present, missing = _rendered(patterns, frames)
    # Frames that are all there need only be read.
    if missing and patterns[0].parent != output and not scene.hush.input_folder:
        wrong = why_not_writable(patterns[0].parent, where=RENDERED, write=write)
        if wrong:
            yield Problem("render_folder", wrong, level=ERROR)
    if not frames:
        yield problem("frames", "range_empty", ERROR)
    elif not present:
        yield problem("frames", "unrendered_all", INFO, path=patterns[0], how=shot.how_to_render(scene))
    elif missing:
        yield problem("frames", "unrendered", frames=missing, how=shot.how_to_render(scene))
    if present:
        yield from _space(present, output, len(frames) * len(patterns))
        if hush is not None:
            yield from _first_frame(scene, present[0])
    if hush is not None:
        yield from _denoised(scene)


def why_not_writable(folder: Path, *, where: str = "under Folders", write: bool = True) -> str | None:
    """Why files cannot be written into a folder, which may not be there yet, and `where` another is chosen; None where they can.

    Only a file that is written tells for sure, but one must not come and go in the artist's folder as long as a panel is open.
    """
    place = _nearest(folder)
    if not os.path.isdir(place):
        return messages.text("folder_file", place=place, folder=folder, where=where)
    reason = ""
    if write:
        try:
            with tempfile.TemporaryFile(dir=place):
                pass
        except OSError as error:
            reason = error.strerror or messages.of_error(error)
    elif not os.access(place, os.W_OK):
        reason = os.strerror(errno.EACCES)
    return messages.text("folder_closed", folder=folder, reason=reason, where=where) if reason else None


def _rendered(patterns: list[Path], frames: range) -> tuple[list[Path], list[int]]:
    """The files that are there, and the frames of which one is missing or empty."""
    names: dict[Path, set[str]] = {}
    for folder in {pattern.parent for pattern in patterns}:
        try:
            with os.scandir(folder) as entries:
                whole = [entry.name for entry in entries if entry.name.lower().endswith(".exr") and entry.stat().st_size]
                names[folder] = set(map(paths.folded, whole))
        except OSError:
            names[folder] = set()
    present, missing = [], []
    for frame in frames:
        files = [shot.frame_file(pattern, frame) for pattern in patterns]
        there = [file for file in files if paths.folded(file.name) in names[file.parent]]
        present += there
        if len(there) < len(files):
            missing.append(frame)
    return present, missing


def _denoised(scene: bpy.types.Scene) -> Iterator[Problem]:
    """Frames out of date and frames that failed, by reason."""
    found: dict[tuple[str, str], list[int]] = defaultdict(list)
    for number, frame in status.frames(scene).items():
        if frame.state == "stale" or frame.state == "missing" and frame.kind:
            found["stale" if frame.state == "stale" else "failed", frame.reason].append(number)
    for (key, reason), numbers in found.items():
        yield problem(key, key, frames=numbers, reason=reason)


def _space(present: list[Path], output: Path, total: int) -> Iterator[Problem]:
    place = _nearest(output)
    try:
        size = present[len(present) // 2].stat().st_size
        free = shutil.disk_usage(place).free
    except OSError:
        # The file or the folder went since it was looked up: there is nothing to reckon with.
        return
    needed = size * (total - sum(os.path.exists(output / file.name) for file in present))
    if needed * 1.05 > free:
        yield problem("space", "space", needed=_bytes(needed), free=_bytes(free), place=place)


def _first_frame(scene: bpy.types.Scene, file: Path) -> Iterator[Problem]:
    import hush

    try:
        about = hush.inspect(str(file))
    except (OSError, hush.HushError) as error:
        yield problem("first_frame", "first_frame", ERROR, file=file.name, reason=messages.of_error(error))
        return
    layout = about.get("layout", about)
    if about.get("problem"):
        yield problem("first_frame", "first_frame", ERROR, file=file.name, reason=messages.of_error(about["problem"]))
    size = layout.get("columns"), layout.get("rows")
    wanted = shot.render_size(scene)
    if wanted and None not in size and size != wanted:
        sizes = dict(zip(("columns", "rows", "wanted_columns", "wanted_rows"), (*size, *wanted), strict=True))
        yield problem("older", "older_size", file=file.name, **sizes)
    passes = {layer["name"]: {each["name"] for each in layer["passes"]} for layer in layout.get("layers", [])}
    yield from _older_layout(scene, file, passes)
    if layout.get("lossy"):
        yield problem("lossy", "lossy_file", file=file.name, compression=layout.get("compression"))


def _older_layout(scene: bpy.types.Scene, file: Path, passes: dict[str, set[str]]) -> Iterator[Problem]:
    if scene.render.engine != "CYCLES" or set(passes) <= {""}:
        return
    gone = [name for name in (*shot.layers(scene), shot.vector_layer(scene) or "") if name and name not in passes]
    there = sorted(filter(None, passes))
    if gone:
        yield problem("older", "older_layer", file=file.name, layers=messages.listed(gone), there=messages.listed(there))
    for name in shot.layers(scene):
        layer = scene.view_layers[name]
        wanted = {"Denoising Albedo": layer.cycles.denoising_store_passes, "Vector": layer.use_pass_vector, "Depth": layer.use_pass_z}
        lacking = [each for each, on in wanted.items() if on and name in passes and each not in passes[name]]
        if lacking:
            yield problem("older", "older_pass", file=file.name, passes=messages.listed(lacking), layer=name)


def _nearest(path: Path) -> Path:
    """The path, or the innermost folder around it that is there."""
    while not os.path.exists(path) and path != path.parent:
        path = path.parent
    return path


def _bytes(count: float) -> str:
    units = ["TB", "GB", "MB", "kB", "bytes"]
    while count >= 1000 and len(units) > 1:
        units.pop()
        count /= 1000
    return f"{count:.3g} {units[-1]}"

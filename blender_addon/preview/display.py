# SPDX-FileCopyrightText: 2026 Hush authors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The image `Hush Preview`: made from the worker's arrays, shown in an Image Editor, and taken away again without a trace.

It is an image of a temporary file. Its pixels are never set from here: Blender would take it for unsaved work.
"""

import shutil
import struct
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from .. import compat
from .job import FOLDER

NAME = "Hush Preview"
# The change that is shown white.
MOST_CHANGE = 0.25
# Where nothing comes from the frame before, in the view of what changes: dark blue.
_NOWHERE = (0.0, 0.02, 0.15)


@dataclass
class Shown:
    """What is shown: the worker's folder, its result, their colour space, the image's identity, and what its editors showed before."""

    scene_name: str
    folder: Path
    result: dict[str, Any]
    space: str
    image_uid: int = 0
    before: list[tuple[bpy.types.SpaceImageEditor, str]] = field(default_factory=list)

    def array(self, name: str) -> np.ndarray | None:
        """One of the worker's images, rows from the top; None where it made none."""
        path = self.folder / f"{name}.npy"
        return np.load(path) if path.exists() else None


_shown: Shown | None = None


def current() -> Shown | None:
    """What is shown, None where nothing is."""
    return _shown


def image() -> bpy.types.Image | None:
    """The image, if it is there."""
    if _shown is None:
        return None
    return next((each for each in bpy.data.images if each.session_uid == _shown.image_uid), None)


def show(shown: Shown, view: str, wipe: float, editor: bpy.types.SpaceImageEditor | None) -> None:
    """Shows what a worker made in place of what was shown; in `editor`, else in the editors that show it already."""
    global _shown
    before, spaces = None, [editor] if editor is not None else []
    if _shown is not None:
        before = _shown.before
        spaces += [space for space in editors() if image() is not None and space.image == image()]
        end()
        # What these editors showed before the first preview.
        shown.before = [(space, name) for space, name in before if space in spaces]
    _shown = shown
    _add(view, wipe, spaces)


def _add(view: str, wipe: float, spaces: list[bpy.types.SpaceImageEditor]) -> None:
    _write(_shown, view, wipe)
    made = bpy.data.images.load(str(_file(_shown)), check_existing=False)
    _shown.image_uid = made.session_uid
    made.name = NAME
    compat.use_space(made, _shown.space)
    _set_transform(made, view)
    for space in spaces:
        if not any(space == known for known, _ in _shown.before):
            _shown.before.append((space, space.image.name_full if space.image else ""))
        space.image = made


def update(view: str, wipe: float) -> None:
    """Shows it in another way."""
    made = image()
    if _shown is not None and made is not None:
        _write(_shown, view, wipe)
        _set_transform(made, view)
        made.reload()


def _set_transform(made: bpy.types.Image, view: str) -> None:
    """Light looks as the render does, through the scene's view transform; the map of what flickers as it is."""
    made.use_view_as_render = view != "FLICKER"


def take_out() -> list[bpy.types.SpaceImageEditor]:
    """Removes the image and has its editors show what they showed before; returns these. `put_back` undoes it.

    Where the image went by itself, as by undo, its editors are those that were left empty.
    """
    made = image()
    before = [space for space, _ in _shown.before] if _shown is not None else []
    spaces = [space for space in editors() if space.image == made and (made is not None or space in before)]
    for space in spaces:
        name = next((name for known, name in _shown.before if known == space), "")
        space.image = next((each for each in bpy.data.images if each.name_full == name and each != made), None)
    if made is not None:
        bpy.data.images.remove(made)
    return spaces


def put_back(view: str, wipe: float, spaces: list[bpy.types.SpaceImageEditor]) -> None:
    """Shows it again after `take_out`."""
    if _shown is not None and image() is None:
        _add(view, wipe, spaces)


def end() -> bool:
    """Takes it away with its files; whether there was one."""
    global _shown
    if _shown is None:
        return False
    take_out()
    shutil.rmtree(_shown.folder, ignore_errors=True)
    _shown = None
    return True


def remove_strays() -> None:
    """Removes images of earlier previews that undo, or a file saved by itself, has brought back."""
    for each in list(bpy.data.images):
        ours = each.session_uid == _shown.image_uid if _shown is not None else False
        if not ours and Path(each.filepath).parent.name.startswith(FOLDER):
            bpy.data.images.remove(each)


def forget() -> None:
    """Another file takes the place of this one: only the temporary files are left to remove."""
    global _shown
    if _shown is not None:
        shutil.rmtree(_shown.folder, ignore_errors=True)
        _shown = None


def compose(shown: Shown, view: str, wipe: float) -> np.ndarray:
    """What a view shows, (height, width, 4), linear, rows from the top."""
    if view == "FLICKER":
        maps = [shown.array(name) for name in ("noisy_flicker", "flicker")]
        if all(each is not None for each in maps):
            left, right = (_grey(each) for each in maps)
            return _wiped(left, right, wipe)
    noisy, denoised = (_rgba(shown.array(name)) for name in ("noisy", "denoised"))
    return {"NOISY": noisy, "DENOISED": denoised}.get(view, _wiped(noisy, denoised, wipe))


def _wiped(left: np.ndarray, right: np.ndarray, wipe: float) -> np.ndarray:
    at = round(min(max(wipe, 0.0), 1.0) * left.shape[1])
    return np.concatenate([left[:, :at], right[:, at:]], axis=1)


def _rgba(pixels: np.ndarray) -> np.ndarray:
    alpha = pixels[..., 3:] if pixels.shape[2] == 4 else np.ones((*pixels.shape[:2], 1), np.float32)
    return np.concatenate([pixels[..., :3], alpha], axis=2)


def _grey(change: np.ndarray) -> np.ndarray:
    """Change as grey, white from MOST_CHANGE on; even steps look even."""
    found = np.isfinite(change)
    level = np.clip(np.where(found, change, 0.0) / MOST_CHANGE, 0.0, 1.0) ** 2.2
    colour = np.where(found[..., None], level[..., None], np.asarray(_NOWHERE))
    return _rgba(colour.astype(np.float32))


def _file(shown: Shown) -> Path:
    return shown.folder / f"{NAME}.exr"


def _write(shown: Shown, view: str, wipe: float) -> None:
    _write_exr(_file(shown), compose(shown, view, wipe))


def _write_exr(path: Path, pixels: np.ndarray) -> None:
    """Writes float32 RGBA, (height, width, 4), as an EXR file of plain scan lines, aside and then renamed."""
    height, width, _ = pixels.shape

    def attribute(name: str, kind: str, value: bytes) -> bytes:
        return name.encode() + b"\0" + kind.encode() + b"\0" + struct.pack("<i", len(value)) + value

    # The channels of a line lie in the order of their names; 2 is float32.
    channels = b"".join(name + b"\0" + struct.pack("<iBxxxii", 2, 0, 1, 1) for name in (b"A", b"B", b"G", b"R")) + b"\0"
    window = struct.pack("<4i", 0, 0, width - 1, height - 1)
    head = struct.pack("<ii", 20000630, 2) + b"".join(
        (
            attribute("channels", "chlist", channels),
            attribute("compression", "compression", b"\0"),
            attribute("dataWindow", "box2i", window),
            attribute("displayWindow", "box2i", window),
            attribute("lineOrder", "lineOrder", b"\0"),
            attribute("pixelAspectRatio", "float", struct.pack("<f", 1.0)),
            attribute("screenWindowCenter", "v2f", struct.pack("<2f", 0.0, 0.0)),
            attribute("screenWindowWidth", "float", struct.pack("<f", 1.0)),
            b"\0",
        )
    )
    lines = np.empty(height, np.dtype([("y", "<i4"), ("size", "<i4"), ("values", "<f4", (4, width))]))
    lines["y"], lines["size"] = np.arange(height), 16 * width
    lines["values"] = pixels[..., ::-1].transpose(0, 2, 1)
    offsets = len(head) + 8 * height + np.arange(height, dtype="<u8") * lines.dtype.itemsize
    aside = path.with_suffix(".part")
    with aside.open("wb") as file:
        file.write(head)
        file.write(offsets.astype("<u8").tobytes())
        file.write(lines.tobytes())
    aside.replace(path)


def editors() -> list[bpy.types.SpaceImageEditor]:
    """Every Image Editor of the file, those that other editors hide too."""
    areas = [area for screen in bpy.data.screens for area in screen.areas]
    return [space for area in areas for space in area.spaces if space.type == "IMAGE_EDITOR"]


def editor(context: bpy.types.Context) -> bpy.types.SpaceImageEditor | None:
    """The Image Editor that the artist is in, else one that is open."""
    if context.area is not None and context.area.type == "IMAGE_EDITOR":
        return context.area.spaces.active
    for window in context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "IMAGE_EDITOR":
                return area.spaces.active
    return None

# SPDX-FileCopyrightText: 2026 Hush authors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Whether an EXR file is whole, from its header and table of chunks; no pixel is read."""

import os
import struct
from pathlib import Path
from typing import BinaryIO

_MAGIC = 0x01312F76
_LONGEST = 1 << 20
# Lines in a chunk by the number of the compression; files of several parts say their count of chunks themselves.
_LINES = {0: 1, 1: 1, 2: 1, 3: 16, 4: 32, 5: 16, 6: 32, 7: 32, 8: 32, 9: 256}
_known: dict[str, tuple[int, int, tuple[int, int] | None]] = {}


def size_if_whole(path: Path) -> tuple[int, int] | None:
    """Width and height of a file that is there and complete, else None. Remembered until the file changes."""
    try:
        stat = os.stat(path)
    except (OSError, ValueError):
        return None
    known = _known.get(str(path))
    if known is None or known[:2] != (stat.st_mtime_ns, stat.st_size):
        known = _known[str(path)] = (stat.st_mtime_ns, stat.st_size, _read(path, stat.st_size))
    return known[2]


def attribute(path: Path, name: str) -> str | None:
    """A text of the first header, such as `Scene`, which Blender writes; None where it is not there."""
    try:
        with open(path, "rb") as file:
            magic, _ = struct.unpack("<II", file.read(8))
            value = _header(file).get(name) if magic == _MAGIC else None
    except (OSError, ValueError, struct.error):
        return None
    return None if value is None else value.decode("utf-8", "replace")


def forget() -> None:
    """Drops what is remembered."""
    _known.clear()


def _read(path: Path, length: int) -> tuple[int, int] | None:
    try:
        with open(path, "rb") as file:
            return _check(file, length)
    except (OSError, ValueError, struct.error, KeyError):
        return None


def _check(file: BinaryIO, length: int) -> tuple[int, int] | None:
    magic, version = struct.unpack("<II", file.read(8))
    if magic != _MAGIC:
        return None
    multipart = bool(version & 0x1000)
    headers = [_header(file)]
    while multipart and (header := _header(file)):
        headers.append(header)
    chunks = sum(_chunk_count(header, tiled=bool(version & 0x200)) for header in headers)
    if chunks * 8 > length:
        return None
    offsets = struct.unpack(f"<{chunks}Q", file.read(8 * chunks))
    # A writer fills the table at the end: a zero in it is a file still being written.
    if min(offsets) == 0:
        return None
    last = max(offsets)
    before = 4 if multipart else 0
    # The coordinates before the size of the data: a line number, or four numbers of a tile.
    before += 16 if "tiles" in headers[0] else 4
    file.seek(last + before)
    (data,) = struct.unpack("<I", file.read(4))
    if last + before + 4 + data > length:
        return None
    left, bottom, right, top = struct.unpack("<4i", headers[0]["displayWindow"])
    return right - left + 1, top - bottom + 1


def _header(file: BinaryIO) -> dict[str, bytes]:
    """The attributes of one part; none where the list of parts ends."""
    attributes = {}
    while name := _text(file):
        _text(file)
        (size,) = struct.unpack("<I", file.read(4))
        if size > _LONGEST:
            raise ValueError("attribute too long")
        attributes[name] = file.read(size)
    return attributes


def _text(file: BinaryIO) -> str:
    found = bytearray()
    while (byte := file.read(1)) != b"\0":
        if not byte or len(found) > 255:
            raise ValueError("no end of a name")
        found += byte
    return found.decode("utf-8", "replace")


def _chunk_count(header: dict[str, bytes], *, tiled: bool) -> int:
    if "chunkCount" in header:
        return struct.unpack("<i", header["chunkCount"])[0]
    if tiled:
        raise ValueError("tiles without a count")
    _, first, _, last = struct.unpack("<4i", header["dataWindow"])
    lines = _LINES[header["compression"][0]]
    return (last - first + lines) // lines

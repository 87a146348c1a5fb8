# SPDX-FileCopyrightText: 2026 Hush authors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Puts the texts of `texts.py` into words for an artist: fields filled in, numbers counted, errors without words of the command line.

A field with words behind its colon counts: `{count:frame is}` gives `1 frame is` or `2 frames are`, and of a list of frames
`{frames:frame is}` gives `frame 3 is` or `frames 3-5, 9 are`.
"""

import re
import string
from collections.abc import Iterable

from .texts import FOR_ARTISTS, STALE, TEXTS

_PLURALS = {"is": "are", "was": "were", "has": "have"}


class Refusal(Exception):
    """Why something cannot be done, in words for artists."""


def text(key: str, **fields: object) -> str:
    """The message with its fields filled in.

    Raises:
        KeyError: There is no such message, or a field of it is not given.
    """
    template = TEXTS[key]
    made = _WORDS.vformat(template, (), fields)
    return sentence(made) if template.startswith("{frames:") else made


def listed(names: Iterable[str]) -> str:
    """Several names in a sentence: `a, b and c`."""
    *first, last = list(names) or [""]
    return f"{', '.join(first)} and {last}" if first else last


def stale(kind: str | None, reason: str | None = None) -> str:
    """Why a frame is out of date, from what `hush.check_sequence` says of it."""
    known = STALE.get(kind or "")
    if known is None or kind in ("failed", "several"):
        return of_error(reason) if reason else known or "it changed"
    return known


def of_error(error: object) -> str:
    """An error of the library or the system in words for artists: no options of the command line, no numbers of errors."""
    if isinstance(error, OSError) and error.strerror:
        place = f"{error.filename}: " if error.filename else ""
        made = f"{place}{error.strerror}"
    else:
        made = str(error) or type(error).__name__
    for pattern, words in FOR_ARTISTS:
        made = re.sub(pattern, words, made)
    return made.strip()


def sentence(words: str) -> str:
    """With a capital, except for λ and names of files."""
    return words if words.startswith("λ") or re.match(r"\S+\.exr\b", words, re.IGNORECASE) else words[:1].upper() + words[1:]


def ranges(frames: Iterable[int]) -> str:
    """Frames as 3-5, 9."""
    runs: list[list[int]] = []
    for frame in sorted(frames):
        if runs and frame == runs[-1][1] + 1:
            runs[-1][1] = frame
        else:
            runs.append([frame, frame])
    return ", ".join(f"{first}-{last}" if first != last else str(first) for first, last in runs)


def _in_plural(word: str) -> str:
    return _PLURALS.get(word, f"{word}s")


class _Words(string.Formatter):
    """Counts where a field has words behind its colon; all else as ever."""

    def format_field(self, value: object, spec: str) -> str:
        words = spec.split()
        if not words or not all(word.isalpha() and len(word) > 1 for word in words):
            return super().format_field(value, spec)
        several = value != 1 if isinstance(value, int) else len(value) != 1
        words = [_in_plural(word) for word in words] if several else words
        if isinstance(value, int):
            return " ".join([str(value), *words])
        # Of frames the numbers stand behind the noun: frames 3-5 are.
        return " ".join([words[0], ranges(value), *words[1:]])


_WORDS = _Words()

# SPDX-FileCopyrightText: 2026 Hush authors
# SPDX-License-Identifier: GPL-3.0-or-later
"""What a frame is composited from, and why one is refused. Asked before a composite and, in its process, right before each frame."""

from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from .. import exr, messages

DENOISED, OLD, NOISY = "denoised", "old", "noisy"
# Worst first: what a frame of several parts is as a whole.
_STATES = (NOISY, OLD, DENOISED)


@dataclass(frozen=True)
class Verdict:
    """`state` is one of the above, or empty where the frame is refused; `key` is that of the message, `reason` is for it.

    `rendered` and `denoised` are the files to composite, None for what is not there or not wanted.
    """

    state: str
    key: str = ""
    reason: str = ""
    rendered: Path | None = None
    denoised: Path | None = None


def judge(
    checked: dict[str, Any],
    rendered: Path,
    denoised: Path,
    *,
    size: tuple[int, int] | None,
    others: Collection[str],
    allow_stale: bool,
) -> Verdict:
    """Whether and how a frame can be composited.

    `checked` is what `hush.check_sequence` says of it; `size` what the scene renders, None where that is not known; `others` are the
    names of the file's other scenes; with `allow_stale` old denoised frames will do, and noisy ones where there are none.
    """
    state, why = checked["state"], messages.stale(checked.get("kind"), checked.get("reason"))
    if state == "unrendered":
        return Verdict("", "unrendered")
    sizes = {file: exr.size_if_whole(file) for file in (rendered, denoised)}
    there = [file for file in sizes if sizes[file]]
    for file in there:
        if sizes[file] != (size or sizes[there[0]]):
            wanted = size or sizes[there[0]]
            return Verdict("", "composite_size", f"{file.name} has {_pixels(sizes[file])} pixels, the scene renders {_pixels(wanted)}")
        scene = exr.attribute(file, "Scene")
        if scene in others:
            return Verdict("", "composite_scene", f"{file.name} was rendered by scene {scene}")
    source = rendered if sizes[rendered] else None
    if state == "current" and sizes[denoised]:
        return Verdict(DENOISED, rendered=source, denoised=denoised)
    if state == "current":
        return Verdict("", "composite_damaged", f"{denoised.name} is damaged or gone")
    if not allow_stale:
        return Verdict("", "stale", why) if state == "stale" else Verdict("", "composite_missing")
    if state == "stale" and sizes[denoised]:
        return Verdict(OLD, "composite_old", why, source, denoised)
    if source is None:
        return Verdict("", "composite_damaged", f"{rendered.name} is damaged or gone")
    reason = why if state == "stale" else messages.of_error(checked.get("reason") or "press Denoise Shot")
    return Verdict(NOISY, "composite_noisy", reason, source, source)


def together(verdicts: list[Verdict]) -> Verdict:
    """What a frame is whose stereo views, or scenes, were judged one by one: refused, or the worst of them."""
    refused = [each for each in verdicts if not each.state]
    return (refused or [min(verdicts, key=lambda each: _STATES.index(each.state))])[0]


def in_words(found: dict[int, tuple[str, str]], how: str) -> list[str]:
    """Frames with the key and reason of their message, as sentences; frames of which the same is said stand together.

    `how` says what to do about frames that are not rendered.
    """
    groups: dict[tuple[str, str], list[int]] = {}
    for frame, (key, reason) in sorted(found.items()):
        # What names the frame's own file is told of the first such frame.
        same = next((each for each in groups if each[0] == key and _alike(each[1], reason)), (key, reason))
        groups.setdefault(same, []).append(frame)
    return [messages.text(key, frames=frames, reason=reason, how=how) for (key, reason), frames in groups.items()]


def _alike(one: str, other: str) -> bool:
    digits = str.maketrans("", "", "0123456789")
    return one.translate(digits) == other.translate(digits)


def _pixels(size: tuple[int, int]) -> str:
    return f"{size[0]} × {size[1]}"

# SPDX-FileCopyrightText: 2026 Hush authors
# SPDX-License-Identifier: GPL-3.0-or-later
"""How far a shot is denoised, and which of its frames are current, as the Hush library says."""

import time
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import bpy

from . import messages, shot
from .messages import Refusal

# A look at the disk is worth this many times what it took, so that a slow network drive is not asked all the time.
_REST = 50.0
_LEAST_REST = 1.0
# What a frame of several files is: the least that one of them is.
_ORDER = ("unrendered", "missing", "stale", "current")


@dataclass(frozen=True)
class Frame:
    """A frame: `state` and `kind` as of `hush.check_sequence` (`size` too, of a file of another size than the scene's), and its files.

    `why` says in words what keeps it from being shown, without a capital; `reason` only why it is out of date or failed.
    """

    state: str
    kind: str | None
    reason: str
    why: str
    source: Path | None
    output: Path | None

    @property
    def is_rendered(self) -> bool:
        """Whether its noisy file is there."""
        return self.state != "unrendered" and self.kind != "input_missing"


@dataclass(frozen=True)
class ShotStatus:
    """Frames of the scene's range: denoised with the settings now, out of date, not denoised, all, rendered."""

    done: int
    stale: int
    missing: int
    total: int
    text: str
    rendered: int = 0


@dataclass
class _Known:
    request: object
    until: float
    frames: dict[int, Frame]
    status: ShotStatus


_scenes: dict[int, _Known] = {}
_check: Any = None


def shot_status(scene: bpy.types.Scene) -> ShotStatus:
    """How far the scene's shot is. Looks at the disk at most once a second, seldomer where that takes long."""
    return _known(scene).status


def frames(scene: bpy.types.Scene) -> dict[int, Frame]:
    """What each frame of the scene's range is; empty where nothing can be said. As often as `shot_status`."""
    return _known(scene).frames


def frame(scene: bpy.types.Scene, number: int) -> Frame:
    """What one frame is now, also outside the scene's range.

    Raises:
        Refusal: Nothing can be said of the shot.
    """
    return _ask(scene, shot.sequences(scene), [number])[number]


def last_known(scene: bpy.types.Scene) -> ShotStatus | None:
    """What `shot_status` said last, without a look at the disk; None before the first time."""
    known = _scenes.get(scene.session_uid)
    return known.status if known else None


def forget() -> None:
    """The files changed: the next question looks at the disk."""
    _scenes.clear()


def _known(scene: bpy.types.Scene) -> _Known:
    known = _scenes.get(scene.session_uid)
    request, wrong = None, None
    try:
        request = (shot.sequences(scene), shot.render_size(scene))
    except Refusal as error:
        wrong = str(error)
    if known and request is not None and known.request == request and time.monotonic() < known.until:
        return known
    began = time.monotonic()
    total = len(shot.frame_range(scene))
    found: dict[int, Frame] = {}
    try:
        if request is not None and total:
            found = _ask(scene, request[0], shot.frame_range(scene))
    except Refusal as error:
        wrong = str(error)
    made = ShotStatus(0, 0, total, total, wrong) if wrong else _summary(scene, found)
    now = time.monotonic()
    known = _scenes[scene.session_uid] = _Known(request, now + max(_LEAST_REST, _REST * (now - began)), found, made)
    return known


def _ask(scene: bpy.types.Scene, sequences: list[dict[str, Any]], numbers: Iterable[int]) -> dict[int, Frame]:
    global _check
    try:
        import hush
    except ImportError as error:
        raise Refusal(messages.text("library", reason=messages.of_error(error))) from None
    _check = _check or hush.SequenceCheck()
    size, how = shot.render_size(scene), shot.how_to_render(scene)
    found: dict[int, list[Frame]] = {number: [] for number in numbers}
    for arguments in sequences:
        try:
            checked = _check.check(**arguments | {"frames": list(found)})
        except (OSError, ValueError, TypeError, hush.HushError) as error:
            raise Refusal(messages.of_error(error)) from None
        for entry in checked["frames"]:
            found[entry["frame"]].append(_frame(entry, size, how))
    return {number: min(parts, key=lambda part: _ORDER.index(part.state)) for number, parts in found.items()}


def _frame(entry: dict[str, Any], size: tuple[int, int] | None, how: str) -> Frame:
    state, kind, reason = entry["state"], entry["kind"], ""
    there = entry["columns"], entry["rows"]
    if state == "current" and size and None not in there and there != size:
        state, kind = "stale", "size"
        wanted = {"wanted_columns": size[0], "wanted_rows": size[1]}
        reason = messages.text("status_wrong_size", columns=there[0], rows=there[1], **wanted)
    elif state == "stale":
        reason = messages.stale(kind, entry["reason"])
    elif kind is not None:
        reason = messages.of_error(entry["reason"] or kind)
    why = {
        "current": "",
        "stale": messages.text("node_stale", reason=reason),
        "missing": messages.text("node_failed", reason=reason) if kind else messages.text("node_missing"),
        "unrendered": messages.text("node_unrendered", how=how),
    }[state]
    files = (Path(entry[name]) if entry[name] else None for name in ("source", "output"))
    return Frame(state, kind, reason, why, *files)


def _summary(scene: bpy.types.Scene, found: dict[int, Frame]) -> ShotStatus:
    states = Counter(each.state for each in found.values())
    stale = Counter(each.reason for each in found.values() if each.state == "stale")
    failed = Counter(each.reason for each in found.values() if each.state == "missing" and each.kind)
    rendered = sum(each.is_rendered for each in found.values())
    missing = states["missing"] + states["unrendered"]
    text = _text(scene, states, stale, failed)
    return ShotStatus(states["current"], states["stale"], missing, len(found), text, rendered)


def _text(scene: bpy.types.Scene, states: Counter[str], stale: Counter[str], failed: Counter[str]) -> str:
    if not states:
        return messages.text("status_range_empty")
    if not states["current"] + states["stale"]:
        if failed:
            return messages.text("status_failed", reason=failed.most_common(1)[0][0])
        if not states["missing"]:
            return messages.text("status_unrendered", folder=shot.frame_pattern(scene).parent, how=shot.how_to_render(scene))
        return messages.text("status_none")
    parts = [messages.text("status_done", done=states["current"], total=states.total())]
    if stale:
        reasons = " and ".join(reason for reason, _ in stale.most_common(2))
        parts.append(messages.text("status_stale", count=stale.total(), reasons=reasons))
    if failed:
        parts.append(messages.text("status_some_failed", count=failed.total(), reason=failed.most_common(1)[0][0]))
    if states["unrendered"]:
        parts.append(messages.text("status_some_unrendered", count=states["unrendered"]))
    if states["missing"] > failed.total():
        parts.append(messages.text("status_to_do", count=states["missing"] - failed.total()))
    return ", ".join(parts)

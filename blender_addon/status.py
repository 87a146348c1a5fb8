# SPDX-FileCopyrightText: 2026 Hush authors
# SPDX-License-Identifier: Apache-2.0
"""How far a shot is denoised, from the output folder's manifest and the settings now."""

import json
import math
import os
import time
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

import bpy

from . import shot

MANIFEST = "hush-manifest.json"
# A look at the disk is worth this many times what it took, so that a slow network drive is not asked all the time.
_REST = 50.0
_LEAST_REST = 1.0


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
class _Disk:
    """What is in the folders of a shot."""

    key: object
    until: float
    frames: dict[str, dict]
    settings: dict[str, dict]
    outputs: set[str]
    sources: dict[str, tuple[int, int]]


@dataclass
class _Known:
    disk: _Disk | None = None
    wanted: object = None
    status: ShotStatus | None = None
    text: str = ""
    reasons: Counter[str] = field(default_factory=Counter)


_scenes: dict[int, _Known] = {}


def shot_status(scene: bpy.types.Scene) -> ShotStatus:
    """How far the scene's shot is. Looks at the disk at most once a second, seldomer where that takes long."""
    known = _scenes.setdefault(scene.session_uid, _Known())
    frames = shot.frame_range(scene)
    try:
        patterns, folder = shot.frame_patterns(scene), shot.output_folder(scene)
    except shot.ShotError as error:
        known.status = ShotStatus(0, 0, len(frames), len(frames), str(error))
        return known.status
    key = (tuple(patterns), folder)
    if known.disk is None or known.disk.key != key or time.monotonic() > known.disk.until:
        known.disk = _look(key, patterns, folder)
        known.wanted = None
    wanted = (frames, _wanted(scene))
    if known.wanted != wanted:
        known.wanted = wanted
        known.status = _compare(known.disk, patterns, frames, wanted[1])
    return known.status


def last_known(scene: bpy.types.Scene) -> ShotStatus | None:
    """What `shot_status` said last, without a look at the disk; None before the first time."""
    known = _scenes.get(scene.session_uid)
    return known.status if known else None


def touch(scene: bpy.types.ID) -> None:
    """Says that the scene's settings changed: what is drawn is drawn anew."""
    from . import refresh

    if isinstance(scene, bpy.types.Scene):
        refresh.request(now=True)


def forget() -> None:
    """The files changed: the next question looks at the disk."""
    _scenes.clear()


def _wanted(scene: bpy.types.Scene) -> dict[str, object]:
    """The settings now, as the manifest would have them; `window` None where the denoiser chooses."""
    return {
        "lambda": shot.lambda_keys(scene),
        "window": shot.window(scene),
        "layers": shot.layers(scene),
        "vector_layer": shot.vector_layer(scene),
        "aovs": bool(scene.hush.use_light_passes),
        "keep_noisy": bool(scene.hush.keep_noisy),
    }


def _look(key: object, patterns: list[Path], folder: Path) -> _Disk:
    began = time.monotonic()
    try:
        manifest = json.loads((folder / MANIFEST).read_text(encoding="utf-8"))
        frames, settings = ({k: v for k, v in manifest[part].items() if isinstance(v, dict)} for part in ("frames", "settings"))
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        frames, settings = {}, {}
    outputs = {name for name, (size, _) in _files(folder).items() if size}
    sources = {str(parent / name): stamp for parent in {p.parent for p in patterns} for name, stamp in _files(parent).items()}
    now = time.monotonic()
    return _Disk(key, now + max(_LEAST_REST, _REST * (now - began)), frames, settings, outputs, sources)


def _files(folder: Path) -> dict[str, tuple[int, int]]:
    """Size and time of change (milliseconds) of the EXR files in a folder."""
    found = {}
    try:
        with os.scandir(folder) as entries:
            for entry in entries:
                if entry.name.lower().endswith(".exr"):
                    stat = entry.stat()
                    found[entry.name] = (stat.st_size, stat.st_mtime_ns // 1_000_000)
    except OSError:
        pass
    return found


def _compare(disk: _Disk, patterns: list[Path], frames: range, wanted: dict[str, object]) -> ShotStatus:
    done = rendered = missing = 0
    reasons: Counter[str] = Counter()
    failures: Counter[str] = Counter()
    for frame in frames:
        files = [shot.frame_file(pattern, frame) for pattern in patterns]
        rendered += all(str(file) in disk.sources for file in files)
        found = [_reason(disk, pattern, frame, wanted) for pattern in patterns]
        if any(file.name not in disk.outputs for file in files):
            missing += 1
            entries = [disk.frames.get(file.name, {}) for file in files]
            failures.update({e.get("reason") or "no reason given" for e in entries if e.get("status") == "failed"})
        elif any(found):
            reasons[next(reason for reason in found if reason)] += 1
        else:
            done += 1
    stale = sum(reasons.values())
    text = _text(done, stale, missing, len(frames), rendered, reasons, failures, patterns[0].parent)
    return ShotStatus(done, stale, missing, len(frames), text, rendered)


def _text(
    done: int, stale: int, missing: int, total: int, rendered: int, reasons: Counter[str], failures: Counter[str], folder: Path
) -> str:
    if total == 0:
        return "the scene's frame range is empty"
    if failures and done + stale == 0:
        return f"denoising failed: {failures.most_common(1)[0][0]}"
    if rendered == 0 and done + stale == 0:
        return f"no rendered frames in {folder}: render the animation"
    if done + stale == 0:
        return "not denoised yet: press Denoise Shot"
    parts = [f"{done} of {total} frames denoised"]
    if stale:
        why = " and ".join(reason for reason, _ in reasons.most_common(2))
        parts.append(f"{stale} {'is' if stale == 1 else 'are'} out of date: {why}")
    if missing:
        unrendered = min(missing, total - rendered)
        if failures:
            parts.append(f"{sum(failures.values())} failed: {failures.most_common(1)[0][0]}")
        elif unrendered:
            parts.append(f"{unrendered} {'is' if unrendered == 1 else 'are'} not rendered")
        if missing > unrendered and not failures:
            parts.append(f"{missing - unrendered} to do")
    return ", ".join(parts)


def _reason(disk: _Disk, pattern: Path, frame: int, wanted: dict[str, object]) -> str | None:
    """Why the output of a frame is not what denoising now would give; None where it is."""
    source = shot.frame_file(pattern, frame)
    entry = disk.frames.get(source.name)
    if entry is None:
        return "not written by Hush"
    old = disk.settings.get(str(entry.get("settings")))
    if old is None:
        return "not written by Hush"
    # A run that was stopped leaves older files in place for the frames that it did not reach.
    if entry.get("status") == "planned":
        return "denoising was stopped"
    if entry.get("status") == "failed":
        return "denoising failed"
    lam = wanted["lambda"][frame] if isinstance(wanted["lambda"], dict) else wanted["lambda"]
    if not math.isclose(old.get("lambda", 1.0), lam, rel_tol=1e-5):
        return "λ changed"
    window = wanted["window"]
    if (window is None and old.get("window") == 1 or old.get("window") == 3) or window not in (None, old.get("window")):
        return "the window changed"
    if old.get("vector_layer") != wanted["vector_layer"] or not _same_layers(old, wanted["layers"]):
        return "the view layers changed"
    if bool(old.get("aovs")) != wanted["aovs"]:
        return "light passes were turned " + ("on" if wanted["aovs"] else "off")
    if old.get("keep_noisy", False) != wanted["keep_noisy"]:
        return "Keep Noisy Image was turned " + ("on" if wanted["keep_noisy"] else "off")
    stamps = {frame: entry.get("stamp")} | {n["frame"]: n.get("stamp") for n in entry.get("neighbours", ())}
    for number, stamp in stamps.items():
        now = disk.sources.get(str(shot.frame_file(pattern, number)))
        # A noisy frame that was deleted since leaves the denoised one as good as it was.
        if now and (not stamp or now != (stamp.get("size"), stamp.get("modified"))):
            return "the render changed"
    return None


def _same_layers(old: dict, wanted: list[str]) -> bool:
    given = old.get("layers") or ([old["layer"]] if old.get("layer") else [])
    return not given or given == ["all"] or set(given) == set(wanted)

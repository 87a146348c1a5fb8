"""What the cases share: the extension on and off, a tiny shot, its files' pixels, and what is left behind."""

from __future__ import annotations

import fcntl
import importlib
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import addon_utils
import bpy
import numpy as np
import OpenEXR
import scene as scenes

MODULE = "bl_ext.user_default.hush"
FRAMES = range(1, 6)
HERE = Path(__file__).resolve().parent


def enable() -> None:
    """Switches the installed extension on, as its checkbox does."""
    addon_utils.enable(MODULE, default_set=True, handle_error=_fail)
    assert MODULE in bpy.context.preferences.addons


def disable() -> None:
    """Switches it off again; its files stay."""
    addon_utils.disable(MODULE, default_set=True, handle_error=_fail)
    assert MODULE not in bpy.context.preferences.addons


def _fail(error: Exception) -> None:
    raise error


def module(name: str) -> ModuleType:
    """A module of the installed extension, such as checks.check."""
    return importlib.import_module(f"{MODULE}.{name}")


def refused(operator: Callable[..., object], *words: str, **arguments: object) -> str:
    """What the error says that the operator must report, with these words in it."""
    try:
        operator(**arguments)
    except RuntimeError as error:
        assert all(word in str(error) for word in words), error
        return str(error)
    raise AssertionError(f"was not refused, should say {words!r}")


def ended(running: Any) -> Any:  # noqa: ANN401 (a job of the extension)
    """The job, at its end."""
    until = time.monotonic() + 60
    while not running.ended:
        assert time.monotonic() < until, "the process does not end"
        running.poll()
        time.sleep(0.01)
    return running


def archive() -> Path:
    """The zip that is tested."""
    return Path(os.environ["HUSH_ZIP"])


def folder(name: str) -> Path:
    """A new empty folder for a test."""
    place = Path(os.environ["HUSH_CASE_FOLDER"]) / name
    shutil.rmtree(place, ignore_errors=True)
    place.mkdir(parents=True)
    return place


def blender(code: str, *arguments: str | Path, enabled: bool = True, limit: float = 60.0, python: Path | None = None) -> str:
    """Runs Python code in a fresh Blender with the same user folder; returns what it printed. `python` has another Blender.

    The extension is on unless `enabled` is False; `sys.argv[1:]` are the arguments. Fails on another exit code than 0.
    """
    start = "import bpy, kit; kit.enable()\n" if enabled else ""
    command = [str(python or sys.executable), "-c", start + code, *map(str, arguments)]
    result = subprocess.run(command, capture_output=True, text=True, timeout=limit, check=False)
    assert result.returncode == 0, f"exit code {result.returncode}\n{result.stdout}\n{result.stderr}"
    return result.stdout


def shot(kind: str = "plain") -> Path:
    """A folder with the rendered, noisy frames 1 to 5 of the tiny scene, frame_0001.exr …; rendered once a version. Only read it.

    Kinds: `plain` has all passes; `bare` Combined only; `blur` motion blur and a second view layer `Vectors` without; `clean`
    many samples, to compare with.
    """
    place = Path(os.environ["HUSH_SHOTS"]) / kind
    with open(f"{place}.lock", "w", encoding="utf-8") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not place.is_dir():
            aside = place.with_suffix(".part")
            shutil.rmtree(aside, ignore_errors=True)
            blender(f"import scene; scene.render({kind!r}, {str(aside)!r})", enabled=False, limit=300)
            aside.rename(place)
    return place


def copy_of_shot(name: str, kind: str = "plain") -> Path:
    """A copy of the shot in a folder of its own, to be changed."""
    place = folder(name)
    for path in sorted(shot(kind).glob("*.exr")):
        shutil.copy(path, place)
    return place


def build_scene(kind: str = "plain", render_to: Path | None = None) -> bpy.types.Scene:
    """The scene that `shot` was rendered from, in the open file; rendering goes to `render_to`/frame_####.exr."""
    scene = scenes.build(kind)
    if render_to is not None:
        scene.render.filepath = str(render_to / "frame_####")
    return scene


def channels(path: Path) -> dict[str, np.ndarray]:
    """All channels of an EXR file by name, `ViewLayer.Combined.R`: float32, (height, width), rows from the top."""
    file = OpenEXR.File(str(path), separate_channels=True)
    return {name: channel.pixels.astype(np.float32) for part in file.parts for name, channel in part.channels.items()}


def layer(path: Path, name: str, components: str = "RGB") -> np.ndarray:
    """A pass, (height, width, components). The view layer may be left out where only one has the pass: `Combined`, `Vector`."""
    planes = channels(path)
    found = [plane for plane in planes if f".{plane}".endswith(f".{name}.{components[0]}")]
    assert len(found) == 1, f"{path.name} has {found or sorted(planes)} for {name}"
    prefix = found[0][: -len(components[0])]
    return np.stack([planes[prefix + component] for component in components], -1)


def rewrite(path: Path, change: Callable[[str, np.ndarray], np.ndarray]) -> None:
    """Replaces the pixels of each channel of an EXR file by `change(channel's name, pixels)`; all else stays."""
    file = OpenEXR.File(str(path), separate_channels=True)
    made = []
    for part in file.parts:
        header = {key: value for key, value in part.header.items() if key not in ("channels", "chunkCount")}
        pixels = {name: np.ascontiguousarray(change(name, channel.pixels)) for name, channel in part.channels.items()}
        made.append(OpenEXR.Part(header, {name: OpenEXR.Channel(name, plane) for name, plane in pixels.items()}, part.name()))
    OpenEXR.File(made).write(str(path))


def assert_close(image: np.ndarray, expected: np.ndarray, tolerance: float, what: str = "pixels") -> None:
    """Fails, with the largest difference and its place, if any value differs by more than `tolerance`."""
    assert image.shape == expected.shape, f"{what}: {image.shape} instead of {expected.shape}"
    difference = np.abs(image.astype(np.float64) - expected)
    place = np.unravel_index(np.nanargmax(difference), difference.shape)
    assert np.isfinite(image).all(), f"{what}: not finite"
    assert difference.max() <= tolerance, f"{what}: {image[place]} instead of {expected[place]} at {place}, off by {difference.max()}"


def assert_differs(image: np.ndarray, other: np.ndarray, at_least: float, what: str = "pixels") -> None:
    """Fails if two images are the same on average."""
    difference = float(np.abs(image.astype(np.float64) - other).mean())
    assert difference >= at_least, f"{what}: differ by {difference} only"


def files(place: Path) -> list[str]:
    """All files below a folder, as relative paths."""
    return sorted(path.relative_to(place).as_posix() for path in place.rglob("*") if path.is_file())


def registered() -> set[str]:
    """Names of all that an add-on can register and leave behind: classes, properties, handlers, timers' modules, menu entries."""
    found = {f"class {name}" for name in dir(bpy.types)}
    for owner in (bpy.types.Scene, bpy.types.WindowManager, bpy.types.Object, bpy.types.ViewLayer, bpy.types.NodeTree):
        found |= {f"{owner.__name__}.{name}" for name in dir(owner)}
    for module in dir(bpy.ops):
        found |= {f"operator {module}.{name}" for name in dir(getattr(bpy.ops, module))}
    for name in dir(bpy.app.handlers):
        handlers = getattr(bpy.app.handlers, name)
        if isinstance(handlers, list):
            found |= {f"handler {name} {handler.__module__}.{handler.__qualname__}" for handler in handlers}
    for name in dir(bpy.types):
        draw = getattr(getattr(getattr(bpy.types, name), "draw", None), "_draw_funcs", [])
        # A menu's own draw function joins the list with the first entry that is added, and stays.
        found |= {f"entry {name} {f.__module__}.{f.__qualname__}" for f in draw if not f.__module__.startswith("bl_ui.")}
    return found


def leftovers() -> list[str]:
    """Names in `registered()` that speak of Hush."""
    return sorted(name for name in registered() if "hush" in name.lower())

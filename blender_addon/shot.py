# SPDX-FileCopyrightText: 2026 Hush authors
# SPDX-License-Identifier: GPL-3.0-or-later
"""What a scene says about its shot: where the frames are, which ones, and with which settings to denoise them."""

import json
import os
import re
from collections import Counter
from pathlib import Path
from typing import Any

import bpy

from . import compat, messages, paths, prepare
from .messages import Refusal
from .settings import SETTINGS

_HASHES = re.compile(r"#+(?=[^#]*$)")
# A minus is a sign only where no word is before it, as the library reads names: `shot_-001`, but not `shot-001`.
_NUMBERED = re.compile(r"^(.*?)((?:(?<![^\W_])-)?\d+)(\D*\.exr)$", re.IGNORECASE)
# What Blender 4.5 and newer fill in; the # in it are not the frame's: {resolution_x:#####}.
_TEMPLATE = re.compile(r"\{[^{}]*\}")
_sequences: dict[Path, tuple[int, list[str]]] = {}
_examples: dict[Path, tuple[int, Path | None]] = {}
_layers: dict[Path, tuple[int | None, list[str]]] = {}
# View layers that Prepare Shot made.
_VECTOR_LAYER = re.compile(rf"{re.escape(prepare.VECTOR_LAYER)}(\.\d+)?")


def stereo_views(scene: bpy.types.Scene) -> list[str]:
    """The stereo views that are rendered; one empty name without stereo."""
    render = scene.render
    if not render.use_multiview:
        return [""]
    both = render.views_format == "STEREO_3D"
    names = [view.name for view in render.views if (view.name in ("left", "right") if both else view.use)]
    return names or [""]


def views(scene: bpy.types.Scene) -> list[str]:
    """The stereo views that have files of their own; one empty name where all is in one file."""
    return stereo_views(scene) if scene.render.image_settings.views_format == "INDIVIDUAL" else [""]


def frame_pattern(scene: bpy.types.Scene, view: str | None = None) -> Path:
    """The noisy frames as `…/frame_####.exr`, of one view where each has its own files (the first one if not said).

    Raises:
        Refusal: Blender cannot make a path of the scene's output setting.
    """
    view = views(scene)[0] if view is None else view
    rendered = _render_pattern(scene, view)
    folder = scene.hush.input_folder.strip()
    if not folder:
        return _with_one_number(rendered, "Output › Output Path")
    given = _absolute(scene, folder)
    # A folder may have # in its name, too.
    if "#" in given.name and not os.path.isdir(given):
        return _with_one_number(given, "Rendered Frames")
    found = _patterns_in(given)
    if not found or paths.folded(rendered.name) in map(paths.folded, found):
        return given / rendered.name
    suffix = scene.render.views[view].file_suffix if view else ""
    fitting = [name for name in found if Path(name).stem.endswith(suffix)]
    return given / (fitting or found)[0]


def frame_patterns(scene: bpy.types.Scene) -> list[Path]:
    """Every sequence of noisy frames: one for each view that has files of its own, else one."""
    return [frame_pattern(scene, view) for view in views(scene)]


def frame_file(pattern: Path, frame: int) -> Path:
    """The file of one frame of a pattern, named as Blender names it."""

    def number(hashes: re.Match[str]) -> str:
        return _digits(frame, len(hashes[0]))

    return pattern.with_name(_HASHES.sub(number, pattern.name, count=1))


def numbered(name: str) -> tuple[str, int] | None:
    """The pattern and the frame number of an EXR file's name, capitals as they are; None where it has no number."""
    match = _NUMBERED.match(name)
    if match is None:
        return None
    before, number, after = match.groups()
    return f"{before}{'#' * len(number.lstrip('-'))}{after}", int(number)


def _digits(frame: int, width: int) -> str:
    return f"{'-' if frame < 0 else ''}{abs(frame):0{width}d}"


def output_folder(scene: bpy.types.Scene) -> Path:
    """Where the denoised frames go."""
    folder = scene.hush.output_folder.strip()
    return _absolute(scene, folder) if folder else frame_pattern(scene).parent / "denoised"


def output_file(scene: bpy.types.Scene, frame: int, view: str | None = None) -> Path:
    """The denoised file of a frame; it has the noisy one's name."""
    return output_folder(scene) / frame_file(frame_pattern(scene, view), frame).name


def frame_range(scene: bpy.types.Scene) -> range:
    """The frames that the scene renders."""
    return range(scene.frame_start, scene.frame_end + 1, max(1, scene.frame_step))


def how_to_render(scene: bpy.types.Scene) -> str:
    """What to do about frames that are not rendered, so that there are files of them that can be denoised."""
    if scene.hush.input_folder.strip():
        return messages.text("how_elsewhere")
    return messages.text("how_render" if compat.is_multilayer(scene.render.image_settings) else "how_prepare")


def has_camera(scene: bpy.types.Scene) -> bool:
    """Whether a scene can be rendered: it has an active camera, or a marker gives it one."""
    return scene.camera is not None or any(marker.camera for marker in scene.timeline_markers)


def changes_camera(scene: bpy.types.Scene) -> bool:
    """Whether markers give the frames of the range several cameras."""
    bound = sorted((marker.frame, marker.camera.name_full) for marker in scene.timeline_markers if marker.camera)
    # What is bound before the first frame holds there, the last of it.
    first = [camera for frame, camera in bound if frame <= scene.frame_start][-1:]
    later = [camera for frame, camera in bound if scene.frame_start < frame <= scene.frame_end]
    before = first or ([scene.camera.name_full] if scene.camera else [])
    return len({*before, *later}) > 1


def vector_layer(scene: bpy.types.Scene) -> str | None:
    """The view layer that the motion vectors are taken from, None for each layer's own."""
    name = scene.hush.vector_layer or _prepared_vector_layer(scene)
    return name if name in scene.view_layers else None


def layers(scene: bpy.types.Scene) -> list[str]:
    """The view layers to denoise: those that are rendered, without the one that only has vectors."""
    spare = _prepared_vector_layer(scene)
    return [layer.name for layer in scene.view_layers if layer.use and layer.name != spare]


def sequences(scene: bpy.types.Scene) -> list[dict[str, Any]]:
    """The scene's shot as arguments of `hush.denoise_sequence` and `hush.check_sequence`, once for each sequence of files.

    Raises:
        Refusal: Blender cannot make a path of the scene's output setting.
    """
    frames, output = list(frame_range(scene)), str(output_folder(scene))
    made = []
    for pattern in frame_patterns(scene):
        chosen, _ = settings(scene, example(pattern))
        made.append({"inputs": str(pattern), "output": output, "frames": frames, **chosen})
    return made


def settings(scene: bpy.types.Scene, file: Path | None) -> tuple[dict[str, Any], list[str]]:
    """The scene's settings as `hush.denoise_sequence` and `hush.check_sequence` take them, and what is odd about them, in words.

    What the files hold decides, and `file` is one of them: a view layer that Prepare Shot made gives the motion vectors and is not
    denoised, also where the scene has it no more; layers that the files do not have, such as files of another scene, are left out.
    """
    vectors = vector_layer(scene)
    names = [name for name in layers(scene) if not _VECTOR_LAYER.fullmatch(name)]
    there, strange = _layers_of(file), []
    if there == [""]:
        # A File Output node knows no view layers.
        names, vectors = [], None
    elif there:
        spare = [name for name in there if _VECTOR_LAYER.fullmatch(name)]
        strange = [name for name in (*names, vectors) if name and name not in there]
        names = [name for name in names if name in there]
        vectors = vectors if vectors in there else next(iter(spare), None)
    chosen = {
        "lam": lambda_keys(scene),
        "window": window(scene),
        "layers": names,
        "vector_layer": vectors,
        "aovs": ["all"] if scene.hush.use_light_passes else [],
        "keep_noisy": bool(scene.hush.keep_noisy),
        "second_pass": bool(scene.hush.second_pass),
        **lambda_mask(scene),
    }
    lacking = {"layers": messages.listed(strange), "there": ", ".join(sorted(there))}
    return chosen, [messages.text("strange_layers", file=file.name, **lacking)] if strange else []


def example(pattern: Path) -> Path | None:
    """The first file of a pattern, or of a folder, that is not empty. Remembered until something comes into the folder or goes."""
    folder = pattern if os.path.isdir(pattern) else pattern.parent
    try:
        changed = folder.stat().st_mtime_ns
    except OSError:
        return None
    known = _examples.get(pattern)
    if known is None or known[0] != changed or known[1] is None:
        # Not each file whose name begins like a frame's is one: a still of F12 or a texture may lie beside them.
        whole = r".*\.exr" if pattern == folder else r"-?\d+".join(map(re.escape, re.split("#+", pattern.name)))
        frame = re.compile(whole, re.IGNORECASE if pattern == folder or paths.IGNORES_CASE else 0)
        named = (path for path in sorted(folder.glob("*")) if frame.fullmatch(path.name))
        found = next((path for path in named if os.path.isfile(path) and (stamp(path) or (0,))[0]), None)
        known = _examples[pattern] = changed, found
    return known[1]


def stamp(file: Path | None) -> tuple[int, int] | None:
    """Size and time of change of a file; None where it is not there."""
    try:
        found = os.stat(file) if file else None
    except OSError:
        return None
    return (found.st_size, found.st_mtime_ns) if found else None


def _layers_of(file: Path | None) -> list[str]:
    """The view layers in a file, one without a name where it has no names for them; none where it cannot be read."""
    try:
        import hush
    except ImportError:
        return []
    try:
        stamp = file.stat().st_mtime_ns if file else None
        if file is None or file in _layers and _layers[file][0] == stamp:
            return _layers[file][1] if file else []
        about = hush.inspect(str(file))
    except (OSError, ValueError, hush.HushError):
        return []
    found = [layer["name"] for layer in about.get("layout", about).get("layers", ())]
    names = [name for name in found if name] or found[:1]
    _layers[file] = stamp, names
    return names


def render_size(scene: bpy.types.Scene) -> tuple[int, int] | None:
    """The size the scene renders at, None where it is cropped to a border."""
    render = scene.render
    if render.use_border and render.use_crop_to_border:
        return None
    percentage = render.resolution_percentage
    return render.resolution_x * percentage // 100, render.resolution_y * percentage // 100


def is_relative(scene: bpy.types.Scene) -> bool:
    """Whether the scene's folders move with its file."""
    hush = scene.hush
    paths = (scene.render.filepath, hush.input_folder, hush.output_folder, hush.lambda_images)
    return any(path.startswith("//") for path in paths)


def window(scene: bpy.types.Scene) -> int | None:
    """Frames on each side that help; None to let the denoiser choose."""
    return None if scene.hush.window == "AUTO" else int(scene.hush.window)


def lambda_source(scene: bpy.types.Scene) -> str:
    """What λ follows: `value`, `keys` (an F-curve), or `driver` or `nla`, of which only the value of now is known."""
    animation = scene.animation_data
    if animation is None:
        return "value"
    if any(driver.data_path == "hush.lam" for driver in animation.drivers):
        return "driver"
    if _lambda_curve(scene):
        return "keys"
    return "nla" if animation.use_nla and any(not track.mute for track in animation.nla_tracks) else "value"


def lambda_at(scene: bpy.types.Scene, frame: int) -> float:
    """λ at a frame, within its range, without going there. Under a driver or NLA strips: its value now."""
    curve = _lambda_curve(scene) if lambda_source(scene) == "keys" else None
    return _evaluate(scene, curve, frame)


def lambda_keys(scene: bpy.types.Scene) -> float | dict[int, float]:
    """λ for each frame of the range, or one number where all are the same."""
    curve = _lambda_curve(scene) if lambda_source(scene) == "keys" else None
    if curve is None:
        return _evaluate(scene, None, 0)
    values = {frame: _evaluate(scene, curve, frame) for frame in frame_range(scene)}
    distinct = set(values.values())
    return distinct.pop() if len(distinct) == 1 else values


def lambda_mask(scene: bpy.types.Scene) -> dict[str, Any]:
    """The mask of λ as arguments of `hush.denoise_sequence` and `hush.preview`; none where the scene has no mask."""
    images, name = scene.hush.lambda_images.strip(), scene.hush.lambda_pass.strip()
    if not images and not name:
        return {}
    mask = {"lambda_images": str(_absolute(scene, images))} if images else {"lambda_pass": name}
    return {**mask, "lambda_masked": scene.hush.lambda_masked}


def _evaluate(scene: bpy.types.Scene, curve: bpy.types.FCurve | None, frame: int) -> float:
    if curve is None:
        value = scene.hush.lam
    else:
        # The render settings can stretch time; curves are read at the stretched frame.
        value = curve.evaluate(frame * scene.render.frame_map_new / scene.render.frame_map_old)
    return min(max(value, SETTINGS["lambda"].least), SETTINGS["lambda"].most)


def _lambda_curve(scene: bpy.types.Scene) -> bpy.types.FCurve | None:
    curves = [curve for curve in compat.fcurves(scene) if curve.data_path == "hush.lam" and not curve.mute]
    return curves[0] if curves else None


def _prepared_vector_layer(scene: bpy.types.Scene) -> str:
    try:
        record = json.loads(scene.hush.prepared or "{}")
    except ValueError:
        return ""
    name = record.get("vector_layer") if isinstance(record, dict) else None
    return name if isinstance(name, str) else ""


def _absolute(scene: bpy.types.Scene, path: str) -> Path:
    return Path(bpy.path.abspath(path, library=scene.library))


def _render_pattern(scene: bpy.types.Scene, view: str) -> Path:
    render = scene.render
    # Two frames whose digits all differ tell where Blender puts the number; the setting tells how many digits it has.
    try:
        one, two = (render.frame_path(frame=frame, view=view) for frame in (11111, 22222))
    except RuntimeError as error:
        reason = str(error).removeprefix("Error: ").strip()
        raise Refusal(messages.text("path", reason=reason)) from None
    runs = _HASHES.findall(_TEMPLATE.sub("", re.split(r"[\\/]", render.filepath)[-1]))
    width = len(runs[-1]) if runs else 4
    if render.is_movie_format:
        return _beside_film(scene, Path(one), width)
    differing = [i for i, (a, b) in enumerate(zip(one, two, strict=False)) if a != b]
    if not differing:
        raise Refusal(messages.text("path_number", path=one))
    end = differing[-1] + 1
    path = Path(one[: end - max(width, 5)] + "#" * width + one[end:])
    # Also after the output was set to another format for the finished film, the frames are EXR files.
    return path.with_suffix(".exr") if render.use_file_extension else path


def _with_one_number(pattern: Path, where: str) -> Path:
    """The pattern, unless other # of its name are the name's own; the library cannot tell them from the frame number's."""
    if len(re.findall(r"#+", pattern.name)) > 1:
        raise Refusal(messages.text("path_numbers", name=pattern.name, where=where))
    return pattern


def _beside_film(scene: bpy.types.Scene, film: Path, width: int) -> Path:
    """Where frames go by the output path of a film, whose name has the range in place of a number."""
    numbers = "-".join(_digits(frame, width) for frame in (scene.frame_start, scene.frame_end))
    head, there, tail = film.name.rpartition(numbers)
    # A name that ends in a film's extension has no range; frames get their number behind it.
    name = f"{head}{'#' * width}{tail.removesuffix(film.suffix)}" if there else f"{film.name}{'#' * width}"
    return film.with_name(f"{name}.exr")


def _patterns_in(folder: Path) -> list[str]:
    """The numbered EXR sequences in a folder, the longest first."""
    try:
        changed = folder.stat().st_mtime_ns
        if folder not in _sequences or _sequences[folder][0] != changed:
            counts = Counter(found[0] for path in folder.iterdir() if (found := numbered(path.name)))
            _sequences[folder] = (changed, [name for name, _ in counts.most_common()])
    except OSError:
        return []
    return _sequences[folder][1]

# SPDX-FileCopyrightText: 2026 Hush authors
# SPDX-License-Identifier: Apache-2.0
"""Check Shot: what stands in the way of a good result, in words, with the fix where a button can do it."""

import os
import shutil
import tempfile
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import bpy
from bpy.props import StringProperty

from . import compat, node, prepare, shot

ERROR, WARNING, INFO = "ERROR", "WARNING", "INFO"
_ICONS = {ERROR: "ERROR", WARNING: "QUESTION", INFO: "INFO"}
# The disk is looked at again after this many times what it took, so that a slow network drive is not asked all the time.
_REST, _LEAST_REST = 50.0, 3.0
_seen: dict[int, tuple[object, float, list["Problem"]]] = {}


@dataclass(frozen=True)
class Problem:
    """One thing that is not right. `key` is also the fix's, for `bpy.ops.hush.fix(key=…)`; `fix` is that operator and its arguments."""

    key: str
    text: str
    fix: tuple[str, dict[str, object]] | None = None
    level: str = WARNING


def problems(scene: bpy.types.Scene, *, fresh: bool = False) -> list[Problem]:
    """All that is not right with a scene's shot, the worst first.

    What the disk says is remembered for some seconds, unless `fresh` is asked for.
    """
    found = [*_scene_problems(scene), *_disk_problems(scene, fresh=fresh)]
    return sorted(found, key=lambda problem: (ERROR, WARNING, INFO).index(problem.level))


def forget() -> None:
    """The next question looks at the disk."""
    _seen.clear()


def _fixable(scene: bpy.types.Scene, key: str, text: str, level: str = WARNING) -> Problem:
    return Problem(key, text, ("hush.fix", {"key": key, "scene": scene.name}), level)


def _scene_problems(scene: bpy.types.Scene) -> Iterator[Problem]:
    if scene.library is not None:
        yield Problem("linked", f"The scene is linked from {scene.library.filepath}: open that file", level=ERROR)
    if scene.render.engine != "CYCLES":
        yield _fixable(scene, "engine", f"The render engine is {scene.render.engine}; Hush denoises renders of Cycles", ERROR)
    if scene.camera is None and not any(marker.camera for marker in scene.timeline_markers):
        text = "The scene has no camera"
        has_one = any(thing.type == "CAMERA" for thing in scene.objects)
        yield _fixable(scene, "camera", f"{text} that is active", ERROR) if has_one else Problem("camera", text, level=ERROR)
    paths = (scene.render.filepath, scene.hush.input_folder, scene.hush.output_folder)
    if not bpy.data.is_saved and any(path.startswith("//") for path in paths):
        yield _fixable(scene, "save", "The file is not saved yet, and the output path is beside it (//): save the file first", ERROR)
    if not any(layer.use for layer in scene.view_layers):
        yield Problem("layers", "No view layer is used for rendering", level=ERROR)
    if scene.render.engine == "CYCLES":
        yield from _cycles_problems(scene)
    yield from _output_problems(scene)
    yield from _lambda_problems(scene)


def _cycles_problems(scene: bpy.types.Scene) -> Iterator[Problem]:
    lacking = {layer.name: prepare.missing_passes(layer) for layer in prepare.rendered_layers(scene)}
    for name, missing in lacking.items():
        if missing:
            yield _fixable(scene, "passes", f"View layer {name} renders without {' and '.join(missing)}, which make the result better")
    if not prepare.seed_is_animated(scene):
        yield _fixable(scene, "seed", "The seed is not animated: every frame has the same noise, so its neighbours cannot help")
    if scene.cycles.use_denoising:
        yield _fixable(scene, "denoising", "Cycles denoises each frame already: that costs time and takes detail that Hush could keep")
    blurred = prepare.blurred_layers(scene)
    if blurred and not prepare.vector_layer(scene):
        names = ", ".join(layer.name for layer in blurred)
        text = f"With motion blur the Vector pass of {names} is empty: neighbours cannot help without a view layer for the vectors"
        yield _fixable(scene, "motion_blur", text)
    elif len(blurred) > 1:
        text = "Several view layers with motion blur take their vectors from one: where they show different things, neighbours help less"
        yield Problem("vector_layers", text, level=INFO)
    source = scene.view_layers.get(prepare.vector_layer(scene))
    if source is not None and scene.render.use_single_layer:
        yield _fixable(scene, "single_layer", f"Render Single Layer is on: view layer {source.name} with the vectors is not rendered")
    elif source is not None and not (source.use and source.use_pass_vector):
        yield _fixable(scene, "vector_pass", f"View layer {source.name} is to give the motion vectors, but does not render them")
    elif source is not None and scene.render.use_motion_blur and source.use_motion_blur:
        yield _fixable(scene, "vector_pass", f"View layer {source.name} is to give the motion vectors, but has motion blur")


def _output_problems(scene: bpy.types.Scene) -> Iterator[Problem]:
    render, settings = scene.render, scene.render.image_settings
    # Frames in a folder of their own come from elsewhere, such as a File Output node.
    if not scene.hush.input_folder:
        if settings.file_format != "OPEN_EXR_MULTILAYER":
            text = f"The output is {settings.file_format}: only OpenEXR MultiLayer keeps the passes"
            yield _fixable(scene, "format", text, ERROR)
        elif settings.exr_codec not in prepare.LOSSLESS:
            yield _fixable(scene, "format", f"The codec {settings.exr_codec} is lossy and blurs the passes: use ZIP")
        elif settings.color_depth != "32":
            yield _fixable(scene, "format", "The output has 16 bit: very bright pixels and fine steps are lost before denoising")
    if not render.use_overwrite:
        yield _fixable(scene, "overwrite", "Overwrite is off: frames of an earlier render stay, also where the scene changed", INFO)
    if render.use_placeholder:
        text = "Placeholders are on: empty files stand for frames that are not rendered yet"
        yield _fixable(scene, "placeholders", text, INFO)
    if render.use_sequencer and compat.strips(scene):
        yield _fixable(scene, "sequencer", "The Sequencer has strips and is rendered in place of the scene")


def _lambda_problems(scene: bpy.types.Scene) -> Iterator[Problem]:
    source = shot.lambda_source(scene)
    if source in ("driver", "nla"):
        name = "a driver" if source == "driver" else "NLA strips"
        yield Problem("lambda", f"λ follows {name}: its value now, {scene.hush.lam:g}, is used for all frames. Keyframes are followed")
    low, high = shot.LAMBDA_MIN, shot.LAMBDA_MAX
    curves = [curve for curve in compat.fcurves(scene) if curve.data_path == "hush.lam" and not curve.mute]
    for curve in curves if source == "keys" else ():
        outside = [frame for frame in shot.frame_range(scene) if not low <= round(curve.evaluate(frame), 4) <= high]
        if outside:
            text = f"λ is {curve.evaluate(outside[0]):g} at frame {outside[0]}: what is outside {low:g} to {high:g} is cut off"
            yield Problem("lambda", text)


def _disk_problems(scene: bpy.types.Scene, *, fresh: bool) -> list[Problem]:
    try:
        patterns, output = shot.frame_patterns(scene), shot.output_folder(scene)
    except shot.ShotError as error:
        return [Problem("path", str(error), level=ERROR)]
    frames = shot.frame_range(scene)
    cycles = scene.render.engine == "CYCLES"
    layers = tuple((name, *prepare.missing_passes(scene.view_layers[name])) for name in shot.layers(scene) if cycles)
    key = (tuple(patterns), output, frames, layers, shot.vector_layer(scene), shot.window(scene), scene.hush.keep_noisy)
    known = _seen.get(scene.session_uid)
    if not fresh and known and known[0] == key and time.monotonic() < known[1]:
        return known[2]
    began = time.monotonic()
    found = list(_look(scene, patterns, output, frames))
    took = time.monotonic() - began
    _seen[scene.session_uid] = (key, began + took + max(_LEAST_REST, _REST * took), found)
    return found


def _look(scene: bpy.types.Scene, patterns: list[Path], output: Path, frames: range) -> Iterator[Problem]:
    try:
        import hush
    except ImportError as error:
        yield Problem("library", f"The Hush library does not load in this Blender: {error}", level=ERROR)
        hush = None
    if any(pattern.parent == output for pattern in patterns):
        yield Problem("folder", f"The denoised frames would replace the rendered ones in {output}: choose another folder", level=ERROR)
    for folder in dict.fromkeys([patterns[0].parent, output]):
        wrong = why_not_writable(folder)
        if wrong and (folder == output or not scene.hush.input_folder):
            yield Problem("folder", wrong, level=ERROR)
    present, missing = _rendered(patterns, frames)
    if not frames:
        yield Problem("frames", "The frame range of the scene is empty", level=ERROR)
    elif not present:
        yield Problem("frames", f"The shot is not rendered yet: there are no frames in {patterns[0].parent}", level=INFO)
    elif missing:
        yield Problem("frames", f"{in_words(missing)} not rendered")
    if present:
        yield from _space(present, output, len(frames) * len(patterns))
        if hush is not None:
            yield from _first_frame(scene, present[0])


def _rendered(patterns: list[Path], frames: range) -> tuple[list[Path], list[int]]:
    """The files that are there, and the frames of which one is missing or empty."""
    names: dict[Path, set[str]] = {}
    for folder in {pattern.parent for pattern in patterns}:
        try:
            with os.scandir(folder) as entries:
                names[folder] = {entry.name for entry in entries if entry.name.lower().endswith(".exr") and entry.stat().st_size}
        except OSError:
            names[folder] = set()
    present, missing = [], []
    for frame in frames:
        files = [shot.frame_file(pattern, frame) for pattern in patterns]
        there = [file for file in files if file.name in names[file.parent]]
        present += there
        if len(there) < len(files):
            missing.append(frame)
    return present, missing


def _space(present: list[Path], output: Path, total: int) -> Iterator[Problem]:
    size = present[len(present) // 2].stat().st_size
    needed = 0
    for file in present:
        done = output / file.name
        needed += 0 if done.exists() else size
    needed += size * (total - len(present))
    free = shutil.disk_usage(_nearest(output)).free
    if needed * 1.05 > free:
        text = f"The denoised frames need about {_bytes(needed)}, but {_bytes(free)} are free at {_nearest(output)}"
        yield Problem("space", text, level=WARNING)


def _first_frame(scene: bpy.types.Scene, file: Path) -> Iterator[Problem]:
    import hush

    try:
        told = hush.inspect(str(file))
    except (OSError, hush.HushError) as error:
        yield Problem("first_frame", str(error), level=ERROR)
        return
    layout = told.get("layout", told)
    if told.get("problem"):
        yield Problem("first_frame", f"{file.name}: {told['problem']}", level=ERROR)
    size = layout.get("columns"), layout.get("rows")
    wanted = node.render_size(scene)
    if wanted and None not in size and size != wanted:
        text = f"{file.name} has {size[0]} × {size[1]} pixels, the scene renders {wanted[0]} × {wanted[1]}: it is of an earlier render"
        yield Problem("older", text)
    passes = {layer["name"]: {each["name"] for each in layer["passes"]} for layer in layout.get("layers", [])}
    yield from _older_layout(scene, file, passes)
    if layout.get("lossy"):
        yield Problem("lossy", f"{file.name} has lossy compression ({layout.get('compression')}): render again with ZIP")


def _older_layout(scene: bpy.types.Scene, file: Path, passes: dict[str, set[str]]) -> Iterator[Problem]:
    if scene.render.engine != "CYCLES" or set(passes) <= {""}:
        return
    gone = [name for name in (*shot.layers(scene), shot.vector_layer(scene) or "") if name and name not in passes]
    if gone:
        yield Problem("older", f"{file.name} has no view layer {' and '.join(gone)}: it is of an earlier render")
    for name in shot.layers(scene):
        layer = scene.view_layers[name]
        wanted = {"Denoising Albedo": layer.cycles.denoising_store_passes, "Vector": layer.use_pass_vector, "Depth": layer.use_pass_z}
        lacking = [each for each, on in wanted.items() if on and name in passes and each not in passes[name]]
        if lacking:
            yield Problem("older", f"{file.name} was rendered before {' and '.join(lacking)} of {name} was turned on: render again")


def why_not_writable(folder: Path) -> str | None:
    """Why files cannot be written into a folder, which may not be there yet; None where they can."""
    place = _nearest(folder)
    if not place.is_dir():
        return f"{place} is a file, not a folder: frames cannot be written into {folder}"
    try:
        with tempfile.TemporaryFile(dir=place):
            return None
    except OSError as error:
        return f"Nothing can be written into {folder}: {error.strerror or error}"


def _nearest(path: Path) -> Path:
    """The path, or the innermost folder around it that is there."""
    while not path.exists() and path != path.parent:
        path = path.parent
    return path


def ranges(frames: Iterable[int]) -> str:
    """Frames as 3-5, 9."""
    runs: list[list[int]] = []
    for frame in sorted(frames):
        if runs and frame == runs[-1][1] + 1:
            runs[-1][1] = frame
        else:
            runs.append([frame, frame])
    return ", ".join(f"{first}-{last}" if first != last else str(first) for first, last in runs)


def in_words(frames: list[int]) -> str:
    """Frames as "frames 3-5, 9 are"."""
    return f"Frame {frames[0]} is" if len(frames) == 1 else f"Frames {ranges(frames)} are"


def _bytes(count: float) -> str:
    units = ["TB", "GB", "MB", "kB", "bytes"]
    while count >= 1000 and len(units) > 1:
        units.pop()
        count /= 1000
    return f"{count:.3g} {units[-1]}"


class HUSH_OT_check_shot(bpy.types.Operator):
    """Look for what is missing to denoise this shot well"""

    bl_idname = "hush.check_shot"
    bl_label = "Check Shot"
    bl_options = {"REGISTER"}

    scene: StringProperty(name="Scene", description="Scene to check. Empty: the open one", options={"SKIP_SAVE"})

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        """Shows the problems with their fixes."""
        scene = prepare.scene_of(self, context)
        if scene is None:
            return {"CANCELLED"}
        problems(scene, fresh=True)
        return context.window_manager.invoke_popup(self, width=560)

    def draw(self, context: bpy.types.Context) -> None:
        """A line for each problem; a fixed one vanishes."""
        scene = bpy.data.scenes.get(self.scene) or context.scene
        found = problems(scene)
        self.layout.label(text=_summary(found), icon="ERROR" if found else "CHECKMARK")
        for problem in found:
            row = self.layout.row()
            row.label(text=problem.text, icon=_ICONS[problem.level])
            if problem.fix:
                operator, arguments = problem.fix
                button = row.operator(operator, text="Fix")
                for name, value in arguments.items():
                    setattr(button, name, value)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Reports the problems; cancelled, with an error, where the shot cannot be denoised so."""
        scene = prepare.scene_of(self, context)
        if scene is None:
            return {"CANCELLED"}
        found = problems(scene, fresh=True)
        for problem in found:
            if problem.level != ERROR:
                self.report({problem.level}, problem.text)
        errors = [problem.text for problem in found if problem.level == ERROR]
        if errors:
            self.report({"ERROR"}, ". ".join(errors))
            return {"CANCELLED"}
        self.report({"INFO"}, _summary(found))
        return {"FINISHED"}


def _summary(found: list[Problem]) -> str:
    serious = [problem for problem in found if problem.level != INFO]
    if not serious:
        return "The shot is ready"
    return f"{len(serious)} problems" if len(serious) > 1 else "1 problem"


def register() -> None:
    """Adds the operator."""
    bpy.utils.register_class(HUSH_OT_check_shot)


def unregister() -> None:
    """Takes the operator away."""
    bpy.utils.unregister_class(HUSH_OT_check_shot)
    forget()

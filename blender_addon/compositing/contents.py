# SPDX-FileCopyrightText: 2026 Hush authors
# SPDX-License-Identifier: GPL-3.0-or-later
"""What a composite is made of: the scenes, files and settings, all resolved for a process that has a copy of the file elsewhere."""

import itertools
import os
import shutil
import tempfile
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import bpy

from .. import compat, messages, paths, shot
from ..checks import check
from ..messages import Refusal
from ..nodes import kinds
from .verdicts import in_words, judge, together

_numbers = itertools.count(1)


@dataclass
class Contents:
    """`work` is the job for the process; `refused` the frames that are not in it, with key and reason; `total` how many are wanted."""

    work: dict[str, Any]
    total: int
    refused: dict[int, tuple[str, str]] = field(default_factory=dict)


@dataclass
class _Source:
    """A scene whose frames are shown: what `hush.check_sequence` takes, and the files of each frame, for each stereo view."""

    scene: bpy.types.Scene
    patterns: list[Path]
    output: Path
    views: list[dict[str, Any]]

    def files(self, frame: int) -> list[tuple[Path, Path]]:
        rendered = [shot.frame_file(pattern, frame) for pattern in self.patterns]
        return [(each, self.output / each.name) for each in rendered]

    def work(self) -> dict[str, Any]:
        # A linked scene may have the same name, which is all that a file says. One without a camera, as a new one that got the name
        # this one had before, rendered nothing.
        others = sorted({scene.name for scene in bpy.data.scenes if shot.has_camera(scene)} - {self.scene.name})
        return {
            "scene": self.scene.name_full,
            "views": self.views,
            "size": shot.render_size(self.scene),
            "others": others,
            "light_passes": bool(self.scene.hush.use_light_passes),
            "layers": [layer.name for layer in self.scene.view_layers],
            "off": [layer.name for layer in self.scene.view_layers if not layer.use],
            "space": compat.file_space(self.scene),
        }


def folder(scene: bpy.types.Scene) -> Path:
    """Where the composited frames go."""
    given = scene.hush.composite_folder.strip()
    if given:
        return Path(bpy.path.abspath(given, library=scene.library))
    return shot.frame_pattern(scene).parent / "composited"


def make(scene: bpy.types.Scene, *, allow_stale: bool) -> Contents:
    """Looks at everything and changes nothing.

    Raises:
        Refusal: No frame can be composited; where it is for the frames, all of them are named with their reasons.
    """
    _refuse(scene)
    nodes, sources = _nodes(scene)
    made = Contents(_work(scene, nodes, sources, allow_stale=allow_stale), len(shot.frame_range(scene)))
    some_denoised = False
    checked = [[_check(view, shot.frame_range(scene)) for view in source.views] for source in sources]
    for number, frame in enumerate(shot.frame_range(scene)):
        files = [source.files(frame) for source in sources]
        verdicts = []
        for source, pairs, answers in zip(made.work["sources"], files, checked, strict=True):
            for (rendered, denoised), answer in zip(pairs, answers, strict=True):
                rules = {"size": source["size"], "others": source["others"], "allow_stale": allow_stale}
                verdicts.append(judge(answer[number], rendered, denoised, **rules))
                some_denoised |= answer[number]["state"] in ("current", "stale")
        verdict = together(verdicts)
        if verdict.state:
            names = [shot.frame_file(pattern, frame).with_suffix(_suffix(scene)).name for pattern in shot.frame_patterns(scene)]
            pairs = [[(str(rendered), str(denoised)) for rendered, denoised in each] for each in files]
            made.work["frames"].append({"frame": frame, "files": pairs, "names": names})
        else:
            made.refused[frame] = (verdict.key, verdict.reason)
    if not some_denoised:
        raise Refusal(messages.text("composite_nothing"))
    if not made.work["frames"]:
        raise Refusal(". ".join(in_words(made.refused, shot.how_to_render(scene))))
    return made


def _refuse(scene: bpy.types.Scene) -> None:
    if scene.library is not None:
        raise Refusal(messages.text("composite_linked", file=scene.library.filepath))
    if compat.compositor_tree(scene) is None:
        raise Refusal(messages.text("composite_no_nodes"))
    if not shot.frame_range(scene):
        raise Refusal(messages.text("range_empty"))
    if scene.render.use_multiview and shot.views(scene) == [""] and not compat.READS_VIEWS_OF_ONE_FILE:
        raise Refusal(messages.text("stereo_one_file"))
    unsaved = _unsaved_images(scene)
    if unsaved:
        raise Refusal(messages.text("composite_unsaved", images=messages.listed(unsaved)))
    if scene.hush.composite_folder.startswith("//") and not bpy.data.is_saved:
        raise Refusal(messages.text("save"))
    target = folder(scene)
    taken = {pattern.parent for pattern in shot.frame_patterns(scene)} | {shot.output_folder(scene)}
    if any(paths.place_of_folder(target) == paths.place_of_folder(other) for other in taken):
        raise Refusal(messages.text("composite_folder_same", folder=target))
    wrong = check.why_not_writable(target)
    if wrong:
        raise Refusal(wrong)


def _unsaved_images(scene: bpy.types.Scene) -> list[str]:
    """Names of the images in the compositor whose pixels are neither in a file nor in the .blend, and so not in the copy."""
    shown = (each for _, each in kinds.reached(scene) if not each.mute)
    images = (getattr(owner, "image", None) for each in shown for owner in (each, getattr(each, "texture", None)))
    return sorted({image.name for image in images if image is not None and image.source != "VIEWER" and image.is_dirty})


def _nodes(scene: bpy.types.Scene) -> tuple[dict[str, dict[str, Any]], list[_Source]]:
    """The nodes of Hush with the number of their source and their view layer, and the sources: the scenes whose frames are needed."""
    scenes: list[bpy.types.Scene] = []
    found = {}
    for tree, each in kinds.reached(scene):
        shown = kinds.of_hush(each)
        if shown is not None and not each.mute:
            source = shown[0] or scene
            layers = shot.layers(source)
            scenes += [source] if source not in scenes else []
            layer = shown[1] or (layers[0] if layers else "")
            found[kinds.key(tree, each)] = {"source": scenes.index(source), "layer": layer}
        elif (kinds.shows_renders(each, scene) or each == compat.render_input(tree, scene)) and scene not in scenes:
            scenes.append(scene)
    return found, [_source(each) for each in scenes or [scene]]


def _source(scene: bpy.types.Scene) -> _Source:
    patterns, output = shot.frame_patterns(scene), shot.output_folder(scene)
    views = []
    for pattern in patterns:
        settings, _ = shot.settings(scene, shot.example(pattern))
        views.append({"inputs": str(pattern), "output": str(output), "settings": settings})
    return _Source(scene, patterns, output, views)


def _check(view: dict[str, Any], frames: range) -> list[dict[str, Any]]:
    try:
        import hush
    except ImportError as error:
        raise Refusal(messages.text("library", reason=error)) from None
    if not hasattr(hush, "check_sequence"):
        raise Refusal(messages.text("composite_library"))
    try:
        return hush.check_sequence(view["inputs"], view["output"], frames=list(frames), **view["settings"])["frames"]
    except (OSError, ValueError, hush.HushError) as error:
        raise Refusal(messages.of_error(error)) from None


def _work(scene: bpy.types.Scene, nodes: dict[str, dict[str, Any]], sources: list[_Source], *, allow_stale: bool) -> dict[str, Any]:
    """The job, but for its frames and the copy of the file."""
    target = folder(scene)
    protected = {paths.place(place / pattern.name.split("#")[0]) for s in sources for pattern in s.patterns for place in _folders(s)}
    undefined = [kinds.key(*each) for each in kinds.reached(scene) if kinds.is_undefined(each[1])]
    return {
        "scene": scene.name,
        "origin": str(Path(bpy.data.filepath).parent) if bpy.data.filepath else os.getcwd(),
        "folder": str(target),
        "aside": str(target / f".hush-{os.getpid()}-{next(_numbers)}"),
        "format": scene.hush.composite_format,
        "views": shot.views(scene),
        "views_in_one_file": scene.render.use_multiview and shot.views(scene) == [""],
        "allow_stale": allow_stale,
        "nodes": nodes,
        "undefined": undefined,
        "sources": [source.work() for source in sources],
        "protected": sorted(protected),
        "frames": [],
    }


def _folders(source: _Source) -> set[Path]:
    return {pattern.parent for pattern in source.patterns} | {source.output}


def _suffix(scene: bpy.types.Scene) -> str:
    return {"OPEN_EXR": ".exr", "PNG": ".png"}[scene.hush.composite_format]


def save_copy(scene: bpy.types.Scene, *, scripts: bool) -> Path:
    """Writes the scene and all that it uses into a file of its own, and returns it; its folder is new and holds nothing else.

    `libraries.write` and not Save a Copy: that one packs files into the open one where it packs automatically, and runs what other
    add-ons do on saving. The name stays, as output paths may have it in them.

    Raises:
        Refusal: It cannot be written.
    """
    name = Path(bpy.data.filepath).name or "untitled.blend"
    texts = {text for text in bpy.data.texts if text.use_module} if scripts else set()
    try:
        place = Path(tempfile.mkdtemp(prefix="hush-composite-", dir=bpy.app.tempdir or None))
    except OSError as error:
        raise Refusal(messages.text("composite_copy", reason=error.strerror or error)) from None
    try:
        bpy.data.libraries.write(str(place / name), {scene, *texts}, path_remap="ABSOLUTE")
    except (OSError, RuntimeError) as error:
        remove_copy(place / name)
        raise Refusal(messages.text("composite_copy", reason=messages.of_error(error))) from None
    return place / name


def remove_copy(blend: Path) -> None:
    """Takes the copy and its folder away."""
    # What cannot be removed stays; Blender empties its folder for such files when it ends.
    shutil.rmtree(blend.parent, ignore_errors=True)

# SPDX-FileCopyrightText: 2026 Hush authors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The compositor of a copied file, fed by the files of the frames in place of renders. Only for the process that composites."""

import os
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import bpy

from .. import compat, exr, messages, paths
from ..nodes import kinds
from .render_input import RenderInput

_FILE_OUTPUT = "CompositorNodeOutputFile"
_IMAGE_NAMES = ("Combined", "Image")
# The outputs of Render Layers that a node of Hush is for; all others are passes.
_OF_IMAGE = {"Image", "Alpha"}


class FrameError(Exception):
    """Why a frame cannot be composited."""


@dataclass(frozen=True)
class Files:
    """The files of one frame, and of one stereo view where each has its own: what stands for a scene's renders, what for its node."""

    layers: Path
    denoised: Path


@dataclass
class _Feed:
    """An Image node in place of another, and where its images go: (name of the pass, node, identifier of the socket, muted)."""

    tree: bpy.types.NodeTree
    node: bpy.types.Node
    source: int
    layer: str
    denoised: bool
    targets: list[tuple[str, str, str, bool]] = field(default_factory=list)


class Stage:
    """A scene's compositor, changed for good so that `turn_to` decides what it shows.

    `work` is the job of `composite.py`; `warn` gets what the artist should know.
    """

    def __init__(self, scene: bpy.types.Scene, work: dict[str, Any], warn: Callable[[str], None]) -> None:
        self._scene, self._work, self._warn = scene, work, warn
        self._warned: set[str] = set()
        self._feeds: list[_Feed] = []
        self._mattes: list[tuple[bpy.types.Node, int, str]] = []
        self._images: list[bpy.types.Image] = []
        self._sources = {source["scene"]: number for number, source in enumerate(work["sources"])}
        self._set_output()
        seen: set[bpy.types.NodeTree] = set()
        for tree in compat.own_compositor_trees(scene):
            self._build(tree, seen)
        self._render_input = self._replace_render_input() if RenderInput.is_in(scene) else None

    @property
    def moves(self) -> bool:
        """Whether the scene must be at a frame before `turn_to`."""
        return self._render_input is not None and self._render_input.moves

    def turn_to(self, files: list[Files], view: str) -> None:
        """Shows the files of a frame, of each of the job's sources.

        Raises:
            FrameError: Blender does not read a file, or it lacks what the compositor shows.
        """
        self._scene.render.filepath = self._path + (self._scene.render.views[view].file_suffix if view else "")
        if self._render_input is not None:
            self._render_input.update()
        old, self._images = self._images, []
        loaded: dict[Path, bpy.types.Image] = {}
        for each, source in zip(files, self._work["sources"], strict=True):
            for path in (each.layers, each.denoised):
                if path not in loaded:
                    loaded[path] = self._load(path, source["space"])
        for feed in self._feeds:
            path = files[feed.source].denoised if feed.denoised else files[feed.source].layers
            self._show(feed, loaded[path], path)
        for node, source, layer in self._mattes:
            node.image = loaded[files[source].layers]
            try:
                node.layer_name = layer
            except TypeError:
                raise FrameError(f"{files[source].layers.name} has no Cryptomatte {layer}") from None
        for image in old:
            bpy.data.images.remove(image)

    def _load(self, path: Path, space: str) -> bpy.types.Image:
        try:
            image = bpy.data.images.load(str(path))
        except RuntimeError as error:
            raise FrameError(f"{path.name} does not load: {messages.of_error(error)}") from None
        self._images.append(image)
        image.use_multiview = self._work["views_in_one_file"]
        compat.use_space(image, space)
        # Of files with layers Blender tells no size; that they have the right one was looked up before, in their headers.
        wanted, size = exr.size_if_whole(path), tuple(image.size)
        if wanted is None or (image.type != "MULTILAYER" and size != wanted):
            raise FrameError(f"{path.name} does not load: it is damaged, or being written")
        return image

    def _show(self, feed: _Feed, image: bpy.types.Image, path: Path) -> None:
        node = feed.node
        node.image = image
        try:
            node.layer = feed.layer
        except TypeError:
            # Files of a File Output node have no view layers; those of Blender that lack this one cannot stand in for it.
            if _has_named_layers(path):
                is_known = feed.layer in self._work["sources"][feed.source]["layers"]
                key = "composite_no_layer" if is_known else "composite_node_layer"
                raise FrameError(messages.text(key, file=path.name, layer=feed.layer)) from None
        there = {output.name: output for output in node.outputs}
        lost = []
        for name, to_node, identifier, muted in feed.targets:
            output = next((there[n] for n in _IMAGE_NAMES if n in there), None) if name == "Image" else there.get(name)
            if output is None and name == "Image":
                raise FrameError(f"{path.name} has no image of view layer {feed.layer}")
            if output is None:
                lost.append(name)
                continue
            target = next(socket for socket in feed.tree.nodes[to_node].inputs if socket.identifier == identifier)
            link = feed.tree.links.new(output, target)
            link.is_muted = muted
            if not target.is_linked:
                raise FrameError(f"{path.name}: Blender does not connect {name} to {to_node}")
        if lost:
            self._tell("composite_lost", passes=", ".join(dict.fromkeys(lost)), layer=feed.layer)

    def _tell(self, key: str, **fields: object) -> None:
        text = messages.text(key, **fields)
        if text not in self._warned:
            self._warned.add(text)
            self._warn(text)

    def _set_output(self) -> None:
        render, settings = self._scene.render, self._scene.render.image_settings
        views, space = settings.views_format, settings.linear_colorspace_settings.name
        was_exr = settings.file_format.startswith("OPEN_EXR")
        compat.use_image_format(settings, self._work["format"])
        if was_exr and space and settings.file_format == "OPEN_EXR":
            # Blender 4.5 and newer take it away with the old format.
            settings.linear_colorspace_settings.name = space
        settings.color_mode, settings.color_depth = "RGBA", "16"
        if views == "INDIVIDUAL":
            render.use_multiview = False
        elif render.use_multiview:
            settings.views_format = "STEREO_3D" if settings.file_format == "PNG" else views
        self._path = compat.without_templates(os.path.join(self._work["aside"], "frame_####"))
        render.use_file_extension = render.use_overwrite = render.use_compositing = True
        render.use_placeholder = render.use_sequencer = False
        self._scene.frame_step = 1
        if hasattr(render, "compositor_device"):
            # A process without a window may have no GPU.
            render.compositor_device = "CPU"

    def _build(self, tree: bpy.types.NodeTree, seen: set[bpy.types.NodeTree]) -> None:
        seen.add(tree)
        # The nodes of Hush first: the links from Render Layers to them are not wanted any more.
        for each in list(tree.nodes):
            found = kinds.of_hush(each)
            if found is not None and not each.mute:
                shown = self._work["nodes"].get(kinds.key(tree, each))
                if shown is not None:
                    self._feed_from(tree, each, shown["source"], shown["layer"], denoised=True)
        for each in list(tree.nodes):
            if each.bl_idname == kinds.RENDER_LAYERS:
                self._replace_layers(tree, each)
            elif each.bl_idname == kinds.CRYPTOMATTE and each.source == "RENDER":
                source, layer = self._source_of(each.scene), each.layer_name
                if source is not None and layer.rpartition(".")[0] in self._work["sources"][source]["off"]:
                    self._leave_empty(tree, each)
                elif source is not None:
                    each.source = "IMAGE"
                    self._mattes.append((each, source, layer))
            elif each.bl_idname == _FILE_OUTPUT:
                self._guard_output(each)
            elif kinds.is_undefined(each) and not each.mute:
                self._refuse_unknown(tree, each)
            elif getattr(each, "node_tree", None) is not None and each.bl_idname == "CompositorNodeGroup":
                if each.node_tree.library is not None:
                    each.node_tree = kinds.local_copy(each.node_tree)
                if each.node_tree not in seen:
                    self._build(each.node_tree, seen)

    def _refuse_unknown(self, tree: bpy.types.NodeTree, each: bpy.types.Node) -> None:
        if kinds.key(tree, each) not in self._work["undefined"]:
            raise FrameError(messages.text("composite_addon_node", node=each.name))

    def _source_of(self, scene: bpy.types.Scene | None) -> int | None:
        return self._sources.get((scene or self._scene).name_full)

    def _replace_layers(self, tree: bpy.types.NodeTree, layers: bpy.types.Node) -> None:
        source = self._source_of(layers.scene)
        if source is None and not any(output.is_linked for output in layers.outputs):
            # As where a node of Hush took its image, in a tree that scenes share: Blender would render that scene for nothing.
            tree.nodes.remove(layers)
        elif source is None:
            self._tell("composite_other_scene", scene=layers.scene.name)
        elif layers.mute:
            tree.nodes.remove(layers)
        else:
            self._feed_from(tree, layers, source, layers.layer, denoised=False)

    def _feed_from(self, tree: bpy.types.NodeTree, old: bpy.types.Node, source: int, layer: str, *, denoised: bool) -> None:
        if layer in self._work["sources"][source]["off"]:
            self._tell("composite_layer_off", layer=layer)
            self._leave_empty(tree, old)
        else:
            self._replace(tree, old, source, layer, denoised=denoised)

    def _leave_empty(self, tree: bpy.types.NodeTree, old: bpy.types.Node) -> None:
        """Puts black without alpha in place of a node, as Blender does where a view layer is not rendered."""
        nothing = tree.nodes.new("CompositorNodeRGB").outputs[0]
        nothing.default_value = (0, 0, 0, 0)
        for target, is_muted in [(link.to_socket, link.is_muted) for output in old.outputs for link in output.links]:
            tree.links.new(nothing, target).is_muted = is_muted
        tree.nodes.remove(old)

    def _replace(self, tree: bpy.types.NodeTree, old: bpy.types.Node, source: int, layer: str, *, denoised: bool) -> None:
        """Puts Image nodes in place of another, socket by socket: one, or one for the image and one for light passes that are denoised."""
        targets: dict[bool, list[tuple[str, str, str, bool]]] = {}
        for output in old.outputs:
            shows_denoised = denoised or (self._work["sources"][source]["light_passes"] and output.name not in _OF_IMAGE)
            for link in output.links:
                target = (output.name, link.to_node.name, link.to_socket.identifier, link.is_muted)
                targets.setdefault(shows_denoised, []).append(target)
        tree.nodes.remove(old)
        for shows_denoised, found in targets.items():
            self._feeds.append(_Feed(tree, tree.nodes.new("CompositorNodeImage"), source, layer, shows_denoised, found))

    def _replace_render_input(self) -> RenderInput:
        """Gives the first tree the image of a file, where Blender gives it the render."""
        made, source = RenderInput(self._scene), self._source_of(None)
        if made.socket is not None and source is not None:
            image = made.tree.nodes.new("CompositorNodeImage")
            layer = self._scene.view_layers[0].name
            target = ("Image", made.socket.node.name, made.socket.identifier, False)
            self._feeds.append(_Feed(made.tree, image, source, layer, denoised=False, targets=[target]))
        return made

    def _guard_output(self, each: bpy.types.Node) -> None:
        """A File Output node writes where it did, but never over the frames that the composite is made from."""
        origin, protected = self._work["origin"], self._work["protected"]
        compat.set_folder(each, lambda path: compat.with_folder(kinds.absolute(path, origin), origin))
        if any(paths.place(compat.filled_in(path, self._scene, each)) in protected for path in compat.written_by(each)):
            each.mute = True
            self._tell("composite_outputs", node=each.name)


def _has_named_layers(path: Path) -> bool:
    import hush

    try:
        about = hush.inspect(str(path))
    except (OSError, ValueError, hush.HushError):
        return True
    return any(layer["name"] for layer in about.get("layout", about)["layers"])

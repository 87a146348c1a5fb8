"""For cases about Composite Denoised: scenes with denoised frames and a compositor, and the open file before and after."""

from __future__ import annotations

import shutil
from pathlib import Path

import bpy
import fingerprint
import kit
import numpy as np

compat, composite, contents, job = (kit.module(name) for name in ("compat", "compositing.composite", "compositing.contents", "jobs.job"))


# Composited frames are half float.
HALF = 2e-3


def denoised_scene(name: str, frames: int = 3) -> tuple[bpy.types.Scene, Path]:
    """A scene whose frames are rendered and denoised, and their folder."""
    folder = kit.folder(name)
    for frame in range(1, frames + 1):
        shutil.copy(kit.shot() / f"frame_{frame:04d}.exr", folder)
    scene = kit.build_scene("plain", folder)
    scene.frame_end = frames
    assert bpy.ops.hush.denoise_shot() == {"FINISHED"}
    return scene, folder


def hush_group() -> bpy.types.NodeTree:
    """The group of a node of Hush: passes its input through."""
    group = bpy.data.node_groups.new("Temporal Denoise", "CompositorNodeTree")
    group["hush_form"] = "test"
    for direction in ("INPUT", "OUTPUT"):
        group.interface.new_socket("Image", in_out=direction, socket_type="NodeSocketColor")
    group.links.new(group.nodes.new("NodeGroupInput").outputs[0], group.nodes.new("NodeGroupOutput").inputs[0])
    return group


def tree_of(scene: bpy.types.Scene, *, node: bool = False) -> tuple[bpy.types.NodeTree, bpy.types.Node, bpy.types.NodeSocket]:
    """A compositor tree, its Render Layers node and the socket of the result, connected through a node of Hush if asked."""
    tree = compat.ensure_compositor_tree(scene)
    layers = next(each for each in tree.nodes if each.bl_idname == "CompositorNodeRLayers")
    result = compat.output_node(tree).inputs[0]
    if node:
        ours = tree.nodes.new("CompositorNodeGroup")
        ours.node_tree = hush_group()
        tree.links.new(layers.outputs["Image"], ours.inputs[0])
        tree.links.new(ours.outputs[0], result)
    return tree, layers, result


def combined(path: Path) -> np.ndarray:
    return kit.layer(path, "ViewLayer.Combined", "RGBA")


def plain(path: Path) -> np.ndarray:
    """Pixels of a file with a single image."""
    return np.stack([kit.channels(path)[component] for component in "RGBA"], -1)


def untouched(**arguments: object) -> set[str]:
    """Runs Composite Denoised, and looks that the open file is as it was, also where it is refused."""
    before = fingerprint.take()
    try:
        return bpy.ops.hush.composite_shot(**arguments)
    finally:
        changed = fingerprint.changes(before, fingerprint.take())
        assert not changed, changed
        left = [path.name for path in Path(bpy.app.tempdir).glob("hush-composite-*")]
        assert not left, f"copies are left: {left}"


def refused(*words: str, **arguments: object) -> str:
    """What the error says, with these words in it."""
    return kit.refused(untouched, *words, **arguments)


def rendered_again(folder: Path, name: str) -> None:
    """A frame is rendered again, with other light."""
    kit.rewrite(folder / name, lambda channel, pixels: pixels * 2 if ".Combined." in channel else pixels)

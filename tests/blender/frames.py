"""For cases about the node and the status: denoised frames, and what the compositor makes of them."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import bpy
import kit
import numpy as np
import OpenEXR
import plain
from plain import CHANNELS, render

BLENDER_5 = bpy.app.version >= (5, 0)


def denoise(scene: bpy.types.Scene, frames: list[int] | None = None, **settings: object) -> None:
    """Denoises frames of the scene's shot as Denoise Shot does, all by default."""
    import hush

    for arguments in kit.module("shot").sequences(scene):
        told = hush.denoise_sequence(**arguments | ({"frames": frames} if frames else {}) | settings)
        assert not told["failed"] and told["written"] + told["skipped"] == len(frames or arguments["frames"]), told
    kit.module("status").forget()


def denoised(shot: Path, frame: int, layer: str = "ViewLayer") -> np.ndarray:
    """The pixels of a denoised frame, RGBA."""
    return kit.layer(shot / "denoised" / f"frame_{frame:04d}.exr", f"{layer}.Combined", CHANNELS)


def noisy(shot: Path, frame: int) -> np.ndarray:
    """What Cycles rendered, RGB."""
    return kit.layer(shot / f"frame_{frame:04d}.exr", "Combined")


def scene_with_node(shot: Path, kind: str = "plain") -> tuple[bpy.types.Scene, bpy.types.Node]:
    """The test scene whose compositor has `plain.incoming()`, Temporal Denoise and output; its frames are read from `shot`."""
    scene = kit.build_scene(kind)
    scene.hush.input_folder = str(shot)
    assert bpy.ops.hush.add_node() == {"FINISHED"}
    (node,) = kit.module("nodes.node").nodes(scene)
    put_in(scene, node)
    return scene, node


def put_in(scene: bpy.types.Scene, node: bpy.types.Node) -> None:
    """Puts `plain.incoming()` in the place of Render Layers: exact, and nothing is rendered."""
    path = kit.folder("incoming") / "incoming.exr"
    image = plain.incoming()
    planes = {name: np.ascontiguousarray(image[..., i]) for i, name in enumerate(CHANNELS)}
    OpenEXR.File({"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}, planes).write(str(path))
    tree = node.id_data
    for old in [old for old in tree.nodes if old.bl_idname == "CompositorNodeRLayers"]:
        tree.nodes.remove(old)
    source = tree.nodes.new("CompositorNodeImage")
    source.image = bpy.data.images.load(str(path))
    source.image.colorspace_settings.name = "Linear Rec.709"
    tree.links.new(source.outputs["Image"], node.inputs[0])


@contextmanager
def without_handlers(*names: str) -> Iterator[None]:
    """Takes Hush's handlers out, those of these names or all."""
    taken = []
    for name, function in kit.module("handlers")._HANDLERS:
        if not names or name in names:
            getattr(bpy.app.handlers, name).remove(function)
            taken.append((name, function))
    try:
        yield
    finally:
        for name, function in taken:
            getattr(bpy.app.handlers, name).append(function)


def shown(scene: bpy.types.Scene, frame: int, name: str = "out") -> np.ndarray:
    """What the artist sees at a frame in a window, where the node may show the denoised frame; RGBA."""
    scene.frame_set(frame)
    kit.module("nodes.node").sync(scene)
    with without_handlers():
        return render(scene, frame, kit.folder(name))


def assert_same(image: np.ndarray, expected: np.ndarray, what: str) -> None:
    """Fails unless two images are the same bit for bit."""
    assert image.shape == expected.shape, f"{what}: {image.shape} instead of {expected.shape}"
    different = np.argwhere(image.view(np.uint32) != expected.astype(np.float32).view(np.uint32))
    place = tuple(different[0]) if len(different) else ()
    assert not len(different), f"{what}: {len(different)} values differ, {image[place]} instead of {expected[place]} at {place}"


def assert_incoming(image: np.ndarray, what: str = "the incoming image") -> None:
    """Fails unless the node passed its input through bit for bit."""
    assert_same(image, plain.incoming(), what)

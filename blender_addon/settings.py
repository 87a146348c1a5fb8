"""The settings as the library declares them. Generated from src/settings/table.rs."""

from __future__ import annotations

from typing import NamedTuple


class Setting(NamedTuple):
    """One setting: what it does, its default in words, and the range of a number."""

    help: str
    default: str
    least: float | None = None
    most: float | None = None


SETTINGS: dict[str, Setting] = {
    "enable": Setting("Denoise the shot at all; true denoises also where other settings of the shot say false", "true"),
    "input": Setting("The frames: a folder, a pattern such as render/frame_####.exr, a glob or a file", "the folder or pattern named"),
    "output": Setting("Folder for the denoised frames; never the one with the inputs", "none"),
    "frames": Setting("Frames to write, such as 1-48,60; frames beside them still help", "all"),
    "lambda": Setting("How much noise and hidden detail to keep, from 1 (cleanest) to 64; 1:1,24:8 goes from 1 at frame 1 to 8 at frame 24", "1", 1, 64),
    "window": Setting("Frames on each side that help, 0 to 3", "2 with a Vector pass, else 0", 0, 3),
    "layers": Setting("View layers to denoise, or all", "the one with the most samples"),
    "view": Setting("Stereo view to denoise", "all"),
    "vector_layer": Setting("View layer to take the Vector pass from, such as one without motion blur", "Hush Vectors where the file holds it, else the layer denoised"),
    "aovs": Setting("Light passes to denoise along, such as \"Diffuse Direct\", or all, or none", "none"),
    "guides": Setting("Guides that may be used, of albedo, normal, depth, vector, or none; without vector no neighbour helps", "albedo, normal, depth, vector"),
    "passes.beauty": Setting("The beauty's name in the files: R, G, B and perhaps A", "Combined"),
    "passes.albedo": Setting("The albedo's name in the files: R, G, B", "Denoising Albedo"),
    "passes.normal": Setting("The normals' name in the files: X, Y, Z or R, G, B", "Denoising Normal"),
    "passes.depth": Setting("The depth's name in the files: one channel", "Denoising Depth, Depth"),
    "passes.vector": Setting("The motion vectors' name in the files: X, Y, Z, W as Cycles has them", "Vector"),
    "keep_noisy": Setting("Keep the input beside the result as Noisy Image", "false"),
    "skip": Setting("The rules by which work may be left out, of constant, opaque, untrusted, still, or none", "constant, opaque, untrusted, still"),
    "model": Setting("Other weights, a safetensors file", "in the program"),
    "renderer": Setting("What made the frames, one that the weights have an encoder for: cycles or mitsuba", "cycles"),
    "memory": Setting("Memory for the frames in the window and the computing, such as 4G; less is slower and gives the same pixels", "3.1G"),
    "threads": Setting("Threads for computing; any number gives the same pixels", "all cores", 1, 4096),
}

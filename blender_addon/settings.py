# SPDX-FileCopyrightText: 2026 Hush authors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The settings of a shot, by their names in hush.toml. Generated from src/settings/table.rs: not changed by hand."""

from typing import NamedTuple


class Setting(NamedTuple):
    """A setting: what it does; its default, None where that is not one value; the least and the most, None where it is no number."""

    help: str
    default: object
    least: float | None
    most: float | None


SETTINGS: dict[str, Setting] = {
    "enable": Setting(
        "Denoise the shot at all; true denoises also where other settings of the shot say false",
        default=True,
        least=None,
        most=None,
    ),
    "input": Setting(
        "The frames: a folder, a pattern such as render/frame_####.exr, a glob or a file",
        default=None,
        least=None,
        most=None,
    ),
    "output": Setting(
        "Folder for the denoised frames; never the one with the inputs",
        default=None,
        least=None,
        most=None,
    ),
    "frames": Setting(
        "Frames, such as 1-48,60; those beside them still help",
        default=None,
        least=None,
        most=None,
    ),
    "lambda": Setting(
        "How much noise and hidden detail to keep, from 1 (cleanest) to 64; 1:1,24:8 goes from 1 at frame 1 to 8 at frame 24",
        default=1,
        least=1,
        most=64,
    ),
    "lambda_masked": Setting(
        "The lambda of what a mask marks, where lambda pass or lambda images name one; may change over the shot as lambda does",
        default=16,
        least=1,
        most=64,
    ),
    "lambda_pass": Setting(
        "The pass that is the mask, such as a shader AOV: 0 keeps lambda, 1 has lambda masked, between them both are mixed",
        default=None,
        least=None,
        most=None,
    ),
    "lambda_images": Setting(
        "Images that are the mask, such as masks/mask_####.exr, instead of a pass",
        default=None,
        least=None,
        most=None,
    ),
    "window": Setting(
        "Frames on each side that help, 0 to 3",
        default=None,
        least=0,
        most=3,
    ),
    "layers": Setting(
        "View layers to denoise, or all",
        default=None,
        least=None,
        most=None,
    ),
    "view": Setting(
        "Stereo view to denoise",
        default=None,
        least=None,
        most=None,
    ),
    "vector_layer": Setting(
        "View layer to take the Vector pass from, such as one without motion blur",
        default=None,
        least=None,
        most=None,
    ),
    "aovs": Setting(
        'Light passes to denoise along, such as "Diffuse Direct", or all, or none',
        default=None,
        least=None,
        most=None,
    ),
    "guides": Setting(
        "Guides that may be used, of albedo, normal, depth, vector, or none; without vector no neighbour helps",
        default=None,
        least=None,
        most=None,
    ),
    "passes.beauty": Setting(
        "The beauty's name in the files: R, G, B and perhaps A",
        default=None,
        least=None,
        most=None,
    ),
    "passes.albedo": Setting(
        "The albedo's name in the files: R, G, B",
        default=None,
        least=None,
        most=None,
    ),
    "passes.normal": Setting(
        "The normals' name in the files: X, Y, Z or R, G, B",
        default=None,
        least=None,
        most=None,
    ),
    "passes.depth": Setting(
        "The depth's name in the files: one channel",
        default=None,
        least=None,
        most=None,
    ),
    "passes.vector": Setting(
        "The motion vectors' name in the files: X, Y, Z, W as Cycles has them",
        default=None,
        least=None,
        most=None,
    ),
    "keep_noisy": Setting(
        "Keep the input beside the result as Noisy Image",
        default=False,
        least=None,
        most=None,
    ),
    "skip": Setting(
        "The rules by which work may be left out, of constant, opaque, untrusted, still, or none",
        default=None,
        least=None,
        most=None,
    ),
    "second_pass": Setting(
        "A second pass over time, which averages each result with those around it: a little less flicker, from twice the frames around",
        default=False,
        least=None,
        most=None,
    ),
    "model": Setting(
        "Other weights, a safetensors file",
        default=None,
        least=None,
        most=None,
    ),
    "renderer": Setting(
        "What made the frames, one that the weights have an encoder for: cycles or mitsuba",
        default=None,
        least=None,
        most=None,
    ),
    "memory": Setting(
        "Memory for the frames in the window and the computing, such as 4G; less is slower and gives the same pixels",
        default=None,
        least=None,
        most=None,
    ),
    "threads": Setting(
        "Threads for computing; any number gives the same pixels",
        default=None,
        least=1,
        most=4096,
    ),
}

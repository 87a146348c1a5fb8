"""The keyword arguments that are settings of a shot. Generated from src/settings/table.rs."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from typing import Literal, TypedDict

Path = str | os.PathLike[str]


class ShotSettings(TypedDict, total=False):
    """What to read of a shot and how to compute: the keyword arguments of every function that takes a shot.

    What is not given, or None, is what the shot's own settings say: `hush.toml` beside the frames, and the USD stage that it names;
    else the default. What is given here wins.
    """

    settings: Path | Literal[False] | None
    """Another settings file than the one beside the frames; False for none."""
    usd: Path | None
    """A USD stage to take settings from, `shot.usda` or `shot.usda@/Render/Pass`, in place of the one that the settings file names."""
    enable: bool | None
    """Denoise the shot at all; true denoises also where other settings of the shot say false. Default: true."""
    lambda_masked: float | Mapping[int, float] | None
    """The lambda of what a mask marks, where lambda pass or lambda images name one; may change over the shot as lambda does: a
    number, or a mapping from frame number to it. Default: 16."""
    lambda_pass: str | None
    """The pass that is the mask, such as a shader AOV: 0 keeps lambda, 1 has lambda masked, between them both are mixed. Default:
    none."""
    lambda_images: Path | None
    """Images that are the mask, such as masks/mask_####.exr, instead of a pass. Default: none."""
    layers: str | Sequence[str] | None
    """View layers to denoise, or all. Default: the one with the most samples."""
    view: str | None
    """Stereo view to denoise. Default: all."""
    vector_layer: str | None
    """View layer to take the Vector pass from, such as one without motion blur. Default: Hush Vectors where the file holds it, else
    the layer denoised."""
    aovs: str | Sequence[str] | None
    """Light passes to denoise along, such as "Diffuse Direct", or all, or none. Default: none."""
    guides: str | Sequence[str] | None
    """Guides that may be used, of albedo, normal, depth, vector, or none; without vector no neighbour helps. Default: albedo,
    normal, depth, vector."""
    passes: Mapping[str, str] | None
    """What the passes are called where not as Blender calls them, by beauty, albedo, normal, depth, vector. Default: Blender's
    names."""
    skip: str | Sequence[str] | None
    """The rules by which work may be left out, of constant, opaque, untrusted, still, or none. Default: constant, opaque,
    untrusted, still."""
    second_pass: bool | None
    """A second pass over time, which averages each result with those around it: a little less flicker, from twice the frames
    around. Default: false."""
    model: Path | None
    """Other weights, a safetensors file. Default: in the program."""
    renderer: str | None
    """What made the frames, one that the weights have an encoder for: cycles or mitsuba. Default: cycles."""
    memory: int | str | None
    """Memory for the frames in the window and the computing, such as 4G; less is slower and gives the same pixels. Default: 3.1G."""
    threads: int | None
    """Threads for computing; any number gives the same pixels. Default: all cores."""


class SequenceSettings(ShotSettings, total=False):
    """How a shot is denoised: `ShotSettings`, and which frames are made how."""

    frames: str | Iterable[int] | None
    """Frames, such as 1-48,60; those beside them still help. Default: all."""
    lam: float | Mapping[int, float] | None
    """How much noise and hidden detail to keep, from 1 (cleanest) to 64, or a mapping from frame number to it: linear between its
    keys, constant before the first and after the last. Default: 1."""
    window: int | None
    """Frames on each side that help, 0 to 3. Default: 2 with a Vector pass, else 0."""
    keep_noisy: bool | None
    """Keep the input beside the result as Noisy Image. Default: false."""
    overwrite: bool
    """Write every frame again, also over files that Hush did not write; default False."""
    strict: bool
    """Stop at the first bad or missing frame; default False."""

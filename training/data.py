"""Reads the rendered shots and turns them into what the network takes."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import torch
from geometry import Chain, chain, depth_scale, exposure, neighbour
from model import BRIGHTEST
from torch import Tensor

OFFSETS = (-1, 1, -2, 2)
FARTHEST = 3


@dataclass
class Shot:
    """The n frames of a shot, 5 or 7.

    colour, albedo, normal (n, 3, H, W), depth (n, 1, H, W), vector (n, 4, H, W); references: frame → (3, H, W), the middle one and
    in some shots the one before; paths: (frame, offset) → `geometry.chain`, filled as they are asked for.
    """

    seed: int
    spp: int
    colour: Tensor
    albedo: Tensor
    normal: Tensor
    depth: Tensor
    vector: Tensor
    references: dict[int, Tensor]
    meta: dict[str, object] = field(default_factory=dict)
    paths: dict[tuple[int, int], Chain] = field(default_factory=dict)

    @property
    def centre(self) -> int:
        return len(self.depth) // 2

    @property
    def reference(self) -> Tensor:
        return self.references[self.centre]

    def path(self, frame: int, offset: int) -> Chain:
        """Where frame's pixels lie in frame + offset."""
        if (frame, offset) not in self.paths:
            vectors = {k - frame: self.vector[k] for k in range(len(self.vector))}
            self.paths[frame, offset] = chain(vectors, offset)
        return self.paths[frame, offset]

    def window(self, frame: int, reach: int = FARTHEST) -> list[int]:
        """The offsets of the frame's neighbours that the shot has, at most `reach` away."""
        return [k for k in range(-reach, reach + 1) if k != 0 and 0 <= frame + k < len(self.depth)]


def read_shot(path: Path) -> Shot:
    with np.load(path) as z:
        meta = json.loads(str(z["meta"]))
        image = lambda name: torch.from_numpy(np.moveaxis(z[name].astype(np.float32), -1, -3).copy())
        middle = len(z["depth"]) // 2
        references = {middle: image("ref")} | ({middle - 1: image("ref_before")} if "ref_before" in z else {})
        return Shot(
            seed=meta["seed"],
            spp=meta["spp"],
            colour=image("color"),
            albedo=image("albedo") / 255.0,
            normal=image("normal") / 127.0,
            depth=torch.from_numpy(z["depth"].astype(np.float32))[:, None],
            vector=image("vector"),
            references=references,
            meta=meta,
        )


def is_held(path: Path) -> bool:
    """Whether a shot is for validation: a seed divisible by 8 is never trained on."""
    return int(path.stem) % 8 == 0


def shot_paths(folders: Sequence[Path]) -> list[Path]:
    return sorted((path for folder in folders for path in folder.glob("[0-9]*.npz") if path.stem.isdigit()), key=lambda p: p.stem)


def read_split(folders: Sequence[Path]) -> tuple[list[Shot], list[Shot]]:
    """Training shots and validation shots of some folders."""
    paths = shot_paths(folders)
    return [read_shot(p) for p in paths if not is_held(p)], [read_shot(p) for p in paths if is_held(p)]


def oriented(shot: Shot, flip_x: bool, flip_y: bool, transpose: bool) -> Shot:
    """The shot mirrored; normals (camera space, y up), vectors (y up) and paths turn with the image."""
    images = [shot.colour, shot.albedo, shot.depth, shot.normal, shot.vector, *shot.references.values()]
    paths = dict(shot.paths)
    high, wide = shot.depth.shape[-2] - 1.0, shot.depth.shape[-1] - 1.0
    for wanted, dims in ((flip_x, -1), (flip_y, -2)):
        if not wanted:
            continue
        images = [torch.flip(x, (dims,)) for x in images]
        axis = -1 - dims
        images[3][:, axis] *= -1
        images[4][:, axis] *= -1
        images[4][:, axis + 2] *= -1
        for key, path in paths.items():
            position, trust, miss = (torch.flip(x, (dims,)) for x in path)
            position[axis] = (wide, high)[axis] - position[axis]
            paths[key] = position, trust, miss
    if transpose:
        images = [x.transpose(-1, -2) for x in images]
        n, v = images[3], images[4]
        images[3] = torch.stack((-n[:, 1], -n[:, 0], n[:, 2]), 1)
        images[4] = torch.stack((-v[:, 1], -v[:, 0], -v[:, 3], -v[:, 2]), 1)
        paths = {k: (p.transpose(-1, -2).flip(0), t.transpose(-1, -2), m.transpose(-1, -2)) for k, (p, t, m) in paths.items()}
    colour, albedo, depth, normal, vector, *references = images
    turned = dict(zip(shot.references, references, strict=True))
    return Shot(shot.seed, shot.spp, colour, albedo, normal, depth, vector, turned, shot.meta, paths)


@dataclass(frozen=True)
class Guides:
    """Which guide passes the network gets to see."""

    albedo: bool = True
    normal: bool = True
    depth: bool = True


ALL_GUIDES = Guides()


@dataclass
class Frames:
    """What the network takes of each frame by itself: inputs (n, 10, H, W), colour demodulated and albedo plus ε (n, 3, H, W), depth
    scaled (n, 1, H, W), valid (n, 1, H, W), exposure (n,)."""

    inputs: Tensor
    colour: Tensor
    albedo: Tensor
    depth: Tensor
    valid: Tensor
    exposure: Tensor


def frames(shot: Shot, guides: Guides = ALL_GUIDES, epsilon: float = 0.05, valid: Tensor | None = None) -> Frames:
    """The frames of a shot, sanitised and scaled. valid (n, 1, H, W) in {0, 1} marks pixels that may be used; all where it is None."""
    valid = torch.ones_like(shot.depth) if valid is None else valid
    albedo = shot.albedo.clamp(0, 1)
    modulation = albedo + epsilon if guides.albedo else torch.ones_like(albedo)
    colour = shot.colour.clamp_min(0) / modulation
    scale = lambda of: torch.tensor(of).view(-1, 1, 1, 1)
    pairs = lambda planes: zip(planes, valid, strict=True)
    exposures = [exposure(c, v[0]) for c, v in pairs(shot.colour)]
    seen = colour * scale(exposures)
    if guides.depth:
        front = torch.where((shot.depth > 0) & (shot.depth < 1e9), shot.depth, 0.0)
        depth = front * scale([depth_scale(z, v) for z, v in pairs(shot.depth)])
    else:
        depth = torch.zeros_like(shot.depth)
    parts = (
        torch.log1p(seen.clamp(max=BRIGHTEST)),
        albedo if guides.albedo else torch.zeros_like(albedo),
        shot.normal if guides.normal else torch.zeros_like(shot.normal),
        torch.log1p(depth),
    )
    return Frames(torch.cat(parts, 1), colour, modulation, depth, valid, torch.tensor(exposures))


def view(shot: Shot, of: Frames, centre: int, offsets: Sequence[int]) -> dict[str, Tensor]:
    """What `Hush.denoise` takes of one centre frame and its neighbours, without the batch dimension; the target if there is one."""
    around = [
        neighbour(
            shot.path(centre, k), k, of.colour[centre + k], of.albedo[centre + k], of.depth[centre + k], of.valid[centre + k],
            (of.albedo[centre], of.depth[centre]),
        )
        for k in offsets
    ]  # fmt: skip
    h, w = of.valid.shape[-2:]
    pick = lambda name, empty: torch.stack([n[name] for n in around]) if around else torch.zeros(0, *empty)
    made = {
        "colour": torch.cat((of.colour[centre][None], pick("colour", (3, h, w)))),
        "albedo": torch.cat((of.albedo[centre][None], pick("albedo", (3, h, w)))),
        "valid": torch.cat((of.valid[centre][None], pick("valid", (1, h, w)))),
        "position": pick("position", (2, h // 2, w // 2)),
        "extras": pick("extras", (7, h // 2, w // 2)),
        "noisy": shot.colour[centre].clamp_min(0),
        "exposure": of.exposure[centre],
    }
    if centre in shot.references:
        reference = shot.references[centre].clamp_min(0)
        made |= {"reference": reference, "gain": 0.4 / reference.mean().clamp_min(1e-6), "effort": torch.tensor((shot.spp / 8) ** 0.25)}
    return made


def prepare(
    shot: Shot,
    offsets: Sequence[int] = OFFSETS,
    guides: Guides = ALL_GUIDES,
    epsilon: float = 0.05,
    valid: Tensor | None = None,
) -> dict[str, Tensor]:
    """A shot's middle frame and its neighbours as `Hush.forward` takes them, without the batch dimension."""
    of = frames(shot, guides, epsilon, valid)
    order = [shot.centre, *(shot.centre + k for k in offsets)]
    return {"inputs": of.inputs[order], **view(shot, of, shot.centre, offsets)}

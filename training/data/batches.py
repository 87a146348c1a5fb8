"""Draws training batches: which shots, how they are changed, what the network sees of them."""

from __future__ import annotations

import random
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from training.data import lambda_maps
from training.data.augment import composed, oriented, recoloured, relit
from training.data.inputs import Guides, frames, of_frames, path, view
from training.data.resident import Crop, Pool, Resident
from training.data.shots import FARTHEST, OFFSETS, Shot

View = dict[str, Tensor]
SEEN = (0.95, 0.94, 0.94)  # of the examples see albedo, normal, depth


@dataclass(frozen=True)
class Recipe:
    """How batches are drawn. Shares are of the batches where not said otherwise."""

    outputs: int = 4  # denoised frames of a batch with neighbours
    crop: int = 128  # side of the square that is taken of each frame
    whole: float = 0.25  # share, of larger shots, that are taken whole instead, in smaller batches
    alone: float = 0.35  # without neighbours
    paired: float = 0.5  # of two frames in a row, for the temporal loss, where shots have references of both
    farther: float = 0.15  # with four neighbours out of ±1 to ±3 instead of ±1 and ±2, where shots have them
    composed: float = 0.15  # of shots in front of others
    relit: float = 0.6  # of the examples of shots with two parts of light are seen under another
    lambda_maps: float = 0.3  # of the examples have a λ that varies inside the frame; 0 gives λ as (B,), else as maps
    epsilon: float = 0.05  # that is added to the albedo: the architecture's
    turned: bool = False  # normals in a world that is turned at random, for renderers that give them in world space


@dataclass
class Batch:
    """B examples: `inputs` (B, F, 10, H, W) of the frames to encode; of each of the denoised frames, the later one first, what
    `Hush.denoise` takes, and which of the F frames it sees, its own first; λ, (B,) or (B, 1, H, W).

    A pair's first view has also `before` (B, 2, H, W), where its pixels were in the frame before, and `followed` (B, 1, H, W) in {0, 1}.
    """

    inputs: Tensor
    views: list[View]
    orders: list[list[int]]
    lam: Tensor


def reach_of(frames: int, centre: int, offsets: Sequence[int]) -> list[int]:
    """A frame sees its neighbours as far as the shot reaches, and mirrors the rest."""
    return [k if 0 <= centre + k < frames else -k for k in offsets]


def looked_at(shot: Shot, guides: Guides, centres: Sequence[int], offsets: Sequence[int], epsilon: float) -> Batch:
    """Frames of a batch of shots as a batch, with nothing drawn at random; λ 1.

    centres: the frames to denoise; two of them, the later one first, are a pair. epsilon: the architecture's `albedo_epsilon`.
    """
    of = frames(shot, guides, epsilon)
    reaches = [reach_of(len(shot), centre, offsets) for centre in centres]
    seen = [[centre, *(centre + k for k in reach)] for centre, reach in zip(centres, reaches, strict=True)]
    # All frames of a pair, whichever it sees: batches of a kind have one shape.
    needed = sorted(set(seen[0])) if len(centres) == 1 else list(range(len(shot)))
    views = [view(shot, of, centre, reach) for centre, reach in zip(centres, reaches, strict=True)]
    if len(centres) > 1:
        position, trust, _ = path(shot, centres[0], -1)
        views[0] |= {"before": position.nan_to_num(0.0), "followed": trust.unsqueeze(-3).float()}
    orders = [[needed.index(k) for k in order] for order in seen]
    return Batch(of_frames(of.inputs, needed), views, orders, torch.ones(len(shot.colour), device=shot.colour.device))


def rotations(count: int, generator: torch.Generator) -> Tensor:
    """Random rotations (B, 3, 3): half of them of any kind, half about the y axis."""
    q = torch.randn(count, 4, generator=generator, device=generator.device)
    about_y = torch.rand(count, generator=generator, device=generator.device) < 0.5
    q[:, 1::2] *= ~about_y[:, None]
    w, x, y, z = (q / q.norm(dim=1, keepdim=True).clamp_min(1e-6)).unbind(1)
    rows = (
        (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )
    return torch.stack([torch.stack(row, 1) for row in rows], 1)


class Batches:
    """Draws batches from the shots in a device's memory. Everything of a batch but its kind is drawn on the device."""

    def __init__(self, shots: Resident, recipe: Recipe, seed: int) -> None:
        self.shots, self.recipe = shots, recipe
        self.random = random.Random(seed)
        self.generator = torch.Generator(shots.device).manual_seed(seed)

    def rand(self, *shape: int) -> Tensor:
        return torch.rand(*shape, generator=self.generator, device=self.shots.device)

    def pool(self, paired: bool) -> Pool:
        """Any pool, by how many frames with references and how many crops it has; among those with pairs, where there are."""
        pools = list(self.shots.pools.values())
        pools = [p for p in pools if len(p.referenced) > 1] if paired else pools
        area = lambda p: max(1.0, p.size[0] * p.size[1] / self.recipe.crop**2)
        return self.random.choices(pools, [len(p) * len(p.referenced) * area(p) for p in pools])[0]

    def larger(self, pool: Pool) -> bool:
        return min(pool.size) > self.recipe.crop

    def square(self, pool: Pool) -> Crop:
        """A random square of a larger frame, at even rows and columns."""
        (h, w), size = pool.size, self.recipe.crop
        return Crop(2 * self.random.randint(0, (h - size) // 2), 2 * self.random.randint(0, (w - size) // 2), size)

    def offsets(self, pool: Pool, centre: int) -> list[int]:
        """±1 and ±2; sometimes four of up to ±3."""
        near = [k for k in range(-FARTHEST, FARTHEST + 1) if k and 0 <= centre + k < pool.frames]
        farther = len(near) > len(OFFSETS) and self.random.random() < self.recipe.farther
        return self.random.sample(near, len(OFFSETS)) if farther else list(OFFSETS)

    def draw(self) -> Batch:
        """The next batch."""
        r, recipe = self.random, self.recipe
        alone = r.random() < recipe.alone
        paired = r.random() < recipe.paired and any(len(p.referenced) > 1 for p in self.shots.pools.values())
        pool = self.pool(paired)
        whole = not self.larger(pool) or r.random() < recipe.whole
        return self.draw_of(pool, alone, paired, whole)

    def each_kind(self) -> Iterator[Batch]:
        """A batch of every form that `draw` gives but those of farther neighbours, which are as large."""
        for pool in self.shots.pools.values():
            for paired in (False, True) if len(pool.referenced) > 1 else (False,):
                for alone in (False, True):
                    for whole in (False, True) if self.larger(pool) else (True,):
                        yield self.draw_of(pool, alone, paired, whole)

    def draw_of(self, pool: Pool, alone: bool, paired: bool, whole: bool) -> Batch:
        """A batch of one kind from one pool."""
        r, recipe = self.random, self.recipe
        centres = sorted(pool.referenced[-2:], reverse=True) if paired else [r.choice(pool.referenced)]
        offsets = [] if alone else self.offsets(pool, centres[0])
        seen = [c + k for c in centres for k in (0, *reach_of(pool.frames, c, offsets))]
        plain = alone or tuple(offsets) == OFFSETS
        first, last = (min(seen), max(seen)) if plain else (0, pool.frames - 1)
        crop = None if whole else self.square(pool)
        area = 1.0 if crop else max(1.0, pool.size[0] * pool.size[1] / recipe.crop**2)
        # A frame without neighbours costs a third of one with four.
        count = max(1, round(recipe.outputs * (2 if alone else 1) / len(centres) / area))
        take = lambda: torch.randint(pool.takes, (count,), generator=self.generator, device=self.shots.device)
        some = lambda: relit(pool.shots(self.indices(len(pool), count), take(), first, last, crop), recipe.relit, self.generator)
        shot = some()
        if r.random() < recipe.composed:
            shot = composed(shot, some(), self.generator)
        shot = oriented(recoloured(shot, self.generator), r.random() < 0.5, r.random() < 0.5, r.random() < 0.5)
        if recipe.turned:
            shot.normal = torch.einsum("bij,btjhw->btihw", rotations(count, self.generator), shot.normal)
        guides = Guides(*((self.rand(count) < share).float() for share in SEEN))
        batch = looked_at(shot, guides, [c - first for c in centres], offsets, recipe.epsilon)
        if offsets:
            self.drop_neighbours(batch.views, count, len(offsets))
        constant = lambda_maps.constants(count, self.generator)
        now = centres[0] - first
        maps = lambda: lambda_maps.maps(constant, recipe.lambda_maps, shot.albedo[:, now], shot.normal[:, now], self.generator)
        batch.lam = maps() if recipe.lambda_maps else constant
        return batch

    def indices(self, shots: int, count: int) -> Tensor:
        """Different ones as far as there are."""
        if count > shots:
            return torch.randint(shots, (count,), generator=self.generator, device=self.shots.device)
        return torch.randperm(shots, generator=self.generator, device=self.shots.device)[:count]

    def drop_neighbours(self, views: list[View], count: int, neighbours: int) -> None:
        """12 % of the examples lose all neighbours, in another 18 % each is lost with probability ½."""
        drop = self.rand(count)
        share = torch.where(drop < 0.12, 0.0, torch.where(drop < 0.3, 0.5, 1.0))
        keep = (self.rand(count, neighbours) < share[:, None]).float().view(count, neighbours, 1, 1, 1)
        for seen in views:
            seen["extras"] = torch.cat((seen["extras"][:, :, :6] * keep, seen["extras"][:, :, 6:]), 2)
            for name in ("valid", "colour", "albedo"):
                seen[name] = torch.cat((seen[name][:, :1], seen[name][:, 1:] * keep), 1)

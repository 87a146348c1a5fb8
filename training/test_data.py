"""Batches on a device are what one shot gives, and what is drawn at random stays true: python -m pytest training"""

from __future__ import annotations

import itertools

import pytest
import torch
from torch import Tensor

from training.data import lambda_maps
from training.data.augment import composed, oriented, recoloured, relit
from training.data.batches import Batches, Recipe, looked_at, rotations
from training.data.geometry import chain, exposure
from training.data.inputs import ALL_GUIDES, Guides, frames, prepare, view
from training.data.resident import Crop, Resident
from training.data.shots import OFFSETS, Shot
from training.example_shots import moving_shot, noise

EPSILON = Recipe().epsilon
CPU = torch.device("cpu")
TURNS = list(itertools.product((False, True), repeat=3))


def resident(*shots: Shot) -> Resident:
    found = Resident(CPU)
    found.add(shots)
    return found


def chosen(index: list[int]) -> Tensor:
    return torch.tensor(index)


def same(batch: dict[str, Tensor], at: int, one: dict[str, Tensor], names: list[str] | None = None) -> None:
    """Whether an example of a batch is what one shot gives; sums run in another order there, so not bit by bit."""
    for name in names or one:
        torch.testing.assert_close(batch[name][at], one[name], rtol=2e-6, atol=2e-6)


@pytest.mark.parametrize("turn", TURNS)
@pytest.mark.parametrize("offsets", [OFFSETS, (), (-3, 1, 2, 3)])
def test_batches_are_what_single_shots_give(turn: tuple[bool, bool, bool], offsets: tuple[int, ...]) -> None:
    shots = [moving_shot(seed=k) for k in (1, 2, 3)]
    (pool,) = resident(*shots).pools.values()
    batch = oriented(pool.shots(chosen([2, 0]), chosen([0, 0]), 0, 6), *turn)
    guides = Guides(chosen([1.0, 0.0]), chosen([0.0, 1.0]), chosen([1.0, 1.0]))
    made = looked_at(batch, guides, [3], offsets, EPSILON)
    for at, (k, seen) in enumerate(((2, Guides(normal=False)), (0, Guides(albedo=False)))):
        alone = prepare(oriented(shots[k], *turn), offsets, seen)
        order = torch.tensor(made.orders[0])
        torch.testing.assert_close(made.inputs[at][order], alone.pop("inputs"), rtol=2e-6, atol=2e-6)
        same(made.views[0], at, alone)
        assert offsets == () or 0.2 < float(alone["valid"][1:].mean()) < 1.0


def test_a_pair_sees_what_each_of_its_frames_sees_and_where_the_first_was() -> None:
    shot = moving_shot()
    (pool,) = resident(shot).pools.values()
    pair = looked_at(pool.shots(chosen([0]), chosen([0]), 0, 5), ALL_GUIDES, [3, 2], OFFSETS, EPSILON)
    of = frames(shot)
    for seen, order, centre in zip(pair.views, pair.orders, (3, 2), strict=True):
        same(seen, 0, view(shot, of, centre, OFFSETS))
        assert order == [centre, *(centre + k for k in OFFSETS)]
    position, trust, _ = chain({k - 3: shot.vector[k] for k in range(7)}, -1)
    torch.testing.assert_close(pair.views[0]["before"][0], position)
    assert torch.equal(pair.views[0]["followed"][0, 0], trust.float())


def test_a_shorter_shot_mirrors_the_neighbours_that_it_lacks() -> None:
    (pool,) = resident(moving_shot(count=5, references=(2, 1))).pools.values()
    pair = looked_at(pool.shots(chosen([0]), chosen([0]), 0, 4), ALL_GUIDES, [2, 1], OFFSETS, EPSILON)
    assert pair.orders == [[2, 1, 3, 0, 4], [1, 0, 2, 3, 3]]


def test_turned_vectors_lead_to_turned_positions() -> None:
    shot = moving_shot()
    plain = chain({k - 3: shot.vector[k] for k in range(7)}, 2)
    for turn in TURNS:
        turned = oriented(shot, *turn)
        position, trust, _ = chain({k - 3: turned.vector[k] for k in range(7)}, 2)
        expected, at = plain[0], torch.stack(plain[:2][1:])
        for wanted, axis in ((turn[0], 0), (turn[1], 1)):
            if wanted:
                expected, at = torch.flip(expected, (-1 - axis,)).clone(), torch.flip(at, (-1 - axis,))
                expected[axis] = expected.shape[-1 - axis] - 1.0 - expected[axis]
        if turn[2]:
            expected, at = expected.transpose(-1, -2).flip(0), at.transpose(-1, -2)
        near = (position - expected).abs().amax(0) < 1e-3
        assert near.float().mean() > 0.99, "only rounding may choose another pixel"
        assert (trust == at[0])[near].float().mean() > 0.99


def test_a_crop_is_the_shot_cut_out() -> None:
    shot = moving_shot(rows=48, columns=48)
    (pool,) = resident(shot).pools.values()
    crop = Crop(6, 14, 32)
    batch = pool.shots(chosen([0]), chosen([0]), 0, 6, crop)
    cut = lambda x: crop.of(x)
    part = Shot(1, 4, *(cut(getattr(shot, name)) for name in ("colour", "albedo", "normal", "depth", "vector")), {3: cut(shot.reference)})
    same(looked_at(batch, ALL_GUIDES, [3], OFFSETS, EPSILON).views[0], 0, {k: v for k, v in prepare(part).items() if k != "inputs"})


def test_each_take_keeps_its_noise_and_its_samples() -> None:
    shot = moving_shot(takes=3, parted=True)
    (pool,) = resident(shot).pools.values()
    batch = pool.shots(chosen([0, 0, 0]), chosen([2, 0, 1]), 0, 6)
    for at, number in enumerate((2, 0, 1)):
        take = shot.of_take(number)
        for name in ("colour", "albedo", "normal", "depth", "part"):
            torch.testing.assert_close(getattr(batch, name)[at], getattr(take, name))
        assert batch.spp[at] == take.spp
    assert not torch.equal(shot.takes[0].colour, shot.takes[1].colour)


def test_shots_that_come_later_join_their_like() -> None:
    found = resident(moving_shot(seed=1), moving_shot(seed=2, count=5, references=(2,)))
    found.add([moving_shot(seed=3)])
    assert found.seeds == [1, 2, 3]
    assert sorted(len(pool) for pool in found.pools.values()) == [1, 2]
    pool = max(found.pools.values(), key=len)
    torch.testing.assert_close(pool.shots(chosen([1]), chosen([0]), 0, 6).vector[0], moving_shot(seed=3).vector)


def test_exposure_of_a_stack_is_that_of_its_frames() -> None:
    colour, valid = noise(4, 3, 19, 45) * 5, (noise(4, 1, 19, 45, seed=2) > 0.2).float()
    colour[2], colour[3, 0, 3, 3] = 0.0, 1e6
    together = exposure(colour, valid)
    for k in range(4):
        torch.testing.assert_close(together[k], exposure(colour[k], valid[k]))
    assert together[2] == 1.0


def test_light_below_0_counts_as_none() -> None:
    shot = moving_shot()
    shot.colour = shot.colour - 1
    black = moving_shot()
    black.colour = shot.colour.clamp_min(0)
    assert float((shot.colour < 0).float().mean()) > 0.2
    for one, other in zip(vars(frames(shot)).values(), vars(frames(black)).values(), strict=True):
        assert torch.equal(one, other)


def test_each_composed_pixel_is_of_one_of_the_two() -> None:
    shots = [moving_shot(seed=k) for k in (1, 2)]
    (pool,) = resident(*shots).pools.values()
    front, behind = (pool.shots(chosen([k]), chosen([0]), 0, 6) for k in (0, 1))
    made = composed(front, behind, torch.Generator().manual_seed(3))
    is_front = (made.colour == front.colour).all(2, keepdim=True)
    share = float(is_front.float().mean())
    assert 0.05 < share < 0.75
    for name in ("albedo", "normal", "vector", "depth"):
        assert torch.equal(torch.where(is_front, getattr(made, name), 0), torch.where(is_front, getattr(front, name), 0)), name
    for name in ("albedo", "normal", "vector"):
        assert torch.equal(torch.where(is_front, 0, getattr(made, name)), torch.where(is_front, 0, getattr(behind, name))), name
    moved = (made.depth - behind.depth)[~is_front & (behind.depth > 0)]
    assert moved.min() > 0
    torch.testing.assert_close(moved, moved[:1].expand_as(moved), rtol=1e-4, atol=1e-4)
    gain = (made.colour / behind.colour.clamp_min(1e-6)).masked_select(~is_front.expand_as(made.colour) & (behind.colour > 0.1)).median()
    expected = torch.where(is_front[:, 3], front.references[3], behind.references[3] * gain)
    torch.testing.assert_close(made.references[3], expected, rtol=1e-3, atol=1e-4)


def test_colours_are_exchanged_and_tinted_alike_in_light_albedo_and_reference() -> None:
    (pool,) = resident(moving_shot(seed=1), moving_shot(seed=2)).pools.values()
    shot = pool.shots(chosen([0, 1]), chosen([0, 0]), 0, 6)
    made = recoloured(shot, torch.Generator().manual_seed(1))
    for b in range(2):
        order = [next(k for k in range(3) if torch.equal(made.albedo[b, :, c], shot.albedo[b, :, k])) for c in range(3)]
        tint = made.colour[b] / shot.colour[b][:, order].clamp_min(1e-6)
        each = [float(tint[:, c].median()) for c in range(3)]
        expected = shot.references[3][b][order] * torch.tensor(each).view(3, 1, 1)
        torch.testing.assert_close(made.references[3][b], expected, rtol=1e-3, atol=1e-5)


def test_other_light_is_the_same_for_noise_and_reference() -> None:
    (pool,) = resident(moving_shot(seed=1, parted=True), moving_shot(seed=2, parted=True)).pools.values()
    shot = pool.shots(chosen([0, 1] * 20), chosen([0] * 40), 0, 6)
    torch.testing.assert_close(shot.part[1], moving_shot(seed=2, parted=True).part)
    made = relit(shot, 0.5, torch.Generator().manual_seed(1))
    kept = [b for b in range(40) if torch.equal(made.colour[b], shot.colour[b])]
    assert 8 < len(kept) < 32
    assert made.part is None and not made.reference_parts, "they are of the light before"
    for b in set(range(40)) - set(kept):
        for c in range(3):
            # Two weights explain all pixels of all frames and of the reference, to what half floats leave of a part.
            parts = torch.stack((shot.part[b, :, c], shot.colour[b, :, c] - shot.part[b, :, c]), -1).flatten(0, 2)
            weights = torch.linalg.lstsq(parts, made.colour[b, :, c].flatten()[:, None]).solution[:, 0]
            torch.testing.assert_close(parts @ weights, made.colour[b, :, c].flatten(), rtol=1e-3, atol=1e-3)
            whole, part = shot.references[3][b, c], shot.reference_parts[3][b, c]
            torch.testing.assert_close(part * weights[0] + (whole - part) * weights[1], made.references[3][b, c], rtol=1e-2, atol=1e-3)


def test_shots_with_light_in_one_part_stay_and_have_a_pool_of_their_own() -> None:
    pools = resident(moving_shot(seed=1), moving_shot(seed=2, parted=True)).pools.values()
    assert [len(pool) for pool in pools] == [1, 1]
    (plain,) = (pool for pool in pools if "reference_parts" not in pool.references)
    shot = plain.shots(chosen([0]), chosen([0]), 0, 6)
    assert relit(shot, 1.0, torch.Generator()) is shot


def test_rotations_keep_lengths_and_half_of_them_the_y_axis() -> None:
    turns = rotations(400, torch.Generator().manual_seed(1))
    torch.testing.assert_close(turns @ turns.mT, torch.eye(3).expand(400, 3, 3), rtol=0, atol=1e-5)
    torch.testing.assert_close(torch.linalg.det(turns), torch.ones(400))
    assert 0.4 < float(((turns[:, 1, 1] - 1).abs() < 1e-5).float().mean()) < 0.6


def test_lambda_maps_stay_within_the_dial_and_vary_in_their_share() -> None:
    generator = torch.Generator().manual_seed(1)
    albedo, normal = noise(200, 3, 16, 16), noise(200, 3, 16, 16, seed=2) * 2 - 1
    constant = lambda_maps.constants(200, generator)
    assert 0.5 < float((constant == 1).float().mean()) < 0.8
    lam = lambda_maps.maps(constant, 0.3, albedo, normal, generator)
    assert lam.shape == (200, 1, 16, 16)
    assert 1.0 - 1e-4 <= float(lam.min()) and float(lam.max()) <= 64.001
    varies = (lam.flatten(1).amax(1) / lam.flatten(1).amin(1)) > 1.01
    assert 0.15 < float(varies.float().mean()) < 0.4
    torch.testing.assert_close(lam[~varies][:, 0, 0, 0], constant[~varies], rtol=1e-3, atol=1e-3)


@pytest.mark.parametrize(
    "shot", [moving_shot(columns=32), moving_shot(5, (2,), columns=32), moving_shot(rows=48, columns=48, takes=2, parted=True)]
)
def test_every_kind_of_batch_is_finite_and_of_one_shape(shot: Shot) -> None:
    recipe = Recipe(outputs=4, crop=32, whole=0.0, composed=0.5, lambda_maps=0.5, farther=0.0)
    batches = Batches(resident(shot, shot), recipe, 1)
    shapes: dict[tuple[int, int], set[object]] = {}
    for _ in range(30):
        batch = batches.draw()
        kind = len(batch.views), len(batch.orders[0])
        shapes.setdefault(kind, set()).add((batch.inputs.shape, tuple((k, v.shape) for k, v in sorted(batch.views[0].items()))))
        assert all(torch.isfinite(value).all() for seen in batch.views for value in seen.values())
        assert torch.isfinite(batch.inputs).all()
    assert len(shapes) == 2 * len({1, len(shot.references)})
    assert all(len(found) == 1 for found in shapes.values())


def test_each_kind_of_batch_comes_once_and_larger_shots_both_cut_and_whole() -> None:
    recipe = Recipe(outputs=4, crop=32, composed=0.0, farther=0.0)
    batches = Batches(resident(moving_shot(rows=48, columns=48), moving_shot(5, (2,), columns=32)), recipe, 1)
    forms = [(len(b.views), len(b.orders[0]), *b.inputs.shape) for b in batches.each_kind()]
    assert len(forms) == 8 + 2
    assert len(set(forms)) == 8, "squares of the larger shots have the shapes of the smaller ones"
    assert {form[-1] for form in forms} == {32, 48}

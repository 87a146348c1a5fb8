"""The second pass over time: an average, harmless until it is trained, and trained by itself: python -m pytest training"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from safetensors.torch import save_file

from training.data.shots import Shot
from training.example_shots import moving_shot
from training.network import train_second_pass
from training.network.layers import code_of
from training.network.model import Architecture, Hush
from training.network.second_pass import dialled, difference, second_pass, weights
from training.network.train_second_pass import Example, examples, scores, train
from training.network.weights_file import WeightsFile, begin_from

SMALL = Architecture(features=16, half=16, quarter=16, eighth=16, pair=16)


def network(arch: Architecture = SMALL) -> Hush:
    torch.manual_seed(3)
    net = Hush(replace(arch, second_pass=1))
    net.load_state_dict({k: v if k.startswith("pair_second_head") else torch.randn_like(v) * 0.1 for k, v in net.state_dict().items()})
    return net.eval().requires_grad_(False)


def shot(seed: int = 1) -> Shot:
    torch.manual_seed(seed)
    return moving_shot(references=(3, 2), rows=32, columns=40)


def results(count: int = 3) -> tuple[torch.Tensor, torch.Tensor]:
    torch.manual_seed(5)
    return torch.rand(2, 4, 16, 24) + 0.1, torch.rand(2, count, 4, 16, 24) + 0.1


def test_the_result_is_an_average_of_what_is_trusted() -> None:
    own, near = results()
    logits = torch.randn(2, 3, 2, 8, 12)
    trusted = torch.ones(2, 3, 1, 16, 24)
    trusted[:, 1] = 0
    near[:, 1] = 1e9
    out = second_pass(own, near, trusted, logits, torch.tensor([0.5, 2.0]))
    seen = torch.stack((own, near[:, 0], near[:, 2]))
    assert ((out >= seen.amin(0) - 1e-5) & (out <= seen.amax(0) + 1e-5)).all()
    assert (out - own).abs().max() > 0.05
    assert torch.equal(second_pass(own, near, 0 * trusted, logits, torch.ones(2)), own)


def test_what_is_unlike_counts_less_and_brightness_does_not_matter() -> None:
    own, near = results(1)
    same, other = own[:, None], own[:, None] * 3
    exposure = torch.ones(2)
    unlike = difference(own[:, :3], other[:, :, :3], exposure)
    assert difference(own[:, :3], same[:, :, :3], exposure).abs().max() < 1e-6 and 0.4 < float(unlike.min()) <= float(unlike.max()) <= 0.5
    assert torch.allclose(difference(own[:, :3] * 8, other[:, :, :3] * 8, exposure / 8), unlike, atol=1e-5)
    logits = torch.zeros(2, 1, 2, 8, 12)
    by = [weights(logits, d) for d in (0 * unlike, 0.5 * unlike, unlike)]
    assert (by[0] == 1).all() and (by[0] > by[1]).all() and (by[1] > by[2]).all()


def test_lambda_moves_the_logits_by_pixel() -> None:
    outputs = torch.tensor([1.0, 2.0, 10.0, 20.0]).view(1, 1, 4, 1, 1).expand(1, 1, 4, 2, 2)
    lam = torch.ones(1, 1, 4, 4)
    lam[..., 2:] = 64
    assert dialled(outputs, code_of(lam, 2))[0, 0, :, 0].tolist() == [[1.0, 11.0], [2.0, 22.0]]
    assert dialled(outputs, code_of(torch.tensor([8.0]), 2))[0, 0, :, 1, 1].tolist() == [6.0, 12.0]


def test_an_untrained_second_pass_hardly_changes_anything() -> None:
    of = examples(network(), shot(), 1.0)
    for example in of:
        image, by = example.averaged(network().pair_second_head)
        assert float(by.sum(1).max()) < 0.2
        assert (image - example.own).abs().mean() < 0.1 * example.own.mean()


def test_every_frame_takes_the_first_passes_of_the_shots_frames_around_it() -> None:
    net = network()
    middle, before = examples(net, shot(), 4.0)
    assert len(middle.hidden) == 4 and middle.near.shape == (1, 4, 3, 32, 40) and middle.before is not None and before.before is None
    assert middle.hidden.shape[1:] == (16, 16, 20)
    # What the network says of itself.
    out = net.denoise(*inputs(net), torch.tensor([4.0]))
    said = dialled(net.pair_second_head(middle.hidden.float())[None], code_of(torch.tensor([4.0]), 20))
    assert torch.allclose(said, out["second"], atol=1e-3)


def inputs(net: Hush) -> tuple[torch.Tensor, dict[str, torch.Tensor]]:
    from training.data.inputs import prepare

    batch = {k: v[None] for k, v in prepare(shot(), (-2, -1, 1, 2)).items() if isinstance(v, torch.Tensor)}
    return net.encode(batch["inputs"]), batch


def noisy_results(seed: int) -> list[Example]:
    """Two frames whose first passes are a still image and noise."""
    generator = torch.Generator().manual_seed(seed)
    reference = torch.rand(1, 3, 16, 16, generator=generator) * 0.2 + 0.4
    noise = lambda *shape: 0.05 * torch.randn(*shape, generator=generator)
    found = []
    for _ in range(2):
        own, near = reference + noise(1, 3, 16, 16), reference[:, None] + noise(1, 4, 3, 16, 16)
        unlike = difference(own, near, torch.ones(1))
        hidden, trusted = torch.rand(4, 16, 8, 8, generator=generator).half(), torch.ones(1, 4, 1, 16, 16)
        found.append(Example(own, near, trusted, hidden, unlike, own, reference, 1.0, torch.ones(1)))
    position = torch.stack(torch.meshgrid(torch.arange(16.0), torch.arange(16.0), indexing="xy"))[None]
    found[0].before, found[0].followed = position, torch.ones(1, 1, 16, 16)
    return found


def test_training_finds_that_still_results_are_worth_averaging() -> None:
    head = network().pair_second_head.requires_grad_(True)
    learnt = [noisy_results(seed) for seed in range(4)]
    held = [noisy_results(9)]
    before = scores(head, held)
    train(head, learnt, learnt, 150, torch.Generator().manual_seed(1))
    after = scores(head, held)
    assert after["smape"] < 0.8 < before["smape"] <= 1.0 and after["flicker"] < 0.8 and after["weight"] > 1.0


def test_weights_get_a_second_pass_and_keep_the_first(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    first = Hush(SMALL)
    tensors = {name: value.half().contiguous() for name, value in first.state_dict().items()}
    save_file(tensors, tmp_path / "first.safetensors", metadata={"hush.architecture": json.dumps(SMALL.header())})
    read = {"001": shot(1), "002": shot(2), "008": shot(8)}
    monkeypatch.setattr(train_second_pass, "shot_paths", lambda _folders: [Path(f"{name}.npz") for name in read])
    learnt: list[str] = []
    monkeypatch.setattr(train_second_pass, "read_shot", lambda path: learnt.append(path.stem) or read[path.stem])
    arguments = [
        "x",
        "--weights",
        tmp_path / "first.safetensors",
        "--out",
        tmp_path / "second.safetensors",
        "--shots",
        tmp_path,
        "--steps",
        "5",
    ]
    monkeypatch.setattr("sys.argv", [str(a) for a in arguments])
    train_second_pass.main()
    file = WeightsFile.read(tmp_path / "second.safetensors")
    assert file.architecture() == replace(SMALL, second_pass=1)
    assert all(torch.equal(file.tensors[name], value) for name, value in tensors.items())
    assert set(file.tensors) - set(tensors) == {"pair_second_head.weight", "pair_second_head.bias"}
    assert set(json.loads(file.header["hush.second_pass"])["over_the_first"]) == {"lambda_1", "lambda_8", "lambda_64"}
    file.network()


def test_weights_without_one_leave_it_out_of_the_header() -> None:
    assert "second_pass" not in SMALL.header() and replace(SMALL, second_pass=1).header()["second_pass"] == 1
    net = Hush(replace(SMALL, second_pass=1))
    begin_from(net, Hush(SMALL).state_dict())
    assert float(net.pair_second_head.bias[0].detach()) == -3.0

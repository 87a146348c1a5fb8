"""Trained weights: the weights file and the checkpoint, the architecture that each was trained with, and networks that start from them."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterable
from dataclasses import dataclass, fields, replace
from pathlib import Path

import torch
from safetensors import safe_open
from safetensors.torch import save_file
from torch import Tensor

from training.network.model import Architecture, Hush

FIRST = "cycles"
Tensors = dict[str, Tensor]
# Where residual blocks stand, and which number of the architecture counts them.
BLOCKS = {
    "encoder.blocks": "blocks_encoder",
    "half_in": "blocks_half",
    "quarter_in": "blocks_quarter",
    "eighth": "blocks_eighth",
    "half_out": "blocks_out",
}


@dataclass
class WeightsFile:
    """A weights file as it is on disk: its tensors bit by bit, and its header."""

    tensors: Tensors
    header: dict[str, str]

    @staticmethod
    def read(path: Path) -> WeightsFile:
        with safe_open(path, "pt") as file:
            return WeightsFile({key: file.get_tensor(key) for key in file.keys()}, dict(file.metadata()))  # noqa: SIM118

    def renderers(self) -> list[str]:
        return json.loads(self.header.get("hush.encoders", json.dumps([FIRST])))

    def architecture(self) -> Architecture:
        return Architecture(**json.loads(self.header["hush.architecture"]))

    def weights(self, renderer: str = "") -> Tensors:
        """The network's weights in single precision, with the encoder of a renderer, the first one's where it is empty."""
        own = {k: v.float() for k, v in self.tensors.items() if not k.startswith("encoders.")}
        if renderer and renderer != self.renderers()[0]:
            prefix = f"encoders.{renderer}."
            own |= {f"encoder.{k.removeprefix(prefix)}": v.float() for k, v in self.tensors.items() if k.startswith(prefix)}
        return own

    def network(self, renderer: str = "") -> Hush:
        return Trained(self.architecture(), self.weights(renderer)).network()

    def fingerprint(self) -> str:
        """Of all but the further encoders."""
        own = sorted(k for k in self.tensors if not k.startswith("encoders."))
        return hashlib.sha256(b"".join(self.tensors[k].numpy().tobytes() for k in own)).hexdigest()

    def add(self, renderer: str, encoder: Tensors, record: dict[str, dict[str, object]]) -> None:
        """Puts in another encoder, or in place of the one of that name; `record` is what goes beside it in the header."""
        tensors = {k: v for k, v in self.tensors.items() if not k.startswith(f"encoders.{renderer}.")}
        self.tensors = tensors | {f"encoders.{renderer}.{k}": v for k, v in encoder.items()}
        others = [name for name in self.renderers() if name != renderer]
        self.header["hush.encoders"] = json.dumps([*others, renderer])
        self.header |= {f"hush.{part}.{renderer}": json.dumps(about) for part, about in record.items()}

    def write(self, path: Path) -> None:
        aside = path.with_suffix(".part")
        save_file(self.tensors, aside, metadata=self.header)
        os.replace(aside, path)


@dataclass
class Trained:
    """Weights, by the network's names, and the architecture they belong to."""

    architecture: Architecture
    weights: Tensors

    @staticmethod
    def read(path: Path) -> Trained:
        """A weights file's, or the averaged ones of a checkpoint."""
        if path.suffix == ".safetensors":
            file = WeightsFile.read(path)
            return Trained(file.architecture(), file.weights())
        return Trained.of_checkpoint(torch.load(path, weights_only=True, map_location="cpu"))

    @staticmethod
    def of_checkpoint(state: dict[str, object]) -> Trained:
        # Checkpoints without an architecture are of the time when there was one, and have the average's own counter.
        weights = {k.removeprefix("module."): v.float() for k, v in state["mean"].items() if k != "n_averaged"}
        return Trained(Architecture(**state.get("architecture", {})), weights)

    def network(self) -> Hush:
        net = Hush(self.architecture)
        net.load_state_dict(self.weights)
        return net.eval()

    def without(self, blocks: Iterable[str]) -> Trained:
        """Leaves residual blocks out, named as `eighth.0` or `half_out.1`; the others close up."""
        gone: dict[str, set[int]] = {}
        for block in blocks:
            place, _, index = block.rpartition(".")
            if place not in BLOCKS or not index.isdecimal() or int(index) >= getattr(self.architecture, BLOCKS[place]):
                raise SystemExit(f"no residual block {block}: there are " + ", ".join(self.blocks()))
            gone.setdefault(place, set()).add(int(index))
        weights, counts = dict(self.weights), {}
        for place, indices in gone.items():
            count = getattr(self.architecture, BLOCKS[place])
            kept = [k for k in range(count) if k not in indices]
            counts[BLOCKS[place]] = len(kept)
            of_block = lambda k, place=place: [name for name in self.weights if name.startswith(f"{place}.{k}.")]
            for k in range(count):
                for name in of_block(k):
                    del weights[name]
            for new, old in enumerate(kept):
                weights |= {f"{place}.{new}{name.removeprefix(f'{place}.{old}')}": self.weights[name] for name in of_block(old)}
        return Trained(replace(self.architecture, **counts), weights)

    def blocks(self) -> list[str]:
        return [f"{place}.{k}" for place, count in BLOCKS.items() for k in range(getattr(self.architecture, count))]


def changed(architecture: Architecture, changes: Iterable[str]) -> Architecture:
    """An architecture with some of its numbers changed, each as `blocks_quarter=3`."""
    kinds = {f.name: type(getattr(architecture, f.name)) for f in fields(architecture)}
    found = {}
    for change in changes:
        name, _, value = change.partition("=")
        if name not in kinds:
            raise SystemExit(f"the architecture has no {name}: it has " + ", ".join(kinds))
        found[name] = kinds[name](value)
    return replace(architecture, **found)


def begin_from(net: Hush, weights: Tensors) -> None:
    """Takes over trained weights. What they lack keeps its start, residual blocks the identity; what grew is 0 where it is new, so that
    new taps have a logit of 0 and new inputs no effect."""
    state = net.state_dict()
    for name, value in weights.items():
        if name not in state or any(new < old for new, old in zip(state[name].shape, value.shape, strict=True)):
            continue
        state[name].zero_()
        state[name][tuple(slice(n) for n in value.shape)] = value.to(state[name])
    net.load_state_dict(state)


def mean_of(several: list[Trained]) -> Trained:
    """The mean of several networks' weights, which must be of one architecture."""
    first = several[0]
    if any(one.architecture != first.architecture for one in several):
        raise SystemExit("the checkpoints are of different architectures: their weights have no mean")
    return Trained(first.architecture, {name: torch.stack([one.weights[name] for one in several]).mean(0) for name in first.weights})

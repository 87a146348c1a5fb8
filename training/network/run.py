"""The state of a training run and its checkpoints."""

from __future__ import annotations

import copy
import json
import os
from dataclasses import dataclass, field
from pathlib import Path

import torch

from training.data.resident import Resident
from training.data.shots import is_held, shot_paths
from training.network.clock import Clock
from training.network.measure import Scores, sample, scores
from training.network.model import Hush
from training.network.muon import Both
from training.network.references import ReferenceDenoiser


@dataclass
class Run:
    """A training run; `checkpoint.pt` in its folder holds all of it but the shots."""

    folder: Path
    sources: list[Path]
    net: Hush
    mean: Hush  # of the weights along the run; what is measured and exported
    optimiser: Both
    clock: Clock
    shots: Resident
    held: Resident
    denoiser: ReferenceDenoiser | None = None
    step: int = 0
    known: set[str] = field(default_factory=set)

    @staticmethod
    def averaged(net: Hush) -> Hush:
        """A copy to hold the average of a network's weights."""
        return copy.deepcopy(net).eval().requires_grad_(False)

    def find_shots(self) -> None:
        """Reads the shots that came since the last time; what is measured against is never denoised."""
        new = {path.stem: path for path in shot_paths(self.sources) if path.stem not in self.known}
        self.held.read(path for path in new.values() if is_held(path))
        self.shots.read((path for path in new.values() if not is_held(path)), self.denoiser)
        self.known |= new.keys()

    def resume(self, state: dict[str, object]) -> None:
        """Goes on where a checkpoint was written."""
        self.net.load_state_dict(state["net"])
        self.mean.load_state_dict(state["mean"])
        self.optimiser.load_state_dict(state["optimiser"])
        self.step = state["step"]

    @torch.no_grad()
    def average(self, decay: float) -> None:
        """Takes the weights of this step into their mean; faster in the first steps, when there is little to average."""
        decay = min(decay, (self.step + 1) / (self.step + 10))
        torch._foreach_lerp_(list(self.mean.parameters()), list(self.net.parameters()), 1 - decay)

    def measure(self, count: int, bf16: bool) -> dict[str, Scores]:
        """Scores of the averaged weights on validation shots and on as many training shots, and the gap between them as a ratio."""
        held = scores(self.mean, sample(self.held, count), bf16=bf16) if len(self.held) else {}
        trained = scores(self.mean, sample(self.shots, count), bf16=bf16)
        gap = {name: held[name] / trained[name] for name in held if trained.get(name)}
        return {"held": held, "trained": trained, "gap": gap}

    def record(self, loss: float | None, measured: dict[str, Scores]) -> None:
        """Adds a line to log.jsonl, and prints it, and writes the checkpoint."""
        counts = {"shots": len(self.shots), "held_shots": len(self.held)}
        rounded = {part: {name: round(value, 5) for name, value in found.items()} for part, found in measured.items()}
        about = {"step": self.step, "spent": round(self.clock.spent, 1), "done": round(self.clock.done, 4), "loss": loss}
        line = json.dumps(about | counts | rounded)
        print(line, flush=True)
        with (self.folder / "log.jsonl").open("a") as log:
            log.write(line + "\n")
        self.save()

    def save(self) -> None:
        """Writes the checkpoint aside and moves it into place: one that is there is whole."""
        parts = {"net": self.net.state_dict(), "mean": self.mean.state_dict(), "optimiser": self.optimiser.state_dict()}
        about = {"step": self.step, "spent": self.clock.spent, "done": self.clock.done, "seeds": self.shots.seeds}
        aside = self.folder / "checkpoint.tmp"
        torch.save({"architecture": self.net.arch.header(), **parts, **about}, aside)
        os.replace(aside, self.folder / "checkpoint.pt")


def checkpoint(folder: Path) -> dict[str, object] | None:
    """A folder's checkpoint, where there is one."""
    path = folder / "checkpoint.pt"
    return torch.load(path, weights_only=True, map_location="cpu") if path.exists() else None


@torch.no_grad()
def bound_gradients(net: Hush) -> None:
    """Scales all gradients to a norm of at most 1; to 0 where it is not finite. Never waits for the device."""
    parameters = [p for p in net.parameters() if p.grad is not None]
    norm = torch.nn.utils.get_total_norm([p.grad for p in parameters])
    finite = norm.isfinite()
    share = (1.0 / norm.clamp_min(1e-6)).clamp(max=1.0)
    for p in parameters:
        p.grad = torch.where(finite, p.grad * share, 0.0)

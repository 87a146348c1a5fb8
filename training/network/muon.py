"""Muon: steps of hidden layers made orthogonal (Jordan et al. 2024, https://kellerjordan.github.io/posts/muon); AdamW for the rest."""

from __future__ import annotations

from collections.abc import Iterable

import torch
from torch import Tensor, nn
from torch.optim import AdamW, Optimizer

# Quintic of Newton and Schulz, chosen by Jordan et al. for the steepest start.
QUINTIC = (3.4445, -4.7750, 2.0315)
ROUNDS = 5


def orthogonal(step: Tensor) -> Tensor:
    """The nearest matrix whose singular values are about 1, (m, n) to (m, n)."""
    a, b, c = QUINTIC
    x = step if step.shape[0] <= step.shape[1] else step.T
    x = x / x.norm().clamp_min(1e-7)
    for _ in range(ROUNDS):
        square = x @ x.T
        x = a * x + (b * square + c * square @ square) @ x
    return x if step.shape[0] <= step.shape[1] else x.T


class Muon(Optimizer):
    """Momentum, made orthogonal and scaled to the size of Adam's steps, so that both take the same rate."""

    def __init__(self, parameters: Iterable[Tensor], lr: float, momentum: float = 0.95, weight_decay: float = 0.0) -> None:
        super().__init__(parameters, {"lr": lr, "momentum": momentum, "weight_decay": weight_decay})

    @torch.no_grad()
    def step(self, closure: None = None) -> None:  # noqa: ARG002
        for group in self.param_groups:
            for p in group["params"]:
                if p.grad is None:
                    continue
                state = self.state[p]
                mean = state.setdefault("mean", torch.zeros_like(p.grad))
                mean.lerp_(p.grad, 1 - group["momentum"])
                ahead = p.grad.lerp(mean, group["momentum"])
                flat = orthogonal(ahead.flatten(1))
                p.mul_(1 - group["lr"] * group["weight_decay"])
                p.add_(flat.reshape(p.shape), alpha=-group["lr"] * 0.2 * max(flat.shape) ** 0.5)


def is_hidden(name: str, parameter: Tensor) -> bool:
    """Whether Muon takes it: convolutions between features, not the first layer, the heads or λ's."""
    return parameter.dim() == 4 and not any(part in name for part in ("encoder.first", "head", "query", "lambda"))


class Both:
    """Muon for the hidden layers, AdamW for the rest, as one."""

    def __init__(self, net: nn.Module, rate: float) -> None:
        named = list(net.named_parameters())
        hidden = [p for n, p in named if is_hidden(n, p)]
        others = [p for n, p in named if not is_hidden(n, p)]
        self.parts = (Muon(hidden, rate, weight_decay=1e-4), AdamW(others, lr=rate, betas=(0.9, 0.99), weight_decay=1e-4))

    def set_rate(self, rate: float) -> None:
        for group in (group for part in self.parts for group in part.param_groups):
            group["lr"] = rate

    def step(self) -> None:
        for part in self.parts:
            part.step()

    def zero_grad(self) -> None:
        for part in self.parts:
            part.zero_grad(set_to_none=True)

    def state_dict(self) -> list[dict[str, object]]:
        return [part.state_dict() for part in self.parts]

    def load_state_dict(self, states: list[dict[str, object]]) -> None:
        for part, state in zip(self.parts, states, strict=True):
            part.load_state_dict(state)

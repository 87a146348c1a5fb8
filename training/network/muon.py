"""Muon: steps of hidden layers made orthogonal (Jordan et al. 2024, https://kellerjordan.github.io/posts/muon); AdamW for the rest."""

from __future__ import annotations

from collections.abc import Iterable

import torch
from torch import Tensor, nn
from torch.optim import AdamW, Optimizer

# Quintic of Newton and Schulz, chosen by Jordan et al. for the steepest start.
QUINTIC = (3.4445, -4.7750, 2.0315)
ROUNDS = 5


def orthogonal(steps: Tensor) -> Tensor:
    """The nearest matrices whose singular values are about 1, (…, m, n) to (…, m, n)."""
    a, b, c = QUINTIC
    wide = steps.shape[-2] <= steps.shape[-1]
    x = steps if wide else steps.mT
    x = x / x.norm(dim=(-2, -1), keepdim=True).clamp_min(1e-7)
    for _ in range(ROUNDS):
        square = x @ x.mT
        x = a * x + (b * square + c * square @ square) @ x
    return x if wide else x.mT


class Muon(Optimizer):
    """Momentum, made orthogonal and scaled to the size of Adam's steps, so that both take the same rate.

    Parameters of one shape are stepped together, as one batch of matrices.
    """

    def __init__(
        self, parameters: Iterable[Tensor] | list[dict[str, object]], lr: float, momentum: float = 0.95, weight_decay: float = 0
    ) -> None:
        super().__init__(parameters, {"lr": lr, "momentum": momentum, "weight_decay": weight_decay})

    @torch.no_grad()
    def step(self, closure: None = None) -> None:  # noqa: ARG002
        for group in self.param_groups:
            alike: dict[torch.Size, list[Tensor]] = {}
            for p in group["params"]:
                if p.grad is not None:
                    alike.setdefault(p.shape, []).append(p)
            for shape, parameters in alike.items():
                gradients = [p.grad for p in parameters]
                means = [self.state[p].setdefault("mean", torch.zeros_like(p.grad)) for p in parameters]
                torch._foreach_lerp_(means, gradients, 1 - group["momentum"])
                ahead = torch.stack(torch._foreach_lerp(gradients, means, group["momentum"]))
                flat = orthogonal(ahead.flatten(2))
                torch._foreach_mul_(parameters, 1 - group["lr"] * group["weight_decay"])
                size = 0.2 * max(flat.shape[1:]) ** 0.5
                torch._foreach_add_(parameters, list(flat.reshape(len(parameters), *shape)), alpha=-group["lr"] * size)


def is_hidden(name: str, parameter: Tensor) -> bool:
    """Whether Muon takes it: convolutions between features, not the first layer, the heads or λ's."""
    return parameter.dim() == 4 and not any(part in name for part in ("encoder.first", "head", "query", "lambda"))


def is_coarse(name: str) -> bool:
    """Whether a parameter makes the features at eighth resolution, which see far."""
    return name.startswith(("to_eighth.", "eighth."))


class Both:
    """Muon for the hidden layers, AdamW for the rest, as one. What sees far has a weight decay of its own."""

    def __init__(self, net: nn.Module, rate: float, decay: float = 1e-4, decay_coarse: float = 1e-4) -> None:
        named = list(net.named_parameters())
        chosen = lambda hidden, coarse: [p for n, p in named if is_hidden(n, p) == hidden and is_coarse(n) == coarse]
        groups = lambda hidden: [
            {"params": chosen(hidden, coarse), "weight_decay": decay_coarse if coarse else decay} for coarse in (False, True)
        ]
        device = next(net.parameters()).device.type
        self.parts = (Muon(groups(True), rate), AdamW(groups(False), lr=rate, betas=(0.9, 0.99), fused=device == "cuda"))

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

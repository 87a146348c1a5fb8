"""The layers that the network (`model.py`) is made of."""

from __future__ import annotations

import torch
import torch.nn.functional as F
from torch import Tensor, nn


class Residual(nn.Module):
    """x + conv(relu(conv(relu(x)))), the identity at the start of training."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.first = nn.Conv2d(channels, channels, 3, padding=1)
        self.second = nn.Conv2d(channels, channels, 3, padding=1)
        nn.init.zeros_(self.second.weight)
        nn.init.zeros_(self.second.bias)

    def forward(self, x: Tensor) -> Tensor:
        return x + self.second(F.relu(self.first(F.relu(x))))


def residuals(channels: int, count: int) -> nn.Sequential:
    return nn.Sequential(*[Residual(channels) for _ in range(count)])


class Encoder(nn.Module):
    """Source encoder: the renderer-specific part. (N, 10, H, W) inputs to (N, features, H/2, W/2)."""

    def __init__(self, features: int, blocks: int) -> None:
        super().__init__()
        self.first = nn.Conv2d(40, features, 3, padding=1)
        self.second = nn.Conv2d(features, features, 3, padding=1)
        self.blocks = residuals(features, blocks)

    def forward(self, inputs: Tensor) -> Tensor:
        x = F.pixel_unshuffle(inputs, 2)
        return self.blocks(self.second(F.relu(self.first(x))))


def code_of(lam: Tensor, columns: int) -> Tensor:
    """log2 λ / 6, (B, 1, 1, 1), of λ (B,); of a map (B, 1, H, W) its means at the resolution that has so many columns."""
    code = torch.log2(lam.view(-1, 1, 1, 1) if lam.dim() == 1 else lam) / 6.0
    return F.avg_pool2d(code, code.shape[-1] // columns) if code.shape[-1] > 1 else code


class Specialisation(nn.Module):
    """Loss specialisation: λ scales and shifts the features that feed the kernel predictors.

    λ is one number for each example, (B,), or a map at full resolution, (B, 1, H, W), of which log2 is averaged over a feature's pixels.
    """

    def __init__(self, channels: int, hidden: int) -> None:
        super().__init__()
        self.hidden = nn.Linear(1, hidden)
        self.scale = nn.Linear(hidden, channels)
        self.shift = nn.Linear(hidden, channels)
        for layer in (self.scale, self.shift):
            nn.init.zeros_(layer.weight)
            nn.init.zeros_(layer.bias)

    def forward(self, x: Tensor, lam: Tensor) -> Tensor:
        h = F.relu(self.hidden(code_of(lam, x.shape[-1]).movedim(1, -1)))
        return x * (1.0 + self.scale(h)).movedim(-1, 1) + self.shift(h).movedim(-1, 1)


def silent(channels: int, outputs: int) -> nn.Conv2d:
    """A 1×1 layer that predicts 0 at the start of training."""
    layer = nn.Conv2d(channels, outputs, 1)
    nn.init.zeros_(layer.weight)
    nn.init.zeros_(layer.bias)
    return layer

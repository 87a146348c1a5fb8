"""The second pass over time: a frame's result averaged with those of the frames around it.

The weights are the network's (`pair_second_head`). The results are averages of rendered pixels already, and so is theirs.
`src/network/second_pass.rs` computes the same function.
"""

from __future__ import annotations

import torch.nn.functional as F
from torch import Tensor

ALIKE = 0.1  # relative difference of two results that the logits measure in
EPSILON = 0.01  # light, after exposure, below which differences do not count
LOG_WEIGHTS = (-20.0, 6.0)


def dialled(outputs: Tensor, code: Tensor) -> Tensor:
    """The logits (B, N, 2, h, w) of what the head gives, (B, N, 4, h, w): those at λ 1, and how they move with λ's code (B, 1, h, w)."""
    return outputs[:, :, :2] + code[:, None] * outputs[:, :, 2:]


def difference(own: Tensor, near: Tensor, exposure: Tensor) -> Tensor:
    """How unlike two results are, (B, N, 1, h, w) in 0…1, at half resolution: the mean over 3×3 pixels.

    own (B, 3, H, W); near (B, N, 3, H, W), warped; exposure (B,): the centre frame's.
    """
    n = near.shape[1]
    gain = exposure.view(-1, 1, 1, 1, 1)
    a, b = F.avg_pool2d((near * gain).flatten(0, 1), 2).unflatten(0, (-1, n)), F.avg_pool2d(own, 2)[:, None] * gain
    found = ((a - b).abs() / (a + b + EPSILON)).mean(2)
    return F.avg_pool2d(F.pad(found, (1, 1, 1, 1), mode="replicate"), 3, 1)[:, :, None]


def weights(logits: Tensor, unlike: Tensor) -> Tensor:
    """What a neighbour's result counts beside the frame's own 1, (B, N, 1, H, W), of logits (B, N, 2, h, w) and `difference`.

    The first logit is the log of the weight, the second how fast it falls as the results differ.
    """
    log = logits[:, :, :1] - F.softplus(2.0 * logits[:, :, 1:]) * (unlike / ALIKE) ** 2 / 2.0
    return log.clamp(*LOG_WEIGHTS).exp().repeat_interleave(2, -1).repeat_interleave(2, -2)


def second_pass(own: Tensor, near: Tensor, trusted: Tensor, logits: Tensor, exposure: Tensor) -> Tensor:
    """The average, (B, C, H, W), of a frame's result (B, C, H, W) and those of N neighbours, warped (B, N, C, H, W).

    The first three channels are the colour. trusted (B, N, 1, H, W) in {0, 1}; logits (B, N, 2, h, w); exposure (B,).
    """
    by = weights(logits, difference(own[:, :3], near[:, :, :3], exposure)) * trusted
    return (own + (by * near).sum(1)) / (1.0 + by.sum(1))

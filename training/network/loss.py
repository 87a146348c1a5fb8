"""The losses of Vogels et al. 2018, section 5 (SMAPE) and section 6 (the asymmetric loss), and what else is measured."""

from __future__ import annotations

import torch.nn.functional as F
from torch import Tensor

EPSILON = 1e-2
RELATIVE = 0.1
BLOCK = 4  # side of the squares that fireflies are looked for in


def by_pixel(lam: Tensor) -> Tensor:
    """λ of each example (B,), or of each pixel (B, 1, H, W), against images (B, C, H, W)."""
    return lam.view(-1, 1, 1, 1) if lam.dim() == 1 else lam


def smape(denoised: Tensor, reference: Tensor) -> Tensor:
    """Symmetric mean absolute percentage error by pixel and channel, in [0, 1]."""
    return (denoised - reference).abs() / (denoised.abs() + reference.abs() + EPSILON)


def relative(denoised: Tensor, reference: Tensor) -> Tensor:
    """Absolute error over the reference by pixel and channel."""
    return (denoised - reference).abs() / (reference.abs() + 0.1)


def rel_mse(denoised: Tensor, reference: Tensor) -> Tensor:
    """Relative squared error by pixel and channel, (d − r)² / (r² + 0.01)."""
    return (denoised - reference) ** 2 / (reference**2 + 1e-2)


def asymmetric(denoised: Tensor, reference: Tensor, noisy: Tensor, lam: Tensor) -> Tensor:
    """ℓ'λ(d, r, c) = ℓ(d, r)·(1 + (λ−1)·H((d−r)(r−c))): λ times the price for leaving the noisy colour's side.

    lam: (B,) or (B, 1, H, W). ℓ is the SMAPE and a share of the logarithm of the relative error, which a firefly does not end.
    """
    crossed = ((denoised - reference) * (reference - noisy) > 0).to(denoised.dtype)
    error = smape(denoised, reference) + RELATIVE * relative(denoised, reference).log1p()
    return error * (1.0 + (by_pixel(lam) - 1.0) * crossed)


def fireflies(denoised: Tensor, reference: Tensor) -> Tensor:
    """log1p of the mean relMSE of each square of BLOCK² pixels, (B, 1, H/BLOCK, W/BLOCK).

    Small errors cost their relMSE, large ones its logarithm: the gradient of a pixel that is far off falls as 1/error, and that of the
    logit of the tap that put the firefly there, gradient times the tap's distance, stays bounded however bright it is.
    """
    return F.avg_pool2d(rel_mse(denoised, reference).mean(1, keepdim=True), BLOCK).log1p()


def flicker(denoised: Tensor, reference: Tensor, before: Tensor, followed: Tensor) -> Tensor:
    """|Δd − Δr| / (|d| + |r| + ε) by pixel and channel, as `src/metrics/flicker.rs`; 0 where the way back leaves the frame.

    before: the last frame's error d − r, warped to this frame; followed (B, 1, H, W) in {0, 1}.
    """
    return (denoised - reference - before).abs() / (denoised.abs() + reference.abs() + EPSILON) * followed

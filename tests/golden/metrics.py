"""Prints the values that the tests in src/metrics/*.rs expect, computed by numpy, scikit-image and the authors' FLIP.

    pip install numpy scikit-image flip-evaluator==1.7
    python metrics.py

The images are those of `samples::formula` in src/metrics/pair.rs.
"""

from __future__ import annotations

import flip_evaluator
import numpy as np
from numpy.typing import NDArray
from skimage.metrics import structural_similarity

ROWS, COLUMNS = 48, 64


def formula() -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    y, x, c = np.meshgrid(np.arange(ROWS), np.arange(COLUMNS), np.arange(3), indexing="ij")
    reference = ((x * 7 + y * 13 + c * 29 + x * y) % 64).astype(np.float32) / np.float32(32)
    error = ((x * 31 + y * 17 + c * 5) % 11).astype(np.float32) - np.float32(5)
    return reference, reference * (np.float32(1) + error / np.float32(50))


def display(linear: NDArray[np.float64]) -> NDArray[np.float64]:
    x = np.maximum(linear, 0)
    x = x / (1 + x)
    return np.where(x <= 0.0031308, 12.92 * x, 1.055 * x ** (1 / 2.4) - 0.055)


def main() -> None:
    r, d = (image.astype(np.float64) for image in formula())
    gain = 0.4 / r.mean()
    # A second reference, a brightness, and the frame before: both references and the result upside down, moved by a quarter pixel.
    b, g = (r[:, ::-1] + 3 * r) / 4 * gain, (r + d) / 2 * gain
    a, e = d * gain - r * gain, d * gain - b
    print(f"unbiased relmse {np.mean(a * e / (g**2 + 1e-2)):.12f}")
    before = [0.75 * x[::-1, :-1] + 0.25 * x[::-1, 1:] for x in (a, e)]
    change = (a[:, :-1] - before[0]) * (e[:, :-1] - before[1]) / (2 * g[:, :-1] + 1e-2) ** 2
    # In the last column the source is a quarter pixel beyond the last one, which is continued.
    rim = (a[:, -1] - a[::-1, -1]) * (e[:, -1] - e[::-1, -1]) / (2 * g[:, -1] + 1e-2) ** 2
    print(f"unbiased flicker squared {(change.sum() + rim.sum()) / a.size:.12f}")
    r, d = r * gain, d * gain
    print(f"smape  {np.mean(np.abs(d - r) / (np.abs(d) + np.abs(r) + 1e-2)):.12f}")
    print(f"relmse {np.mean((d - r) ** 2 / (r**2 + 1e-2)):.12f}")
    r, d = display(r), display(d)
    print(f"psnr   {-10 * np.log10(np.mean((d - r) ** 2)):.10f}")
    weights = np.array([0.2126, 0.7152, 0.0722])
    settings = {"gaussian_weights": True, "sigma": 1.5, "use_sample_covariance": False, "data_range": 1.0}
    print(f"ssim   {structural_similarity(r @ weights, d @ weights, **settings):.12f}")
    error, _, used = flip_evaluator.evaluate(r.astype(np.float32), d.astype(np.float32), "LDR", applyMagma=False)
    print(f"flip   {error.astype(np.float64).mean():.10f} at {used['ppd']:.4f} pixels per degree")


if __name__ == "__main__":
    main()

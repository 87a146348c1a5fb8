"""Frames as a stream: each goes in once and comes out as soon as the ones after it are there to help.

Wants the wheel and numpy: python examples/python/sliding_window.py
"""

from __future__ import annotations

import hush
import numpy as np

ROWS, COLUMNS, FRAMES = 96, 128, 8
# Pixels that the picture moves to the right from frame to frame.
STEP = 3

rows, columns = np.mgrid[:ROWS, :COLUMNS].astype(np.float32)
random = np.random.default_rng(1)


def clean(time: int) -> np.ndarray:
    """A soft pattern that moves to the right."""
    wave = 0.5 + 0.3 * np.sin((columns - STEP * time) * 0.15) * np.cos(rows * 0.1)
    return np.repeat(wave[..., None], 3, axis=2).astype(np.float32)


# Cycles' Vector pass: where the point was in the frame before, and where it came from seen from the frame after, in pixels, y up.
vector = np.broadcast_to(np.array([-STEP, 0, -STEP, 0], np.float32), (ROWS, COLUMNS, 4))

# Two frames on each side help. `push` returns what became ready, which lags two frames behind; `flush` the rest.
denoiser = hush.Denoiser(window=2)
ready = []
for time in range(FRAMES):
    noisy = clean(time) * random.uniform(0.0, 2.0, (ROWS, COLUMNS, 3)).astype(np.float32)
    ready += denoiser.push(noisy, vector=vector, tag=time)
ready += denoiser.flush()

# The tag tells which frame it is; they come in the order they were pushed.
assert [frame.tag for frame in ready] == list(range(FRAMES))
errors = [float(np.abs(frame.color - clean(frame.tag)).mean()) for frame in ready]
print("mean error of each frame:", ", ".join(f"{error:.4f}" for error in errors))
alone = float(np.abs(hush.denoise(noisy, vector=vector) - clean(FRAMES - 1)).mean())
print(f"of the last one, denoised alone: {alone:.4f}")
assert errors[-1] < alone, "its neighbours help"

"""One frame in memory: arrays in, an array out, no files. Wants the wheel and numpy: python examples/python/one_frame.py"""

from __future__ import annotations

import hush
import numpy as np

# A wall that is lit from the left. Images are (rows, columns, channels) of linear light.
tint = np.array([1.0, 0.9, 0.7], np.float32)
clean = np.broadcast_to(np.linspace(0.2, 1.0, 128, dtype=np.float32)[None, :, None] * tint, (96, 128, 3))

# What a path tracer makes of it with few samples: right on average, and far off in each pixel.
noisy = clean * np.random.default_rng(1).uniform(0.0, 2.0, clean.shape).astype(np.float32)

# Beside the beauty goes what else the renderer knows, here the albedo. Each guide that is there helps; none has to be.
# lam = 1 is the cleanest; up to 64 keeps ever more of the grain.
denoised = hush.denoise(noisy, albedo=np.broadcast_to(tint, clean.shape), lam=1.0)

before, after = np.abs(noisy - clean).mean(), np.abs(denoised - clean).mean()
print(f"mean error: {before:.4f} noisy, {after:.4f} denoised")
assert after < before / 4, "the noise is gone"

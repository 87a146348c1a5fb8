"""relMSE without the references' noise, from two independent halves of a reference's passes."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from training.benchmark import tables
from training.benchmark.frames import Image, Take, beauty, frame, numbers

PEER = "oidn_high"
METHODS = (PEER, "window0", "window2")


def halves(take: Take, number: int) -> tuple[Image, Image] | None:
    """The means of every other pass of a frame and of the rest; None where there is only one."""
    images = [beauty(path) for folder in take.passes if (path := frame(folder, number)).exists()]
    return (np.mean(images[::2], 0), np.mean(images[1::2], 0)) if len(images) > 1 else None


def relmse(denoised: Image, references: tuple[Image, Image], brightness: Image) -> float:
    """(d − a)(d − b) / (g² + 0.01): the noise of a and b is independent and averages out.

    g is an image as bright as the truth that knows nothing of a and b, the same for all methods: the peer's. As in `hush eval` images
    are scaled so that the reference's mean is 0.4.
    """
    gain = 0.4 / max(float((references[0] + references[1]).mean()) / 2, 1e-6)
    d, a, b, g = (image * gain for image in (denoised, *references, brightness))
    return float(((d - a) * (d - b) / (g**2 + 0.01)).mean())


def scores(take: Take, folders: dict[str, Path]) -> tuple[int, dict[str, float]]:
    """How many frames have two passes, and each method's mean over them."""
    found = {n: pair for n in numbers(take.reference) if (pair := halves(take, n)) is not None}
    peer = {n: beauty(frame(folders[PEER], n)) for n in found}
    mean = lambda folder: float(np.mean([relmse(beauty(frame(folder, n)), pair, peer[n]) for n, pair in found.items()]))
    return len(found), {method: mean(folders[method]) for method in METHODS} if found else {}


def report(measured: list[tuple[Take, dict[str, Path]]]) -> str:
    """A table of the takes that have frames with two passes; empty without any."""
    rows = []
    for take, folders in measured:
        count, found = scores(take, folders)
        if count:
            ratios = [f"{found[method] / found[PEER]:.2f}" for method in METHODS[1:]]
            rows.append([f"{take.shot}, {take.spp} spp", str(count), *(f"{found[m]:.5f}" for m in METHODS), *ratios])
    methods = ["OIDN 2.5.1 high", "Hush, window 0", "Hush, window ±2"]
    titles = ["relMSE without the references' noise", "frames", *methods, "window 0 over OIDN", "±2 over OIDN"]
    return tables.table(titles, rows) if rows else ""

"""Open Image Denoise 2.5.1 at high quality, by pyoidn; images are (rows, columns, 3), float32."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import pyoidn
from numpy.typing import NDArray

Image = NDArray[np.float32]


@contextmanager
def device(threads: int) -> Iterator[pyoidn.Device]:
    """A CPU device that leaves the other cores alone."""
    with pyoidn.Device() as made:
        made.set_int("numThreads", threads)
        made.set_bool("setAffinity", False)
        made.commit()
        yield made


def run_filter(device: pyoidn.Device, images: dict[str, Image], hdr: bool, clean_aux: bool) -> Image:
    """One run of the RT filter; images by OIDN's names."""
    out = np.zeros_like(next(iter(images.values())))
    with pyoidn.Filter(device, pyoidn.OIDN_FILTER_TYPE_RT) as f:
        for name, image in images.items():
            f.set_image(name, image, pyoidn.OIDN_FORMAT_FLOAT3)
        f.set_image(pyoidn.OIDN_IMAGE_OUTPUT, out, pyoidn.OIDN_FORMAT_FLOAT3)
        f.set_bool("hdr", hdr)
        f.set_bool("cleanAux", clean_aux)
        f.set_quality(pyoidn.OIDN_QUALITY_HIGH)
        f.commit()
        f.execute()
        problem = device.get_error()
    if problem is not None:
        raise SystemExit(f"OIDN failed: {problem}")
    return out


def high(device: pyoidn.Device, colour: Image, albedo: Image, normal: Image) -> Image:
    """With the guides as rendered."""
    return run_filter(device, {"color": colour, "albedo": albedo, "normal": normal}, True, False)


def clean_aux(device: pyoidn.Device, colour: Image, albedo: Image, normal: Image) -> Image:
    """With each guide filtered by itself first."""
    albedo = run_filter(device, {"albedo": albedo}, False, False)
    normal = run_filter(device, {"normal": normal}, False, False)
    return run_filter(device, {"color": colour, "albedo": albedo, "normal": normal}, True, True)

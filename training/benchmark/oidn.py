"""Open Image Denoise by pyoidn, as Cycles runs it and in simpler modes; images are (rows, columns, 3), float32.

training/requirements.txt names the version; what is installed is what is measured.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from importlib import metadata

import numpy as np
import pyoidn
from numpy.typing import NDArray

Image = NDArray[np.float32]


def version() -> str:
    """Of the library in the package, whose own version has one number more."""
    return ".".join(metadata.version("pyoidn").split(".")[:3])


@contextmanager
def device(threads: int) -> Iterator[pyoidn.Device]:
    """A CPU device that leaves the other cores alone."""
    with pyoidn.Device() as made:
        made.set_int("numThreads", threads)
        made.set_bool("setAffinity", False)
        made.commit()
        yield made


def run_filter(
    device: pyoidn.Device, images: dict[str, Image], hdr: bool, clean_aux: bool, quality: int = pyoidn.OIDN_QUALITY_HIGH
) -> Image:
    """One run of the RT filter; images by OIDN's names."""
    out = np.zeros_like(next(iter(images.values())))
    with pyoidn.Filter(device, pyoidn.OIDN_FILTER_TYPE_RT) as f:
        for name, image in images.items():
            f.set_image(name, image, pyoidn.OIDN_FORMAT_FLOAT3)
        f.set_image(pyoidn.OIDN_IMAGE_OUTPUT, out, pyoidn.OIDN_FORMAT_FLOAT3)
        f.set_bool("hdr", hdr)
        f.set_bool("cleanAux", clean_aux)
        f.set_quality(quality)
        f.commit()
        f.execute()
        problem = device.get_error()
    if problem is not None:
        raise SystemExit(f"OIDN failed: {problem}")
    return out


def clean_aux(device: pyoidn.Device, colour: Image, albedo: Image, normal: Image) -> Image:
    """As Cycles runs it by default (prefilter Accurate, quality High): each guide filtered by itself first."""
    albedo = run_filter(device, {"albedo": albedo}, False, False)
    normal = run_filter(device, {"normal": normal}, False, False)
    return run_filter(device, {"color": colour, "albedo": albedo, "normal": normal}, True, True)


def high(device: pyoidn.Device, colour: Image, albedo: Image, normal: Image) -> Image:
    """With the guides as rendered."""
    return run_filter(device, {"color": colour, "albedo": albedo, "normal": normal}, True, False)


def fast(device: pyoidn.Device, colour: Image, albedo: Image, normal: Image) -> Image:
    """The same at quality Fast."""
    return run_filter(device, {"color": colour, "albedo": albedo, "normal": normal}, True, False, pyoidn.OIDN_QUALITY_FAST)


# By the names that tables.METHODS has for them.
METHODS = {"oidn_clean_aux": clean_aux, "oidn_high": high, "oidn_fast": fast}

"""What the reference library, OpenEXR, finds in the files that Hush writes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import pytest
from conftest import Hush
from exr_shots import HEIGHT, WIDTH, passes

# One of each type that a pipeline writes, with the names that the format knows where it knows some.
ATTRIBUTES: dict[str, Any] = {
    "chromaticities": (0.7347, 0.2653, 0.0, 1.0, 0.0001, -0.077, 0.32168, 0.33767),
    "adoptedNeutral": np.array([0.32168, 0.33767], np.float32),
    "whiteLuminance": 100.0,
    "pixelAspectRatio": 1.5,
    "screenWindowCenter": np.array([0.25, -0.125], np.float32),
    "dataWindow": (np.array([-8, 6], np.int32), np.array([WIDTH - 9, HEIGHT + 5], np.int32)),
    "displayWindow": (np.array([0, 0], np.int32), np.array([1919, 1079], np.int32)),
    "timeCode": OpenEXR.TimeCode(1, 2, 3, 4, 0, 0, 0, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8),
    "keyCode": OpenEXR.KeyCode(12, 34, 1234, 5678, 90, 4, 64),
    "envmap": OpenEXR.ENVMAP_LATLONG,
    "worldToCamera": np.eye(4, dtype=np.float32) * 2,
    "studio/matrix": np.eye(3, dtype=np.float64),
    "studio/point": np.array([1, 2, 3], np.int32),
    "studio/box": (np.array([0, 0.5], np.float32), np.array([1, 2], np.float32)),
    "studio/texts": ["left", "", "a longer one"],
    "comments": "Wüste, 砂漠",
    "cryptomatte/542cafa/manifest": "{" + ",".join(f'"object {i}":"{i:08x}"' for i in range(5000)) + "}",
}


def write(path: Path, number: int, in_parts: bool) -> None:
    """A frame with guides, a Cryptomatte and whole numbers, and the attributes in each part."""
    found = passes(number)
    random = np.random.default_rng(number)
    bits = random.integers(0, 1 << 32, (HEIGHT, WIDTH, 4), np.uint32)
    groups = {
        "ViewLayer.Combined": ("RGB", found["color"].astype(np.float16)),
        "ViewLayer.Denoising Albedo": ("RGB", found["albedo"]),
        "ViewLayer.Vector": ("XYZW", found["vector"]),
        "ViewLayer.CryptoObject00": ("rgba", bits.view(np.float32)),
        "ViewLayer.IndexOB": ("X", bits[:, :, :1] % 9),
    }
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage, **ATTRIBUTES}
    planes = lambda name, letters, image: {f"{name}.{k}": np.ascontiguousarray(image[:, :, i]) for i, k in enumerate(letters)}
    split = {name: planes(name, *group) for name, group in groups.items()}
    if in_parts:
        OpenEXR.File([OpenEXR.Part({**header, "name": name}, channels, name) for name, channels in split.items()]).write(str(path))
    else:
        OpenEXR.File(header, {k: v for channels in split.values() for k, v in channels.items()}).write(str(path))


def described(part: OpenEXR.Part) -> dict[str, str]:
    """The attributes of a part but its channels and what Hush adds, each with its type."""
    return {k: f"{type(v).__name__} {v!r}" for k, v in part.header.items() if k not in ("channels", "hush")}


@pytest.mark.parametrize("in_parts", [False, True])
def test_nothing_but_the_beauty_changes(hush: Hush, tmp_path: Path, in_parts: bool) -> None:
    (tmp_path / "shot").mkdir()
    for number in (1, 2):
        write(tmp_path / "shot" / f"f_{number:04d}.exr", number, in_parts)
    result = hush("denoise", tmp_path / "shot", "-o", tmp_path / "out", "-q")
    assert result.returncode == 0, result.stderr
    before, after = (OpenEXR.File(str(tmp_path / of / "f_0002.exr"), separate_channels=True).parts for of in ("shot", "out"))
    assert len(before) == len(after)
    for old, new in zip(before, after, strict=True):
        assert described(old) == described(new)
        assert new.header["hush"].startswith("hush ")
        assert list(old.channels) == list(new.channels)
        for name, channel in old.channels.items():
            a, b = channel.pixels, new.channels[name].pixels
            assert a.dtype == b.dtype
            assert (a.tobytes() == b.tobytes()) != name.startswith("ViewLayer.Combined."), name
    assert (tmp_path / "out" / "f_0002.exr").stat().st_size < 1.2 * (tmp_path / "shot" / "f_0002.exr").stat().st_size

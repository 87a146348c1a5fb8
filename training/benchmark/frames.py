"""The benchmark's frames: where they lie in the cache, and their passes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import OpenEXR
from numpy.typing import NDArray

Image = NDArray[np.float32]
# The first four have tables of their own, so that numbers of different days can be compared.
FIRST_SHOTS = ("interior", "garden", "glass", "walker")
SHOTS = (*FIRST_SHOTS, "fog", "fur")
SPP = (4, 32)


@dataclass(frozen=True)
class Take:
    """One shot at one number of samples; the passes of its references are those of the cache, or of another one."""

    cache: Path
    shot: str
    spp: int
    references: Path | None = None

    @property
    def noisy(self) -> Path:
        return self.cache / self.shot / f"{self.spp}spp"

    @property
    def reference(self) -> Path:
        return self.cache / self.shot / "reference"

    @property
    def halves(self) -> tuple[Path, Path]:
        """References from every other pass and from the rest: their noise has nothing to do with each other's."""
        return self.cache / self.shot / "reference-a", self.cache / self.shot / "reference-b"

    def peer(self, method: str, version: str) -> Path:
        """Frames of OIDN of a version, by a method."""
        return self.cache / self.shot / f"{self.spp}spp-{method}-{version}"

    @property
    def most_samples(self) -> Take:
        """The shot's take with the most samples that has every frame of the reference."""
        found = [replace(self, spp=spp) for spp in levels(self.cache, self.shot)]
        return [take for take in found if set(numbers(self.reference)) <= set(numbers(take.noisy))][-1]

    @property
    def passes(self) -> list[Path]:
        """The folders of the reference's passes."""
        folder = (self.references or self.cache) / self.shot
        return sorted(folder.glob("pass[0-9]*"), key=lambda folder: int(folder.name.removeprefix("pass")))

    @property
    def passes_a_frame(self) -> str:
        """How many passes each frame of the reference is the mean of: `2`, or `1 to 2` where some have fewer."""
        counts = [sum(frame(folder, n).exists() for folder in self.passes) for n in numbers(self.reference)]
        return " to ".join(map(str, sorted({min(counts), max(counts)})))

    def average(self) -> None:
        """Writes the reference's frames, the means of the passes that have them, and those of its halves where there are two passes."""
        for number in sorted({n for folder in self.passes for n in numbers(folder)}):
            sources = [path for folder in self.passes if (path := frame(folder, number)).exists()]
            write_mean(frame(self.reference, number), sources)
            if len(sources) > 1:
                for half, first in zip(self.halves, (0, 1), strict=True):
                    write_mean(frame(half, number), sources[first::2])


def write_mean(target: Path, sources: Sequence[Path]) -> None:
    """The mean of files' beauty, in place of any other: it may be of other passes, which no file's age tells."""
    mean = np.mean([beauty(path) for path in sources], 0)
    if not target.exists() or not np.array_equal(beauty(target), mean, equal_nan=True):
        write_beauty(target, mean)


def numbers(folder: Path) -> list[int]:
    """The frames that a folder has."""
    return sorted(int(path.stem.rsplit("_", 1)[1]) for path in folder.glob("frame_*.exr"))


def frame(folder: Path, number: int) -> Path:
    return folder / f"frame_{number:04d}.exr"


def levels(cache: Path, shot: str) -> list[int]:
    """The numbers of samples that a shot has noisy frames of, ascending."""
    folders = ((folder, folder.name.removesuffix("spp")) for folder in (cache / shot).glob("*spp"))
    return sorted(int(name) for folder, name in folders if name.isdecimal() and numbers(folder))


def shared_levels(cache: Path, shots: Sequence[str]) -> list[int]:
    """The numbers of samples that all the shots have."""
    return sorted(set.intersection(*(set(levels(cache, shot)) for shot in shots)))


def takes(cache: Path, shots: Sequence[str], spp: Sequence[int], references: Path | None = None) -> list[Take]:
    """What can be measured; whatever has no reference yet, or too few noisy frames, is left out and said so."""
    found = []
    for shot in shots:
        for samples in spp:
            take = Take(cache, shot, samples, references)
            take.average()
            noisy, clean = numbers(take.noisy), numbers(take.reference)
            missing = sorted(set(clean) - set(noisy))
            if clean and not missing:
                found.append(take)
            else:
                print(f"{shot} at {samples} spp left out: {f'no noisy frame {missing[0]}' if missing else 'no reference'}", flush=True)
    return found


def passes(path: Path, wanted: dict[str, str]) -> dict[str, Image]:
    """Passes by name, with their components in that order, (rows, columns, components), float32."""
    planes = {}
    for part in OpenEXR.File(str(path), separate_channels=True).parts:
        for name, channel in part.channels.items():
            layer, _, component = name.rpartition(".")
            planes[layer.rpartition(".")[2], component] = channel.pixels
    missing = next((name for name in wanted if (name, wanted[name][0]) not in planes), None)
    if missing:
        raise SystemExit(f"{path}: no pass {missing}")
    return {name: np.stack([planes[name, c] for c in parts], -1).astype(np.float32) for name, parts in wanted.items()}


def beauty(path: Path) -> Image:
    return passes(path, {"Combined": "RGB"})["Combined"]


def for_oidn(path: Path) -> tuple[Image, Image, Image]:
    """Beauty, albedo and normal, in the ranges that OIDN takes."""
    colour, albedo, normal = passes(path, {"Combined": "RGB", "Denoising Albedo": "RGB", "Denoising Normal": "XYZ"}).values()
    return np.ascontiguousarray(colour.clip(0)), np.ascontiguousarray(albedo.clip(0, 1)), np.ascontiguousarray(normal)


def write_beauty(path: Path, image: Image) -> None:
    """A file with the beauty alone, named as Blender does; written aside and moved into place."""
    path.parent.mkdir(parents=True, exist_ok=True)
    channels = {f"ViewLayer.Combined.{c}": np.ascontiguousarray(image[..., i], dtype=np.float32) for i, c in enumerate("RGB")}
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    aside = path.with_suffix(".part")
    OpenEXR.File([OpenEXR.Part(header, channels, "ViewLayer.Combined")]).write(str(aside))
    aside.replace(path)

"""Makes the pictures of the sample shot: crops of one frame side by side, and those of a store's page.

pip install numpy OpenEXR pillow
hush denoise samples/shot -o denoised
python samples/pictures.py denoised                   # docs/before-after.png: noisy, denoised by Hush, the reference
hush denoise samples/shot -o mapped --frames 4 --lambda-images "samples/mask/mask_####.exr" --lambda-masked 64
python samples/pictures.py denoised --mapped mapped   # docs/lambda-map.png: noisy, λ 1, λ 64 on Suzanne alone
python samples/pictures.py denoised --store release   # release/icon.png and release/featured.png, for extensions.blender.org
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import OpenEXR
from PIL import Image, ImageDraw, ImageFont

HERE = Path(__file__).resolve().parent
SAMPLES = 12  # of each pixel of the sample shot
ICON = (170, 60, 128)  # column, row and side of the icon's part of the frame


@dataclass(frozen=True)
class Layout:
    """Pixels between the crops, of the band with their names, and of these."""

    gap: int = 6
    band: int = 26
    letters: int = 15


LAYOUT = Layout()


def combined(path: Path) -> np.ndarray:
    """The beauty of a frame, (height, width, 3), linear."""
    planes = {}
    for part in OpenEXR.File(str(path), separate_channels=True).parts:
        for name, channel in part.channels.items():
            layer, _, component = name.rpartition(".")
            if layer == "Combined" or layer.endswith(".Combined"):
                planes[component] = channel.pixels
    if not {"R", "G", "B"} <= planes.keys():
        raise SystemExit(f"{path}: no Combined")
    return np.stack([planes[c] for c in "RGB"], -1).astype(np.float32)


def displayed(linear: np.ndarray, exposure: float) -> np.ndarray:
    """Filmic tone curve (Narkowicz's fit of ACES) and sRGB, as bytes."""
    x = np.clip(np.nan_to_num(linear, posinf=65504.0), 0, None) * 2.0**exposure
    x = np.clip(x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14), 0, 1)
    x = np.where(x < 0.0031308, 12.92 * x, 1.055 * x ** (1 / 2.4) - 0.055)
    return np.round(x * 255).astype(np.uint8)


def picture(
    frames: list[tuple[str, np.ndarray]], box: tuple[int, int, int, int], zoom: int, exposure: float, layout: Layout = LAYOUT
) -> Image.Image:
    """The crops of all frames in a row, enlarged without smoothing, each under its name."""
    x, y, width, height = box
    size = (len(frames) * (width * zoom + layout.gap) - layout.gap, height * zoom + layout.band)
    sheet = Image.new("RGB", size, (255, 255, 255))
    draw, font = ImageDraw.Draw(sheet), ImageFont.load_default(layout.letters)
    for i, (name, linear) in enumerate(frames):
        crop = Image.fromarray(displayed(linear[y : y + height, x : x + width], exposure))
        left = i * (width * zoom + layout.gap)
        sheet.paste(crop.resize((width * zoom, height * zoom), Image.Resampling.NEAREST), (left, layout.band))
        draw.text((left + width * zoom / 2, layout.band / 2), name, fill=(40, 40, 40), font=font, anchor="mm")
    return sheet


def divided(noisy: np.ndarray, denoised: np.ndarray, zoom: int, exposure: float) -> Image.Image:
    """The noisy frame left of a slanting line, the denoised one right of it, enlarged without smoothing."""
    height, width = noisy.shape[:2]
    size = (width * zoom, height * zoom)
    images = [Image.fromarray(displayed(frame, exposure)).resize(size, Image.Resampling.NEAREST) for frame in (noisy, denoised)]
    top, bottom = size[0] / 2 + size[1] / 12, size[0] / 2 - size[1] / 12
    mask = Image.new("L", size, 0)
    ImageDraw.Draw(mask).polygon([(0, 0), (top, 0), (bottom, size[1]), (0, size[1])], fill=255)
    whole = Image.composite(images[0], images[1], mask)
    ImageDraw.Draw(whole).line([(top, 0), (bottom, size[1])], fill=(255, 255, 255), width=max(2, size[1] // 180))
    return whole


def store(noisy: np.ndarray, denoised: np.ndarray, exposure: float, folder: Path) -> None:
    """The icon, 256 × 256, around Suzanne's face, and the featured image, 1920 × 1080, of the whole frame."""
    height, width = noisy.shape[:2]
    featured = divided(noisy, denoised, 1920 // width, exposure)
    draw = ImageDraw.Draw(featured)
    for text, x, anchor in ((f"{SAMPLES} samples", 48, "ls"), ("Hush", featured.width - 48, "rs")):
        draw.text(
            (x, featured.height - 40),
            text,
            fill="white",
            font=ImageFont.load_default(56),
            anchor=anchor,
            stroke_width=3,
            stroke_fill="black",
        )
    x, y, side = ICON
    icon = divided(noisy[y : y + side, x : x + side], denoised[y : y + side, x : x + side], 256 // side, exposure)
    for name, image in (("featured.png", featured), ("icon.png", icon)):
        image.save(folder / name, optimize=True)
        print(f"{folder / name}: {image.width}×{image.height}, {(folder / name).stat().st_size // 1024} KB")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("denoised", type=Path, help="folder with Hush's frames")
    parser.add_argument("--frame", type=int, default=4)
    parser.add_argument("--crop", type=int, nargs=4, default=[158, 40, 150, 200], metavar=("X", "Y", "WIDTH", "HEIGHT"))
    parser.add_argument("--zoom", type=int, default=2)
    parser.add_argument("--exposure", type=float, default=0.3, help="stops")
    parser.add_argument("--mapped", type=Path, help="folder with Hush's frames under a mask of λ, for the other picture")
    parser.add_argument("--store", type=Path, metavar="FOLDER", help="make the icon and the featured image there instead")
    parser.add_argument("--output", type=Path, help="docs/before-after.png or docs/lambda-map.png")
    chosen = parser.parse_args()
    name = f"frame_{chosen.frame:04d}.exr"
    if chosen.store:
        return store(combined(HERE / "shot" / name), combined(chosen.denoised / name), chosen.exposure, chosen.store)
    folders = [(f"Cycles, {SAMPLES} samples", HERE / "shot")]
    if chosen.mapped:
        folders += [("Hush, lambda 1", chosen.denoised), ("Hush, lambda 64 on Suzanne", chosen.mapped)]
    else:
        folders += [("Hush", chosen.denoised), ("reference, 2000 samples", HERE / "reference")]
    frames = [(title, combined(folder / name)) for title, folder in folders]
    output = chosen.output or HERE.parent / "docs" / ("lambda-map.png" if chosen.mapped else "before-after.png")
    sheet = picture(frames, tuple(chosen.crop), chosen.zoom, chosen.exposure)
    sheet.save(output, optimize=True)
    print(f"{output}: {sheet.width}×{sheet.height}, {output.stat().st_size // 1024} KB")


if __name__ == "__main__":
    main()

"""Makes the valid and the damaged files of this folder; those found by fuzzing are kept as they were found.

python tests/corpus/make.py     (wants numpy, OpenEXR and usd-core: tests/requirements.txt)
"""

from __future__ import annotations

import json
import struct
import tempfile
from pathlib import Path

import numpy as np
import OpenEXR
from pxr import Sdf, Usd, UsdRender, UsdUtils

CORPUS = Path(__file__).resolve().parent
ROOT = CORPUS.parents[1]
ROWS, COLUMNS = 6, 8
CODECS = ["NO", "RLE", "ZIPS", "ZIP", "PIZ", "PXR24", "B44", "B44A", "DWAA", "DWAB"]
Channels = dict[str, np.ndarray]


def put(target: str, kind: str, name: str, content: bytes | str) -> None:
    path = CORPUS / target / kind / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content.encode() if isinstance(content, str) else content)


def crop() -> dict[str, Channels]:
    """A few pixels of the sample shot's first frame: each pass with its channels."""
    passes: dict[str, Channels] = {}
    for part in OpenEXR.File(str(ROOT / "samples" / "shot" / "frame_0001.exr"), separate_channels=True).parts:
        pixels = {name: channel.pixels[130 : 130 + ROWS, 200 : 200 + COLUMNS] for name, channel in part.channels.items()}
        passes[part.name()] = {name: np.ascontiguousarray(image) for name, image in pixels.items()}
    return passes


def exr(passes: dict[str, Channels], compression: str, multipart: bool, **more: object) -> bytes:
    header = {"compression": getattr(OpenEXR, f"{compression}_COMPRESSION"), "type": OpenEXR.scanlineimage, "Frame": "1"}
    header |= {"cycles.ViewLayer.samples": "12", **more}
    single = {"": {name: image for channels in passes.values() for name, image in channels.items()}}
    parts = [OpenEXR.Part(dict(header), dict(channels), name) for name, channels in (passes if multipart else single).items()]
    with tempfile.NamedTemporaryFile(suffix=".exr") as file:
        OpenEXR.File(parts).write(file.name)
        return Path(file.name).read_bytes()


def lights(passes: dict[str, Channels]) -> dict[str, Channels]:
    """The beauty with two light passes and the colour of one of them."""
    beauty = passes["ViewLayer.Combined"]
    made = {"ViewLayer.Combined": beauty}
    for name, share in [("Diffuse Direct", 0.7), ("Diffuse Color", 0.5), ("Emission", 0.3)]:
        images = {channel.replace("Combined", name): image * image.dtype.type(share) for channel, image in beauty.items()}
        made[f"ViewLayer.{name}"] = {channel: image for channel, image in images.items() if not channel.endswith(".A")}
    return made


def frames() -> None:
    passes = crop()
    whole = {codec: exr(passes, codec, codec in ("ZIP", "PIZ", "DWAA", "B44")) for codec in CODECS}
    for codec, content in whole.items():
        put("frame_file", "valid", f"{codec.lower()}.exr", content)
    beauty = {"ViewLayer.Combined": passes["ViewLayer.Combined"]}
    one = exr(beauty, "ZIP", False)
    put("frame_file", "valid", "one_pass.exr", one)
    put("frame_file", "valid", "light_passes.exr", exr(lights(passes), "ZIPS", True))
    half = {part: {name: image.astype(np.float16) for name, image in channels.items()} for part, channels in passes.items()}
    put("frame_file", "valid", "half.exr", exr(half, "PIZ", False))
    tiled = {"type": OpenEXR.tiledimage, "tiles": OpenEXR.TileDescription()}
    put("frame_file", "valid", "tiled.exr", exr(beauty, "ZIP", False, **tiled))
    for codec in ("ZIP", "PIZ", "B44", "DWAA", "PXR24"):
        put("frame_file", "damaged", f"{codec.lower()}_cut.exr", whole[codec][:-20])
    window = one.index(b"dataWindow\0box2i\0") + 21
    compression = one.index(b"compression\0compression\0") + 28
    channels = one.index(b"channels\0chlist\0") + 20

    def with_bytes(at: int, new: bytes) -> bytes:
        return one[:at] + new + one[at + len(new) :]

    damaged = {
        "empty": b"",
        "magic": b"\0" + one[1:],
        "header_cut": one[:100],
        "vast": with_bytes(window + 8, struct.pack("<2i", 2**31 - 1, 2**31 - 1)),
        "larger": with_bytes(window + 8, struct.pack("<2i", 4095, 4095)),
        "inverted": with_bytes(window, struct.pack("<2i", 100, 100)),
        "unknown_codec": with_bytes(compression, b"\x63"),
        "other_codec": with_bytes(compression, b"\x09"),
        "channels_long": with_bytes(channels - 4, struct.pack("<I", 0x7FFFFFFF)),
        "table_zero": with_bytes(len(one) - one[::-1].index(struct.pack("<i", 0)[::-1]) - 4, b"\xff"),
        "pixels": one[:-30] + b"\xff" * 30,
    }
    for name, content in damaged.items():
        put("frame_file", "damaged", f"{name}.exr", content)


def settings() -> None:
    full = (
        'enable = true\ninput = "shot_####.exr"\noutput = "out"\nframes = "1-48,60"\nlambda = [[1, 1], [24.5, 8]]\nwindow = 2\n'
        'layers = ["ViewLayer", "Set"]\nview = "left"\nvector_layer = "V"\naovs = "all"\nguides = ["albedo", "depth"]\n'
        'keep_noisy = true\nmodel = "m.safetensors"\nrenderer = "cycles"\nmemory = "4G"\nusd = "shot.usda@/Render/Pass"\n'
        '[passes]\nbeauty = "C"\nalbedo = "A"\nnormal = "N"\ndepth = "Z"\nvector = "V"\n'
    )
    valid = {"full": full, "empty": "", "lambda": "lambda = 8", "memory": "memory = 4294967296", "none": 'guides = "none"\naovs = []'}
    for name, text in valid.items():
        put("settings_file", "valid", f"{name}.toml", text)
    damaged = {
        "syntax": "lambda 4",
        "unknown": "lamda = 4",
        "type": 'lambda = "4"',
        "range": "lambda = 0.5",
        "nan": "lambda = nan",
        "twice": "lambda = [[1, 2], [1, 3]]",
        "negative": "window = -1",
        "backwards": 'frames = "9-1"',
        "passes": "passes = 3",
        "usd": "usd = 3",
        "memory": 'memory = "99999999999999999999T"',
        "nested": "a" + ".a" * 2000 + " = 1",
        "brackets": "lambda = " + "[" * 2000 + "1" + "]" * 2000,
        "not_text": b"lambda = \xff\xfe",
        "key_twice": "lambda = 1\nlambda = 2",
    }
    for name, content in damaged.items():
        put("settings_file", "damaged", f"{name}.toml", content)


def layers() -> None:
    with tempfile.TemporaryDirectory() as folder:
        base = Path(folder) / "base.usda"
        stage = Usd.Stage.CreateNew(str(base))
        render = UsdRender.Settings.Define(stage, "/Render/Settings")
        product = UsdRender.Product.Define(stage, "/Render/Product")
        product.CreateProductNameAttr("shot_####.exr")
        var = UsdRender.Var.Define(stage, "/Render/Beauty")
        var.CreateSourceNameAttr("Combined")
        product.CreateOrderedVarsRel().AddTarget(var.GetPath())
        render.CreateProductsRel().AddTarget(product.GetPath())
        prim = UsdRender.Pass.Define(stage, "/Render/Pass")
        prim.CreateRenderSourceRel().AddTarget(render.GetPath())

        def attribute(name: str, kind: Sdf.ValueTypeName) -> Usd.Attribute:
            return prim.GetPrim().CreateAttribute(f"hush:{name}", kind, custom=False)

        dial = attribute("lambda", Sdf.ValueTypeNames.Float)
        dial.Set(1.5, 10.0)
        dial.Set(8.0, 20.0)
        attribute("window", Sdf.ValueTypeNames.Int).Set(1)
        attribute("layers", Sdf.ValueTypeNames.TokenArray).Set(["Characters", "Set"])
        stage.Save()
        text = base.read_text()
        stage.Export(str(Path(folder) / "shot.usdc"))
        binary = (Path(folder) / "shot.usdc").read_bytes()
        UsdUtils.CreateNewUsdzPackage(str(base), str(Path(folder) / "shot.usdz"))
        packed = (Path(folder) / "shot.usdz").read_bytes()
    for name, content in {"text.usda": text.encode(), "binary.usdc": binary, "packed.usdz": packed}.items():
        put("usd_layer", "valid", name, content)
        kind = name.split(".")[1]
        put("usd_layer", "damaged", f"cut.{kind}", content[: len(content) // 2])
    damaged = {
        "empty": "",
        "no_usd": "hello",
        "no_prim": "#usda 1.0\n",
        "type": text.replace("int hush:window = 1", 'string hush:window = "one"'),
        "range": text.replace("10: 1.5", "10: 0.5"),
        "circle": text.replace("#usda 1.0\n", "#usda 1.0\n(\n subLayers = [@stage.usda@]\n)\n"),
        "sublayer_gone": text.replace("#usda 1.0\n", "#usda 1.0\n(\n subLayers = [@gone.usda@]\n)\n"),
        "deep": "#usda 1.0\n" + 'def "a" {' * 600 + "}" * 600,
        "garbage.usdc": b"PXR-USDC" + bytes(range(256)),
        "toc_far.usdc": binary[:16] + struct.pack("<q", 2**62) + binary[24:],
        "garbage.usdz": b"PK\x03\x04" + bytes(range(256)),
    }
    for name, content in damaged.items():
        put("usd_layer", "damaged", name if "." in name else f"{name}.usda", content)


def manifests() -> None:
    stamp = {"size": 1234, "modified": 1700000000.5, "content": None}
    neighbour = {"offset": 1, "frame": 2, "used": False, "reason": "missing"}
    entry = {
        "frame": 1,
        "source": "/shot/f_0001.exr",
        "stamp": None,
        "status": "denoised",
        "settings": "a",
        "hush": "0.1.0",
        "neighbours": [neighbour],
        "warnings": ["odd"],
        "seconds": 1.5,
    }
    del stamp
    put("manifest", "valid", "empty.json", json.dumps({"version": 1, "settings": {}, "frames": {}}))
    put("manifest", "valid", "frame.json", json.dumps({"version": 1, "settings": {}, "frames": {"f_0001.exr": entry}}))
    whole = json.dumps({"version": 1, "settings": {}, "frames": {"f_0001.exr": entry}})
    damaged = {
        "empty": "",
        "list": "[]",
        "cut": whole[: len(whole) // 2],
        "later": whole.replace('"version": 1', '"version": 99'),
        "version": whole.replace('"version": 1', '"version": -1'),
        "status": whole.replace("denoised", "fine"),
        "frame": whole.replace('"frame": 1', '"frame": 1e300'),
        "seconds": whole.replace("1.5", "1e999"),
        "nested": "[" * 5000 + "]" * 5000,
        "not_text": b"{\xff}",
    }
    for name, content in damaged.items():
        put("manifest", "damaged", f"{name}.json", content)


def weights() -> None:
    model = (ROOT / "tests" / "data" / "golden_model.safetensors").read_bytes()
    length = struct.unpack("<Q", model[:8])[0]
    header = json.loads(model[8 : 8 + length])
    text = json.dumps(header, separators=(",", ":"))
    put("weights", "valid", "header.json", text)

    def architecture(**changes: object) -> str:
        described = json.loads(header["__metadata__"]["hush.architecture"]) | changes
        return json.dumps(header | {"__metadata__": header["__metadata__"] | {"hush.architecture": json.dumps(described)}})

    damaged: dict[str, bytes | str] = {
        "empty.safetensors": b"",
        "garbage.safetensors": b"\xff" * 64,
        "length.safetensors": struct.pack("<Q", 2**63) + b"{}",
        "cut.safetensors": model[: 8 + length + 100],
        "no_architecture.json": json.dumps({k: v for k, v in header.items() if k != "__metadata__"}),
        "version.json": architecture(version=3),
        "width.json": architecture(features=24),
        "vast.json": architecture(features=2**60),
        "other_width.json": architecture(half=48),
        "blocks.json": architecture(blocks_encoder=10**9),
        "epsilon.json": architecture(albedo_epsilon=0.0),
        "offsets.json": text.replace("[0,64]", "[64,0]"),
        "shape.json": text.replace("[16,16,3,3]", "[4294967296,4294967296,4294967296,3]", 1),
        "type.json": text.replace('"F32"', '"I64"', 1),
    }
    for name, content in damaged.items():
        put("weights", "damaged", name, content)


def texts() -> None:
    for name, text in {"lambda": "8", "keys": "24:9, 1.5:1,-4:2", "frames": "1-48,60", "negative": "-5--2,-1..3"}.items():
        put("texts", "valid", f"{name}.txt", text)
    damaged = {"empty": "", "dash": "1-", "backwards": "5-1", "key": "1:", "twice": "1:2,1:3", "stage": "a.usda@/R"}
    for name, text in damaged.items():
        put("texts", "damaged", f"{name}.txt", text)


def engine_inputs() -> None:
    """Descriptions of frames, as fuzz/src/engine.rs reads them: whatever the bytes are, they say something."""
    random = np.random.default_rng(13)
    for index in range(24):
        # The first byte says that λ is in its range.
        content = b"\0" + random.integers(0, 256, 200 + 10 * index, dtype=np.uint8).tobytes()
        put("engine", "valid", f"random_{index:02}.bin", content)
    put("engine", "valid", "empty.bin", b"")


if __name__ == "__main__":
    for make in [frames, settings, layers, manifests, weights, texts, engine_inputs]:
        make()

"""What the weights file says about itself, read with the standard library alone; no PyTorch."""

from __future__ import annotations

import json
import math
import re
import struct
from pathlib import Path
from typing import Any

import pytest
from conftest import ROOT, Hush

WEIGHTS = ROOT / "models" / "hush.safetensors"
BYTES = {"F16": 2, "F32": 4}


@pytest.fixture(scope="module")
def header() -> dict[str, Any]:
    """The JSON header of the safetensors file: metadata and tensors."""
    data = WEIGHTS.read_bytes()
    (length,) = struct.unpack("<Q", data[:8])
    return json.loads(data[8 : 8 + length])


@pytest.fixture(scope="module")
def record(header: dict[str, Any]) -> dict[str, Any]:
    """The three parts of the record, decoded."""
    return {key: json.loads(header["__metadata__"][f"hush.{key}"]) for key in ("architecture", "training", "validation")}


def tensors(header: dict[str, Any]) -> dict[str, Any]:
    return {name: about for name, about in header.items() if name != "__metadata__"}


def test_no_validation_shot_was_trained_on(record: dict[str, Any]) -> None:
    trained, held = record["training"]["seeds"], record["validation"]["seeds"]
    assert len(trained) == len(set(trained)) > 0
    assert len(held) == len(set(held)) > 0
    assert [seed for seed in trained if seed % 8 == 0] == []
    assert [seed for seed in held if seed % 8] == []


def test_the_second_pass_was_trained_on_no_validation_shot(header: dict[str, Any], record: dict[str, Any]) -> None:
    assert record["architecture"]["second_pass"] == 1
    seeds = json.loads(header["__metadata__"]["hush.second_pass"])["seeds"]
    assert len(seeds) == len(set(seeds)) > 0
    assert [seed for seed in seeds if seed % 8 == 0] == []


def test_the_measured_numbers_stand_in_the_header(record: dict[str, Any]) -> None:
    assert record["training"]["steps"] > 0
    assert record["training"]["seconds"] > 0
    alone, window = (record["validation"][f"smape_window_{n}"] for n in (0, 2))
    assert 0 < window < alone < 1, "neighbours must help"


def test_further_encoders_have_the_first_ones_tensors_and_their_own_record(header: dict[str, Any]) -> None:
    found, metadata = tensors(header), header["__metadata__"]
    first, *others = json.loads(metadata["hush.encoders"])
    layers = {name.removeprefix("encoder."): about["shape"] for name, about in found.items() if name.startswith("encoder.")}
    assert first == "cycles"
    assert others == ["mitsuba"]
    for renderer in others:
        prefix = f"encoders.{renderer}."
        assert {name.removeprefix(prefix): about["shape"] for name, about in found.items() if name.startswith(prefix)} == layers
        trained, held = (json.loads(metadata[f"hush.{part}.{renderer}"]) for part in ("training", "validation"))
        assert trained["seeds"]
        assert [seed for seed in trained["seeds"] if seed % 8 == 0] == []
        assert held["seeds"]
        assert [seed for seed in held["seeds"] if seed % 8] == []
        assert held["smape_window_2"] < held["cycles_encoder_smape_window_2"]
        assert held["smape_window_0"] < held["cycles_encoder_smape_window_0"]


def test_the_tensors_have_the_shapes_that_the_architecture_says(header: dict[str, Any], record: dict[str, Any]) -> None:
    a, found = record["architecture"], tensors(header)
    assert (a["version"], a["levels"]) == (2, 4)
    shape = lambda name: found[f"{name}.weight"]["shape"]
    centre, near, coarse = a["centre_taps"] ** 2, a["neighbour_taps"] ** 2, a["coarse_taps"] ** 2
    assert shape("encoder.first") == [a["features"], 40, 3, 3]
    assert shape("to_quarter") == [a["quarter"], a["half"], 3, 3]
    assert shape("to_eighth") == [a["eighth"], a["quarter"], 3, 3]
    assert shape("head_half") == [4 * (centre + coarse + a["albedo_taps"] ** 2) + centre + coarse, a["half"], 1, 1]
    assert shape("head_quarter") == [centre + coarse, a["quarter"], 1, 1]
    assert shape("head_eighth") == [centre, a["eighth"], 1, 1]
    assert shape("pair_half_head") == [4 * (near + 1) + near, a["pair"], 1, 1]
    assert shape("lambda_half.scale") == [a["half"], a["lambda_hidden"]]
    assert shape("query_half") == [4 * 2 + 2, a["half"], 1, 1]
    assert shape("pair_half_query") == [4 * 2 + 2, a["pair"], 1, 1]
    assert shape("query_eighth") == [2, a["eighth"], 1, 1]
    folders = {"encoder": "encoder.blocks", "half": "half_in", "quarter": "quarter_in", "eighth": "eighth", "out": "half_out"}
    for part, folder in folders.items():
        blocks = {name.removeprefix(f"{folder}.").split(".")[0] for name in found if name.startswith(f"{folder}.")}
        assert len(blocks) == a[f"blocks_{part}"], part


def test_the_documented_architecture_is_that_of_the_program(header: dict[str, Any], record: dict[str, Any]) -> None:
    page = (ROOT / "training" / "README.md").read_text()
    rows = re.findall(r"^\| (\w+) \| ([\d.]+) \| ([\d.]+) \|", page, re.MULTILINE)
    assert {name: float(value) for name, _, value in rows} == record["architecture"]
    fields = re.findall(r"^    (\w+): (?:int|float) = ([\d.]+)$", (ROOT / "training" / "network" / "model.py").read_text(), re.MULTILINE)
    assert {name: value for name, value, _ in rows} == dict(fields)
    sizes = {name: math.prod(about["shape"]) for name, about in tensors(header).items()}
    others = sum(size for name, size in sizes.items() if name.startswith("encoders."))
    assert f"{sum(sizes.values()) - others:,} in the program, beside {others:,} of Mitsuba's encoder" in page


def test_the_file_holds_its_tensors_and_nothing_else(header: dict[str, Any]) -> None:
    end = 0
    for name, about in sorted(tensors(header).items(), key=lambda item: item[1]["data_offsets"]):
        first, last = about["data_offsets"]
        assert first == end, name
        assert last - first == math.prod(about["shape"]) * BYTES[about["dtype"]], name
        end = last
    data = WEIGHTS.read_bytes()
    assert len(data) == 8 + struct.unpack("<Q", data[:8])[0] + end
    assert len(data) < 8e6


def test_weights_without_their_header_are_refused(hush: Hush, shot: Path, tmp_path: Path) -> None:
    """The same tensors under an architecture that does not fit them, or none at all."""
    data = WEIGHTS.read_bytes()
    (length,) = struct.unpack("<Q", data[:8])
    whole = json.loads(data[8 : 8 + length])
    wider = json.loads(whole["__metadata__"]["hush.architecture"])
    wider["half"] += 16
    for name, metadata in {"wider": {**whole["__metadata__"], "hush.architecture": json.dumps(wider)}, "bare": {}}.items():
        text = json.dumps({**whole, "__metadata__": metadata}).encode()
        path = tmp_path / f"{name}.safetensors"
        path.write_bytes(struct.pack("<Q", len(text)) + text + data[8 + length :])
        result = hush("denoise", shot, "--output", tmp_path / name, "--frames", "1", "--model", path)
        assert result.returncode == 1, result.stderr
        assert path.name in result.stderr
        assert list(tmp_path.glob(f"{name}/*.exr")) == []

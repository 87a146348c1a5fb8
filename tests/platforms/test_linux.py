"""The Linux wheels: for glibc 2.28 and every Python from 3.11 on, and the x86-64 one installed and run, with the bits of a plain build."""

from __future__ import annotations

import os
import sys
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest
from conftest import SHOT, TARGET, Result, Wheels, command, instruction_sets, pixels, succeeded

MACHINES = {"manylinux_2_28_x86_64": 62, "manylinux_2_28_aarch64": 183}  # e_machine
LARGEST = 15_000_000


@pytest.mark.parametrize("tag", MACHINES)
def test_wheel(wheels: Wheels, tag: str) -> None:
    wheel = wheels.of(tag)
    assert wheel.name.endswith(f"-cp311-abi3-{tag}.whl")
    assert wheel.stat().st_size <= LARGEST
    with zipfile.ZipFile(wheel) as archive:
        names = archive.namelist()
        library = next(name for name in names if name.startswith("hush/_hush") and name.endswith(".so"))
        with archive.open(library) as file:
            header = file.read(20)
        licences = [archive.read(name) for name in names if name.endswith("licenses/LICENSE")]
        metadata = archive.read(next(name for name in names if name.endswith("METADATA"))).decode()
    assert library == "hush/_hush.abi3.so"
    assert header[:4] == b"\x7fELF" and int.from_bytes(header[18:20], "little") == MACHINES[tag]
    assert len(licences) == 1 and b"Apache License" in licences[0]
    assert "License-Expression: Apache-2.0\n" in metadata


@pytest.mark.parametrize("tag", MACHINES)
def test_auditwheel_agrees(wheels: Wheels, tag: str) -> None:
    said = " ".join(succeeded(command(Path(sys.executable).with_name("auditwheel"), "show", wheels.of(tag))).split())
    consistent = said.partition("is consistent with the following platform tag: ")[2].split('"')[1]
    version = tuple(int(part) for part in consistent.removeprefix("manylinux_").split("_")[:2])
    assert consistent.startswith("manylinux_") and version <= (2, 28), said


@pytest.fixture(scope="module")
def plain_hush() -> Path:
    """The program as `cargo install` makes it, with this machine's linker and glibc."""
    succeeded(command("cargo", "build", "--release", "--locked", env={**os.environ, "CARGO_TARGET_DIR": str(TARGET)}))
    return TARGET / "release" / "hush"


@pytest.mark.parametrize("simd", instruction_sets())
def test_the_wheel_has_the_bits_of_a_plain_build(linux_hush: Callable[..., Result], plain_hush: Path, tmp_path: Path, simd: str) -> None:
    succeeded(linux_hush("denoise", SHOT, "--output", tmp_path / "wheel", HUSH_SIMD=simd))
    succeeded(command(plain_hush, "denoise", SHOT, "--output", tmp_path / "plain", env={**os.environ, "HUSH_SIMD": simd}))
    assert pixels(tmp_path / "wheel").keys() == pixels(SHOT).keys()
    assert pixels(tmp_path / "wheel") == pixels(tmp_path / "plain")

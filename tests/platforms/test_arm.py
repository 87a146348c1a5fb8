"""The engine on aarch64 under qemu, against PyTorch's golden tensors; and a frame of the sample shot by the whole program."""

from __future__ import annotations

import os
import re
from collections.abc import Callable
from pathlib import Path

import pytest
from conftest import ARM, SHOT, TARGET, Result, cargo, command, instruction_sets, pixels, succeeded, tool

# All layers run on NEON and on the portable path, and must have the same bits; so do the golden tensors.
ROOMS = ["engine::", "frame::", "kernels::", "layers::", "network::", "simd::", "tiles::"]
# Threads hang under qemu 7.2 with glibc 2.36 as Debian's cross compiler has it; the one of libc6:arm64 is mended.
SYSROOT = "/" if Path("/lib/ld-linux-aarch64.so.1").exists() else "/usr/aarch64-linux-gnu"
FRAME = ["denoise", SHOT, "--frames", "4", "--window", "1", "--output"]


def emulated() -> dict[str, str]:
    """What has cargo link for aarch64 and run it here."""
    return {
        "CARGO_TARGET_AARCH64_UNKNOWN_LINUX_GNU_LINKER": tool("aarch64-linux-gnu-gcc"),
        "CARGO_TARGET_AARCH64_UNKNOWN_LINUX_GNU_RUNNER": f"{tool('qemu-aarch64-static', 'qemu-aarch64')} -L {SYSROOT}",
    }


def test_the_engine() -> None:
    told = succeeded(cargo(ARM, "test", "--lib", **emulated(), args=["--", *ROOMS]))
    passed = re.findall(r"^test (\S+) \.\.\. ok$", told, re.MULTILINE)
    assert {room for room in ROOMS if not any(name.startswith(room) for name in passed)} == set(), told
    assert any(name.startswith("engine::golden_tests::") for name in passed), told


@pytest.fixture(scope="module")
def frame(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., dict[str, bytes]]:
    """A frame of the sample shot, denoised under qemu."""
    succeeded(cargo(ARM, "build", **emulated()))
    program, qemu = TARGET / ARM / "release" / "hush", tool("qemu-aarch64-static", "qemu-aarch64")

    def denoised(simd: str, threads: int) -> dict[str, bytes]:
        output = tmp_path_factory.mktemp(f"{simd}-{threads}")
        env = {**os.environ, "HUSH_SIMD": simd, "RAYON_NUM_THREADS": str(threads)}
        succeeded(command(qemu, "-L", SYSROOT, program, *FRAME, output, env=env))
        found = pixels(output)
        assert len(found) == 1
        return found

    return denoised


@pytest.fixture(scope="module")
def neon(frame: Callable[..., dict[str, bytes]]) -> dict[str, bytes]:
    return frame("neon", 3)


def test_threads_change_no_bit(frame: Callable[..., dict[str, bytes]], neon: dict[str, bytes]) -> None:
    assert frame("neon", 1) == neon


def test_portable_has_the_bits_of_neon(frame: Callable[..., dict[str, bytes]], neon: dict[str, bytes]) -> None:
    assert frame("portable", 3) == neon


@pytest.mark.skipif("avx2" not in instruction_sets(), reason="this CPU lacks AVX2")
def test_avx2_has_the_bits_of_neon(linux_hush: Callable[..., Result], neon: dict[str, bytes], tmp_path: Path) -> None:
    succeeded(linux_hush(*FRAME, tmp_path, HUSH_SIMD="avx2"))
    assert pixels(tmp_path) == neon

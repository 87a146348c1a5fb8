"""The engine on aarch64 under qemu, against PyTorch's golden tensors; and the sample shot by the whole program."""

from __future__ import annotations

import os
import re
from pathlib import Path

from conftest import ARM, SHOT, TARGET, cargo, command, pixels, succeeded, tool

ROOMS = ["engine::", "frame::", "kernels::", "layers::", "network::", "simd::", "tiles::"]
# Threads hang under qemu 7.2 with glibc 2.36 as Debian's cross compiler has it; the one of libc6:arm64 is mended.
SYSROOT = "/" if Path("/lib/ld-linux-aarch64.so.1").exists() else "/usr/aarch64-linux-gnu"


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


def test_the_sample_shot(tmp_path: Path) -> None:
    succeeded(cargo(ARM, "build", **emulated()))
    program = TARGET / ARM / "release" / "hush"
    qemu = tool("qemu-aarch64-static", "qemu-aarch64")
    words = [qemu, "-L", SYSROOT, program, "denoise", SHOT, "--frames", "4", "--window", "1", "--output"]
    for threads in ("1", "3"):
        succeeded(command(*words, tmp_path / threads, env={**os.environ, "RAYON_NUM_THREADS": threads}))
    assert len(pixels(tmp_path / "1")) == 1 and pixels(tmp_path / "1") == pixels(tmp_path / "3")

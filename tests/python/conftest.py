"""Runs the built binary as a user would: HUSH_BIN, or target/release/hush."""

from __future__ import annotations

import os
import signal
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

# A shell's background job ignores Ctrl-C, and so would every process that the tests start.
signal.signal(signal.SIGINT, signal.default_int_handler)

ROOT = Path(__file__).resolve().parents[2]
Hush = Callable[..., subprocess.CompletedProcess[str]]


@pytest.fixture(scope="session")
def shot() -> Path:
    return ROOT / "samples" / "shot"


@pytest.fixture(scope="session")
def reference() -> Path:
    return ROOT / "samples" / "reference"


@pytest.fixture(scope="session")
def hush() -> Hush:
    """Calls hush with these arguments; returns what it said and its exit code."""
    binary = Path(os.environ.get("HUSH_BIN", ROOT / "target" / "release" / "hush"))
    if not binary.is_file():
        pytest.fail(f"{binary} is not there: cargo build --release, or set HUSH_BIN", pytrace=False)

    def call(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
        return subprocess.run([binary, *map(str, arguments)], capture_output=True, text=True, timeout=600, check=False)

    return call


@pytest.fixture(scope="session")
def command_line(hush: Hush) -> Hush:
    """The same, for tests that have the module by the name of hush."""
    return hush


@pytest.fixture(scope="session")
def denoised(hush: Hush, shot: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The sample shot, denoised once with the defaults."""
    output = tmp_path_factory.mktemp("denoised") / "shot"
    result = hush("denoise", shot, "--output", output)
    assert result.returncode == 0, result.stderr
    return output

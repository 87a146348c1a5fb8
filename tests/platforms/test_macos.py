"""macOS, where nothing of it runs: library, program and Python module pass the compiler's checks for both kinds of Mac."""

from __future__ import annotations

import pytest
from conftest import cargo, succeeded


@pytest.mark.parametrize("target", ["aarch64-apple-darwin", "x86_64-apple-darwin"])
def test_it_compiles(target: str) -> None:
    succeeded(cargo(target, "check", args=["--lib", "--bins", "--features", "python"]))

"""What the tests of the platforms share: wheels and programs built here for other systems, and how they are run."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
TARGET = Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target")).resolve()
SHOT = ROOT / "samples" / "shot"
WINDOWS, ARM = "x86_64-pc-windows-gnu", "aarch64-unknown-linux-gnu"
sys.path.append(str(ROOT / "release"))

import build_wheel as release  # noqa: E402 - a script of its own, not a package

Result = subprocess.CompletedProcess[str]


def command(*words: str | Path, env: dict[str, str] | None = None, cwd: Path = ROOT, limit: float = 5400) -> Result:
    """Runs a command to its end."""
    return subprocess.run(
        list(map(str, words)),
        env=env,
        cwd=cwd,
        timeout=limit,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        encoding="utf-8",
        errors="replace",
        check=False,
    )


def succeeded(result: Result) -> str:
    """The standard output of a command that must have succeeded."""
    assert result.returncode == 0, f"{result.args}\nexit code {result.returncode}\n{result.stdout[-8000:]}\n{result.stderr[-8000:]}"
    return result.stdout


def tool(*names: str) -> str:
    """The first of these programs that is there."""
    found = next((path for name in names if (path := shutil.which(name)) is not None), None)
    assert found is not None, f"none of {', '.join(names)} is there; tests/platforms/README.md says what to install"
    return found


def pixels(folder: Path) -> dict[str, bytes]:
    """The EXR files of a folder, byte for byte."""
    return {path.name: path.read_bytes() for path in sorted(folder.glob("*.exr"))}


def instruction_sets() -> list[str]:
    """Those of `HUSH_SIMD` that this machine has."""
    flags = set(Path("/proc/cpuinfo").read_text().split())
    have = {"avx2": {"avx2", "fma", "f16c"}, "avx512": {"avx2", "fma", "f16c", "avx512f"}}
    return ["portable", *(name for name, wanted in have.items() if wanted <= flags)]


@dataclass
class Wheels:
    """The wheels of a release, each built once, or taken from the folder `HUSH_TEST_WHEELS`."""

    built: dict[str, Path] = field(default_factory=dict)

    def of(self, tag: str) -> Path:
        """The wheel of a platform."""
        if tag not in self.built and (ready := os.environ.get("HUSH_TEST_WHEELS")):
            (self.built[tag],) = Path(ready).resolve().glob(f"hush_denoise-*-{tag}.whl")
        elif tag not in self.built:
            self.built[tag] = release.build(release.PLATFORMS[tag], TARGET / "wheels")
        return self.built[tag]


@pytest.fixture(scope="session")
def wheels() -> Wheels:
    return Wheels()


@pytest.fixture(scope="session")
def linux_hush(wheels: Wheels, tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Result]:
    """The command `hush` of the x86-64 Linux wheel, installed as a user does."""
    folder = tmp_path_factory.mktemp("installed")
    succeeded(command(sys.executable, "-m", "venv", folder))
    succeeded(command(folder / "bin/pip", "install", "--quiet", "--disable-pip-version-check", wheels.of("manylinux_2_28_x86_64")))

    def run(*words: str | Path, **variables: str) -> Result:
        return command(folder / "bin/hush", *words, env={**os.environ, **variables}, cwd=folder)

    return run


def cargo(target: str, *words: str, args: list[str] | None = None, **variables: str) -> Result:
    """Runs cargo for another system; the profile of a release, so that what is tested is what is shipped."""
    env = release.rust_environment(target) | {"CARGO_TARGET_DIR": str(TARGET)} | variables
    return command("cargo", *words, "--release", "--locked", "--target", target, *(args or []), env=env)

"""blender_addon/build.py: what it puts into the zip, the same bytes each time, and what it refuses. No Blender needed."""

from __future__ import annotations

import importlib.util
import os
import shutil
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path
from types import ModuleType

import pytest
from conftest import ROOT

SCRIPT = ROOT / "blender_addon" / "build.py"
VERSION = tomllib.loads((ROOT / "Cargo.toml").read_text())["package"]["version"]
LINUX, WINDOWS = "manylinux_2_34_x86_64", "win_amd64"


@pytest.fixture(scope="module")
def build() -> ModuleType:
    spec = importlib.util.spec_from_file_location("build_extension", SCRIPT)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def wheel(folder: Path, platform: str, version: str = VERSION, python: str = "cp311-abi3") -> Path:
    path = folder / f"hush_denoise-{version}-{python}-{platform}.whl"
    folder.mkdir(exist_ok=True)
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("hush/__init__.py", platform)
    return path


def run(output: Path, *wheels: Path, script: Path = SCRIPT) -> subprocess.CompletedProcess[str]:
    named = [argument for path in wheels for argument in ("--wheel", str(path))]
    command = [sys.executable, str(script), "--output", str(output), *named]
    return subprocess.run(command, capture_output=True, text=True, check=False)


@pytest.mark.parametrize(
    ("tag", "expected"),
    [
        (LINUX, ["linux-x64"]),
        ("linux_x86_64", ["linux-x64"]),
        ("manylinux_2_17_aarch64.manylinux2014_aarch64", ["linux-arm64"]),
        (WINDOWS, ["windows-x64"]),
        ("win_arm64", ["windows-arm64"]),
        ("macosx_11_0_arm64", ["macos-arm64"]),
        ("macosx_10_12_x86_64.macosx_11_0_arm64.macosx_10_12_universal2", ["macos-arm64", "macos-x64"]),
    ],
)
def test_names_of_platforms(build: ModuleType, tag: str, expected: list[str]) -> None:
    assert build.platforms(Path(f"hush_denoise-0.1.0-cp311-abi3-{tag}.whl")) == expected


def test_one_zip_a_platform(tmp_path: Path) -> None:
    result = run(tmp_path / "out", wheel(tmp_path, LINUX), wheel(tmp_path, WINDOWS))
    assert result.returncode == 0, result.stderr
    expected = {f"hush-{VERSION}-linux_x64.zip": ("linux-x64", LINUX), f"hush-{VERSION}-windows_x64.zip": ("windows-x64", WINDOWS)}
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == sorted(expected)
    for name, (platform, tag) in expected.items():
        with zipfile.ZipFile(tmp_path / "out" / name) as archive:
            names = archive.namelist()
            manifest = tomllib.loads(archive.read("blender_manifest.toml").decode())
        bundled = f"wheels/hush_denoise-{VERSION}-cp311-abi3-{tag}.whl"
        assert manifest["platforms"] == [platform] and manifest["wheels"] == [f"./{bundled}"]
        assert [n for n in names if n.endswith(".whl")] == [bundled]
        assert {"__init__.py", "LICENSE", "blender_manifest.toml"} <= set(names)
        assert not [n for n in names if "__pycache__" in n or n == "build.py" or n.endswith((".zip", ".pyc"))]


def test_the_same_bytes_again(tmp_path: Path) -> None:
    """From another checkout too, whose files have other dates and permissions."""
    made, checkout = wheel(tmp_path, LINUX), tmp_path / "checkout"
    copy = shutil.copytree(SCRIPT.parent, checkout / SCRIPT.parent.name, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(ROOT / "Cargo.toml", checkout)
    for path in copy.rglob("*"):
        path.chmod(0o700)
        os.utime(path, (1_000_000_000, 1_000_000_000))
    for name, script in (("first", SCRIPT), ("second", copy / SCRIPT.name)):
        result = run(tmp_path / name, made, script=script)
        assert result.returncode == 0, result.stderr
    first, second = ((tmp_path / name / f"hush-{VERSION}-linux_x64.zip").read_bytes() for name in ("first", "second"))
    assert first == second


def test_what_is_refused(tmp_path: Path) -> None:
    damaged = wheel(tmp_path / "damaged", LINUX)
    damaged.write_bytes(damaged.read_bytes()[:40])
    refused = {
        "is not there": [tmp_path / f"hush_denoise-{VERSION}-cp311-abi3-{LINUX}.whl"],
        "a wheel of this version starts with": [wheel(tmp_path, LINUX, version="9.9.9")],
        "starts with hush_denoise": [wheel(tmp_path, LINUX, python="cp312-cp312")],
        "damaged": [damaged],
        "unknown platform": [wheel(tmp_path, "any")],
        "several wheels for linux-x64": [wheel(tmp_path / "a", LINUX), wheel(tmp_path / "b", "linux_x86_64")],
    }
    for words, wheels in refused.items():
        result = run(tmp_path / "out", *wheels)
        assert result.returncode == 1 and words in result.stderr, (words, result.stdout, result.stderr)
        assert "Traceback" not in result.stderr
        assert not (tmp_path / "out").exists() or not list((tmp_path / "out").iterdir()), words

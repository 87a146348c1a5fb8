"""The extension's zips of all platforms, by what extensions.blender.org asks for and by Blender's own check."""

from __future__ import annotations

import ast
import io
import os
import re
import shutil
import sys
import tomllib
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest
from conftest import ROOT, SHOT, TARGET, Result, Wheels, command, pixels, release, succeeded

ADDON = ROOT / "blender_addon"
LARGEST = 15_000_000
HERE_BUILT = ["manylinux_2_28_x86_64", "manylinux_2_28_aarch64", "win_amd64"]
VENVS = Path(os.environ.get("HUSH_TEST_VENVS", TARGET / "bpy"))
sys.path.append(str(ROOT / "tests" / "blender"))

import venvs  # noqa: E402 - a script beside other tests

# What the platform's manual lists for add-ons, of what could concern Hush.
TAGS = {"Animation", "Camera", "Compositing", "Import-Export", "Lighting", "Material", "Node", "Pipeline", "Render", "Scene", "System"}

NETWORK = {"ensurepip", "ftplib", "http", "pip", "requests", "socket", "ssl", "urllib"}


@pytest.fixture(scope="module")
def blender() -> Path:
    """A Python with Blender 5.2."""
    venvs.install_libraries()
    return venvs.python_with_blender("5.2", VENVS)


@pytest.fixture(scope="module")
def zips(wheels: Wheels, blender: Path, tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """One zip a platform, from the wheels that can be built here."""
    output = tmp_path_factory.mktemp("zips")
    named = [word for tag in HERE_BUILT for word in ("--wheel", str(wheels.of(tag)))]
    told = succeeded(command(blender, ADDON / "build.py", *named, "--output", output))
    assert told.count("validated by Blender") == len(HERE_BUILT), told
    return sorted(output.glob("*.zip"))


def manifest_of(archive: Path) -> dict[str, object]:
    with zipfile.ZipFile(archive) as file:
        return tomllib.loads(file.read("blender_manifest.toml").decode())


def test_the_manifest_lists_the_wheels_of_a_release() -> None:
    manifest = tomllib.loads((ADDON / "blender_manifest.toml").read_text())
    version = manifest["version"]
    expected = sorted(f"./wheels/hush_denoise-{version}-cp311-abi3-{tag}.whl" for tag in release.PLATFORMS)
    assert manifest["wheels"] == expected
    assert manifest["platforms"] == ["linux-arm64", "linux-x64", "macos-arm64", "macos-x64", "windows-x64"]


def test_what_the_listing_asks_for() -> None:
    manifest = tomllib.loads((ADDON / "blender_manifest.toml").read_text())
    assert manifest["license"] == ["SPDX:GPL-3.0-or-later"]
    assert len(manifest["tagline"]) <= 64 and manifest["tagline"][-1].isalnum()
    assert set(manifest["tags"]) <= TAGS
    assert manifest["permissions"].keys() == {"files"}
    assert all(0 < len(reason) <= 64 and reason[-1].isalnum() for reason in manifest["permissions"].values())


def test_the_sources_are_of_one_licence() -> None:
    for path in ADDON.rglob("*.py"):
        text = path.read_text(encoding="utf-8")
        if path.name != "build.py" and text.strip():
            assert "# SPDX-License-Identifier: GPL-3.0-or-later\n" in text, path
    assert "GNU GENERAL PUBLIC LICENSE" in (ADDON / "LICENSE").read_text()
    assert "Apache License" in (ROOT / "LICENSE").read_text()


def test_what_reviewers_refuse() -> None:
    """A search path from where the add-on lies, and whatever reaches the network."""
    for path in (path for path in ADDON.rglob("*.py") if path.name != "build.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, (ast.Import, ast.ImportFrom)):
                names = [node.module or ""] if isinstance(node, ast.ImportFrom) else [alias.name for alias in node.names]
                assert NETWORK.isdisjoint(name.split(".")[0] for name in names), (path, node.lineno)
            if isinstance(node, ast.stmt) and not hasattr(node, "body"):
                code = ast.unparse(node)
                assert not ("sys.path" in code and "__file__" in code), (path, node.lineno)


def test_zips(zips: list[Path]) -> None:
    assert [re.sub(r"hush-[\d.]+-", "", path.name) for path in zips] == ["linux_arm64.zip", "linux_x64.zip", "windows_x64.zip"]
    for path in zips:
        manifest = manifest_of(path)
        assert path.stat().st_size <= LARGEST
        with zipfile.ZipFile(path) as file:
            names = file.namelist()
            assert "GNU GENERAL PUBLIC LICENSE" in file.read("LICENSE").decode()
        assert [f"./{name}" for name in names if name.endswith(".whl")] == manifest["wheels"]
        assert len(manifest["platforms"]) == len(manifest["wheels"]) == 1


@pytest.mark.parametrize("version", venvs.VERSIONS)
def test_blender_validates_each_zip(zips: list[Path], version: str) -> None:
    python = venvs.python_with_blender(version, VENVS)
    script = next(python.parents[1].glob("lib/*/site-packages/bpy/*/scripts/addons_core/bl_pkg/cli/blender_ext.py"))
    for path in zips:
        succeeded(command(python, script, "validate", path))


def test_blenders_own_builder_makes_the_same_zips(wheels: Wheels, blender: Path, tmp_path: Path) -> None:
    """`blender --command extension build --split-platforms` over the sources, with the wheels of a release in their place."""
    source = tmp_path / "source"
    shutil.copytree(ADDON, source, ignore=shutil.ignore_patterns("__pycache__", "*.whl"))
    (source / "wheels").mkdir(exist_ok=True)
    for tag in release.PLATFORMS:
        wheel = wheels.of(tag) if tag in HERE_BUILT else None
        name = f"hush_denoise-{tomllib.loads((ADDON / 'blender_manifest.toml').read_text())['version']}-cp311-abi3-{tag}.whl"
        # Those of macOS, which are not built here, are stood in for by an empty one.
        (source / "wheels" / name).write_bytes(wheel.read_bytes() if wheel else empty_wheel())
    script = next(blender.parents[1].glob("lib/*/site-packages/bpy/*/scripts/addons_core/bl_pkg/cli/blender_ext.py"))
    succeeded(command(blender, script, "build", "--split-platforms", "--source-dir", source, "--output-dir", tmp_path))
    assert len(list(tmp_path.glob("*.zip"))) == len(release.PLATFORMS)


def empty_wheel() -> bytes:
    """A wheel as far as Blender's builder looks."""
    held = io.BytesIO()
    with zipfile.ZipFile(held, "w") as archive:
        archive.writestr("hush/__init__.py", "")
    return held.getvalue()


@pytest.fixture(scope="module")
def expected(linux_hush: Callable[..., Result], tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """The sample shot by the program of the x86-64 Linux wheel."""
    folder = tmp_path_factory.mktemp("expected")
    succeeded(linux_hush("denoise", SHOT, "--output", folder))
    return pixels(folder)


@pytest.mark.parametrize("version", venvs.VERSIONS)
def test_blender_loads_the_zip_and_denoises(zips: list[Path], expected: dict[str, bytes], version: str, tmp_path: Path) -> None:
    python = venvs.python_with_blender(version, VENVS)
    archive = next(path for path in zips if path.name.endswith("linux_x64.zip"))
    told = succeeded(command(python, ROOT / "tests/platforms/load_extension.py", archive, tmp_path / "out", cwd=tmp_path))
    assert "loads and denoises the sample shot" in told
    assert pixels(tmp_path / "out") == expected

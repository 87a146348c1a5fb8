"""The version is the same in all places, and the script that sees to it finds one that was forgotten."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

import pytest
from conftest import ROOT

sys.path.insert(0, str(ROOT / "release"))
import version as release_version


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    for name in [*release_version.PLACES, "CHANGELOG.md"]:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(ROOT / name, tmp_path / name)
    return tmp_path


def test_all_places_agree() -> None:
    assert release_version.wrong(None) == []


def test_another_version_goes_everywhere(copy: Path) -> None:
    release_version.put("10.20.30", copy)
    assert release_version.version(copy) == "10.20.30"
    assert release_version.wrong(None, copy) == []
    manifest = (copy / "blender_addon/blender_manifest.toml").read_text()
    assert 'blender_version_min = "4.2.0"' in manifest
    assert 'schema_version = "1.0.0"' in manifest
    assert manifest.count("10.20.30") == 6


@pytest.mark.parametrize("name", [name for name in release_version.PLACES if name != "Cargo.toml"])
def test_a_place_that_was_forgotten_is_named(copy: Path, name: str) -> None:
    old = (copy / name).read_bytes()
    release_version.put("10.20.30", copy)
    (copy / name).write_bytes(old)
    (said,) = release_version.wrong(None, copy)
    assert said.startswith(f"{name} says ")


def test_a_tag_wants_its_heading_in_the_changelog(copy: Path) -> None:
    release_version.put("10.20.30", copy)
    tag, heading = release_version.wrong("v10.20.31", copy)
    assert "the tag is v10.20.31" in tag
    assert "CHANGELOG.md" in heading
    (copy / "CHANGELOG.md").write_text("# Changes\n\n## 10.20.30, 2027-01-02\n\n### New\n\n- One.\n\n## 10.20.3, 2026-12-01\n\n- Two.\n")
    assert release_version.wrong("v10.20.30", copy) == []
    assert release_version.notes(copy) == "### New\n\n- One.\n"

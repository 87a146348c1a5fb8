"""Switching on and off, installing and uninstalling leave nothing behind; a second time works as the first."""

from __future__ import annotations

import os
from pathlib import Path

import bpy
import kit

ENABLE = False
USER = Path(os.environ["BLENDER_USER_RESOURCES"])


def leftovers() -> list[str]:
    """Names in `kit.registered()` that speak of Hush."""
    return sorted(name for name in kit.registered() if "hush" in name.lower())


def test_nothing_is_registered_before_it_is_switched_on() -> None:
    assert leftovers() == []


def test_on_and_off_twice() -> None:
    before = kit.registered()
    for _ in range(2):
        kit.enable()
        assert len(leftovers()) >= 5, leftovers()
        assert hasattr(bpy.context.scene, "hush")
        kit.disable()
        left = sorted(kit.registered() - before)
        assert left == [], left
        lost = sorted(before - kit.registered())
        assert lost == [], lost


def test_scenes_keep_their_settings_over_off_and_on() -> None:
    kit.enable()
    bpy.context.scene.hush.lam = 7.0
    kit.disable()
    kit.enable()
    assert bpy.context.scene.hush.lam == 7.0
    kit.disable()


def test_installing_again_over_itself() -> None:
    kit.enable()
    result = bpy.ops.extensions.package_install_files(
        filepath=str(kit.archive()), repo="user_default", enable_on_install=True, overwrite=True
    )
    assert result == {"FINISHED"}
    assert kit.MODULE in bpy.context.preferences.addons
    kit.disable()


def test_uninstalling_removes_the_files() -> None:
    kit.enable()
    repositories = bpy.context.preferences.extensions.repos
    index = next(i for i, repository in enumerate(repositories) if repository.module == "user_default")
    assert bpy.ops.extensions.package_uninstall(repo_index=index, pkg_id="hush") == {"FINISHED"}
    assert leftovers() == []
    left = [name for name in kit.files(USER / "extensions") if "hush" in name.lower() and "__pycache__" not in name]
    assert left == []

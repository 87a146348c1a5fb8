"""Installing again and uninstalling in the running Blender; nothing of the extension is left."""

from __future__ import annotations

import os
from pathlib import Path

import bpy
import kit

USER = Path(os.environ["BLENDER_USER_RESOURCES"])


def test_installing_again_over_itself() -> None:
    result = bpy.ops.extensions.package_install_files(
        filepath=str(kit.archive()), repo="user_default", enable_on_install=True, overwrite=True
    )
    assert result == {"FINISHED"}
    assert kit.MODULE in bpy.context.preferences.addons


def test_uninstalling_removes_the_files() -> None:
    repositories = bpy.context.preferences.extensions.repos
    index = next(i for i, repository in enumerate(repositories) if repository.module == "user_default")
    assert bpy.ops.extensions.package_uninstall(repo_index=index, pkg_id="hush") == {"FINISHED"}
    assert kit.leftovers() == []
    left = [name for name in kit.files(USER / "extensions") if "hush" in name.lower()]
    assert left == []

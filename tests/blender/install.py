"""Run inside Blender: installs the extension's zip as a user does. Arguments: the zip."""

from __future__ import annotations

import sys

import bpy


def main() -> None:
    result = bpy.ops.extensions.package_install_files(filepath=sys.argv[1], repo="user_default", enable_on_install=True, overwrite=True)
    if result != {"FINISHED"}:
        sys.exit(f"package_install_files: {result}")
    if "bl_ext.user_default.hush" not in bpy.context.preferences.addons:
        sys.exit("the extension was installed but could not be enabled; see above")


main()

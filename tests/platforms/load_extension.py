"""Installs an extension zip in the Blender of this Python (bpy), as a user does, and denoises the sample shot with the Hush inside.

python load_extension.py hush-0.1.0-linux_x64.zip [OUTPUT]
"""

from __future__ import annotations

import os
import sys
import tempfile
from pathlib import Path

SHOT = Path(__file__).resolve().parents[2] / "samples" / "shot"


def main() -> int:
    archive = Path(sys.argv[1]).resolve()
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as scratch:
        # Before Blender starts, which the import does.
        os.environ["BLENDER_USER_RESOURCES"] = scratch
        import bpy

        result = bpy.ops.extensions.package_install_files(filepath=str(archive), repo="user_default", enable_on_install=True)
        assert result == {"FINISHED"}, result
        assert "bl_ext.user_default.hush" in bpy.context.preferences.addons, "installed, but not enabled"
        bpy.ops.hush.denoise_shot.get_rna_type()

        import hush

        place = Path(hush.__file__).resolve()
        assert place.is_relative_to(Path(scratch).resolve()), f"another Hush was loaded: {place}"
        output = Path(sys.argv[2] if len(sys.argv) > 2 else Path(scratch) / "denoised").resolve()
        done = hush.denoise_sequence(SHOT, output)
        assert done["written"] == 8, done
        print(f"Blender {bpy.app.version_string}: {archive.name} loads and denoises the sample shot")
    return 0


if __name__ == "__main__":
    sys.exit(main())

# SPDX-FileCopyrightText: 2026 Hush authors
# SPDX-License-Identifier: Apache-2.0
"""How far a shot is denoised, from the output folder's manifest and the settings now."""

import bpy


def touch(scene: bpy.types.Scene) -> None:
    """Says that the scene's settings changed."""

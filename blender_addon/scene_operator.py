# SPDX-FileCopyrightText: 2026 Hush authors
# SPDX-License-Identifier: GPL-3.0-or-later
"""What the operators share that are for one scene."""

import bpy
from bpy.props import StringProperty

from . import messages


class SceneOperator:
    """For the scene that is named, else for the open one."""

    scene: StringProperty(name="Scene", description="Scene that it is for. Empty: the open one", options={"SKIP_SAVE"})

    def scene_of(self, context: bpy.types.Context) -> bpy.types.Scene | None:
        """The scene; reports a name that is none."""
        if not self.scene:
            return context.scene
        scene = bpy.data.scenes.get(self.scene)
        if scene is None:
            self.report({"ERROR"}, messages.text("no_scene", name=self.scene))
        return scene

# SPDX-FileCopyrightText: 2026 Hush authors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The Fix buttons of Check Shot: the steps of Prepare Shot one by one, and mending the node."""

import bpy
from bpy.props import StringProperty

from .. import messages, prepare, refresh
from ..messages import Refusal
from ..nodes import flow, node
from ..scene_operator import SceneOperator


class HUSH_OT_fix(SceneOperator, bpy.types.Operator):
    """Change the setting that this problem comes from"""

    bl_idname = "hush.fix"
    bl_label = "Fix"
    bl_options = {"REGISTER", "UNDO", "INTERNAL"}

    key: StringProperty(name="Problem", description="Key of the problem, such as passes", options={"SKIP_SAVE"})

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Fixes one problem."""
        scene = self.scene_of(context)
        if scene is None:
            return {"CANCELLED"}
        if self.key == "save" and not bpy.app.background:
            return bpy.ops.wm.save_as_mainfile("INVOKE_DEFAULT") and {"FINISHED"}
        if self.key == "node":
            changes = _mend_nodes(scene)
        elif self.key == "noisy_image":
            count = flow.take_image(scene)
            changes = [messages.text("image_taken", count=count)] if count else []
        elif self.key in prepare.STEPS:
            try:
                changes = prepare.apply(scene, (self.key,))
            except Refusal as error:
                self.report({"ERROR"}, str(error))
                return {"CANCELLED"}
        else:
            self.report({"ERROR"}, messages.text("no_fix", key=self.key or "nothing"))
            return {"CANCELLED"}
        self.report({"INFO"}, "; ".join(changes) or messages.text("right_already"))
        return {"FINISHED"}


def _mend_nodes(scene: bpy.types.Scene) -> list[str]:
    count = node.repair(scene)
    refresh.request(now=True)
    return [messages.text("node_replaced", count=count)] if count else []


register, unregister = bpy.utils.register_classes_factory((HUSH_OT_fix,))

# SPDX-FileCopyrightText: 2026 Hush authors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The Group Input of a scene's compositor, which is the render in Blender 5.3. Only for the process that composites."""

import bpy

from .. import compat


class RenderInput:
    """Blender 5.3 renders the scene where its first compositor tree has a Group Input, also an unlinked one.

    Made of such a scene, it has the tree as a group inside another, which has none; `tree` and `socket` are where the image goes then,
    None where nothing takes it.
    """

    def __init__(self, scene: bpy.types.Scene) -> None:
        self._effect = compat.effects(scene)[0]
        inner = self._effect.node_group
        is_used = any(node.outputs[0].is_linked for node in compat.group_inputs(inner)) and scene.view_layers[0].use
        # A copy, as the effect keeps the values of its inputs, and what moves them, by the identifiers of the tree's.
        self.tree = inner.copy()
        self.tree.animation_data_clear()
        self.tree.nodes.clear()
        self._group = self.tree.nodes.new("CompositorNodeGroup")
        self._group.node_tree = inner
        result = self.tree.nodes.new("NodeGroupOutput")
        for number, output in enumerate(self._group.outputs):
            self.tree.links.new(output, result.inputs[number])
        self._effect.node_group = self.tree
        self.socket = self._group.inputs[0] if is_used else None
        curves = [*compat.fcurves(scene), *(scene.animation_data.drivers if scene.animation_data else ())]
        self.moves = any(curve.data_path.startswith("compositor_effects[") for curve in curves)

    @staticmethod
    def is_in(scene: bpy.types.Scene) -> bool:
        """Whether the scene's first tree has one."""
        return compat.HAS_EFFECTS and any(node.bl_idname == "NodeGroupInput" for node in compat.compositor_tree(scene).nodes)

    def update(self) -> None:
        """Gives the group the values that the effect has now for all its other inputs."""
        values = self._effect.properties.inputs
        for socket in list(self._group.inputs)[1:]:
            given = getattr(values, socket.identifier, None)
            if hasattr(given, "value") and hasattr(socket, "default_value"):
                socket.default_value = given.value

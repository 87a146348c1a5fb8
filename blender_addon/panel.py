# SPDX-FileCopyrightText: 2026 Hush authors
# SPDX-License-Identifier: GPL-3.0-or-later
"""What is drawn: the panel in the render properties, and the one beside the compositor's nodes."""

import bpy

from . import messages, paragraph, refresh, shot, status
from .checks import check
from .denoising import denoise
from .nodes import node

# Where a problem is drawn, by its key; all others belong to preparing.
_STEP_OF = {
    **dict.fromkeys(("frames", "older", "lossy", "first_frame", "render_folder"), 2),
    **dict.fromkeys(("folder", "space", "library", "lambda", "lambda_mask", "stale", "failed"), 3),
    **dict.fromkeys(("node", "stereo", "denoised_again", "past_node"), 4),
}


class _HushPanel:
    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"
    bl_context = "render"


class RENDER_PT_hush(_HushPanel, bpy.types.Panel):
    """The four steps from the scene to the denoised film."""

    bl_label = "Hush Temporal Denoise"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        """Draws only what is known already, and asks for a fresh look."""
        refresh.request()
        scene, layout = context.scene, self.layout
        width = paragraph.width(context)
        state = status.last_known(scene)
        problems = refresh.problems(scene) or []
        steps = [[p for p in problems if _STEP_OF.get(p.key, 1) == step] for step in (1, 2, 3, 4)]
        layout.operator("hush.whole_shot", icon="RENDER_ANIMATION")
        _draw_prepare(layout, scene, all(p.level == check.INFO for p in steps[0]))
        _draw_problems(layout, steps[0], width)
        _draw_render(layout, state, width)
        rendering = bpy.app.is_job_running("RENDER")
        _draw_problems(layout, [p for p in steps[1] if not (rendering and p.key == "frames")], width)
        # That nothing is rendered stands under the step before; what is out of date in the status, in fewer words.
        told = bool(state and not state.rendered and any(p.key == "frames" for p in steps[1]))
        _draw_denoise(layout, scene, None if told else state, width)
        _draw_problems(layout, [p for p in steps[2] if p.key != "stale" or not state], width)
        _draw_composite(layout, scene, state, width)
        _draw_problems(layout, steps[3], width)


class RENDER_PT_hush_settings(_HushPanel, bpy.types.Panel):
    """How the shot is denoised."""

    bl_label = "Settings"
    bl_parent_id = "RENDER_PT_hush"

    def draw(self, context: bpy.types.Context) -> None:
        """The dial first."""
        layout, hush = self.layout, context.scene.hush
        # As wide as the panel: beside a label of half the width its name would be cut off.
        dial = layout.row()
        dial.prop(hush, "lam", slider=True)
        dial.prop_decorator(hush, "lam")
        layout.use_property_split = True
        if shot.lambda_source(context.scene) in ("driver", "nla"):
            paragraph.draw(layout.column(align=True), messages.text("lambda_driver_now"), paragraph.width(context), icon="INFO")
        column = layout.column()
        column.use_property_decorate = False
        column.prop(hush, "lambda_pass")
        column.prop(hush, "lambda_images")
        masked = column.row()
        masked.active = bool(hush.lambda_pass or hush.lambda_images)
        masked.prop(hush, "lambda_masked", slider=True)
        column.prop(hush, "window")
        column.prop(hush, "second_pass")
        column.prop(hush, "use_light_passes")
        column.prop(hush, "keep_noisy")
        if len(context.scene.view_layers) > 1:
            column.prop_search(hush, "vector_layer", context.scene, "view_layers")


class RENDER_PT_hush_folders(_HushPanel, bpy.types.Panel):
    """Where the frames are."""

    bl_label = "Folders"
    bl_parent_id = "RENDER_PT_hush"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        """What is empty is filled in words below."""
        layout, scene = self.layout, context.scene
        layout.use_property_split = True
        layout.use_property_decorate = False
        layout.prop(scene.hush, "input_folder")
        layout.prop(scene.hush, "output_folder")
        layout.prop(scene.hush, "composite_folder")
        layout.prop(scene.hush, "composite_format")
        column = layout.column(align=True)
        for line in refresh.folders(scene):
            paragraph.draw(column, line, paragraph.width(context))


def _draw_problems(layout: bpy.types.UILayout, problems: list[check.Problem], width: float) -> None:
    column = layout.column(align=True)
    for problem in problems:
        paragraph.draw_with_fix(column, problem.text, width, icon=check.ICONS[problem.level], fix=problem.fix)


def _draw_prepare(layout: bpy.types.UILayout, scene: bpy.types.Scene, ready: bool) -> None:
    row = _step(layout, ready, "hush.prepare_shot", "1. Prepare Shot")
    if scene.hush.prepared:
        row.operator("hush.undo_prepare", text="", icon="LOOP_BACK")
    row.operator("hush.check_shot", text="", icon="VIEWZOOM")


def _draw_render(layout: bpy.types.UILayout, state: status.ShotStatus | None, width: float) -> None:
    rendered = bool(state and state.total and state.rendered == state.total)
    _step(layout, rendered, "render.render", "2. Render Animation", animation=True)
    if state and 0 < state.rendered < state.total:
        text = messages.text("status_rendered", count=state.rendered, total=state.total)
        paragraph.draw(layout.column(align=True), text, width, icon="BLANK1")


def _draw_denoise(layout: bpy.types.UILayout, scene: bpy.types.Scene, state: status.ShotStatus | None, width: float) -> None:
    finished = bool(state and state.total and state.done == state.total)
    _step(layout, finished, "hush.denoise_shot", "3. Denoise Shot")
    if not _draw_progress(layout, scene, width) and state:
        paragraph.draw(layout.column(align=True), messages.sentence(state.text), width, icon="ERROR" if state.stale else "BLANK1")


def _draw_composite(layout: bpy.types.UILayout, scene: bpy.types.Scene, state: status.ShotStatus | None, width: float) -> None:
    trees = node.trees(scene)
    has_node = bool(trees)
    row = _step(layout, None, "hush.composite_shot", "4. Composite Denoised")
    row.enabled = has_node
    if state and state.stale:
        row.operator("hush.composite_shot", text="", icon="TIME").allow_stale = True
    if not has_node or _goes_past(scene):
        layout.operator("hush.add_node", icon=node.ICON)
    _draw_reasons(layout, trees, width)


def _draw_reasons(layout: bpy.types.UILayout, trees: list[bpy.types.NodeTree], width: float) -> None:
    """Why nodes pass their input through, each reason once."""
    column = layout.column(align=True)
    for reason in dict.fromkeys(node.why_off(tree) for tree in trees if not node.is_on(tree)):
        paragraph.draw(column, messages.text("node_off", reason=reason), width, icon="INFO")


def _step(layout: bpy.types.UILayout, done: bool | None, operator: str, text: str, **arguments: object) -> bpy.types.UILayout:
    row = layout.row()
    icon = "CHECKMARK" if done else "RADIOBUT_OFF"
    button = row.operator(operator, text=text, icon="PLAY" if done is None else icon)
    for name, value in arguments.items():
        setattr(button, name, value)
    return row


def _goes_past(scene: bpy.types.Scene) -> bool:
    """Whether a view layer goes past the nodes that are there, as of the last look."""
    return any(problem.key == "past_node" for problem in refresh.problems(scene) or [])


def _draw_progress(layout: bpy.types.UILayout, scene: bpy.types.Scene, width: float) -> bool:
    progress = denoise.progress(scene)
    if progress is None:
        return False
    layout.progress(factor=progress[0], text=f"{progress[0]:.0%}", type="BAR")
    paragraph.draw(layout.column(align=True), progress[1], width)
    return True


class NODE_PT_hush(bpy.types.Panel):
    """The nodes of the compositor that is edited: dial, window, frames, how far, and the buttons."""

    bl_label = "Temporal Denoise"
    bl_space_type = "NODE_EDITOR"
    bl_region_type = "UI"
    bl_category = "Hush"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Beside the compositor's nodes."""
        return context.space_data.tree_type == "CompositorNodeTree"

    def draw(self, context: bpy.types.Context) -> None:
        """Draws only what is known already, and asks for a fresh look."""
        refresh.request()
        layout, scene, width = self.layout, context.scene, paragraph.width(context)
        trees = node.trees(scene)
        if not trees or _goes_past(scene):
            layout.operator("hush.add_node", icon=node.ICON)
        for tree in trees:
            _draw_node(layout.box() if len(trees) > 1 else layout, tree, scene, width)
        _draw_problems(layout, [p for p in refresh.problems(scene) or [] if _STEP_OF.get(p.key) == 4], width)


def _draw_node(layout: bpy.types.UILayout, tree: bpy.types.NodeTree, scene: bpy.types.Scene, width: float) -> None:
    scene = tree.hush.scene or scene
    column = layout.column()
    if len(node.trees(scene)) > 1:
        column.label(text=tree.name)
    column.enabled = tree.library is None
    if len(bpy.data.scenes) > 1:
        column.prop(tree.hush, "scene")
    if len(scene.view_layers) > 1:
        column.prop_search(tree.hush, "view_layer", scene, "view_layers")
    column.prop(scene.hush, "lam", slider=True)
    column.prop(scene.hush, "window")
    column.prop(scene.hush, "input_folder", text="Frames")
    state = status.last_known(scene)
    column = layout.column(align=True)
    if not _draw_progress(column, scene, width) and state:
        paragraph.draw(column, messages.sentence(state.text), width, icon="ERROR" if state.stale else "NONE")
    _draw_reasons(column, [tree], width)
    buttons = layout.column(align=True)
    buttons.operator("hush.denoise_shot", icon=node.ICON).scene = scene.name
    buttons.operator("hush.composite_shot", icon="RENDER_ANIMATION")


register, unregister = bpy.utils.register_classes_factory((RENDER_PT_hush, RENDER_PT_hush_settings, RENDER_PT_hush_folders, NODE_PT_hush))

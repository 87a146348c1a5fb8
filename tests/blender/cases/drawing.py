"""The panels are drawn in every state without an error; a stand-in for Blender's layout notes what they draw."""

from __future__ import annotations

from types import SimpleNamespace

import bpy
import frames
import kit


class Layout:
    """Takes what a UILayout takes and refuses what it does not have."""

    def __init__(self, seen: list[str]) -> None:
        object.__setattr__(self, "seen", seen)

    def __setattr__(self, name: str, value: object) -> None:
        assert name in bpy.types.UILayout.bl_rna.properties, name

    def __getattr__(self, name: str) -> object:
        function = bpy.types.UILayout.bl_rna.functions[name]

        def call(*arguments: object, **named: object) -> object:
            for key in named:
                assert key in function.parameters, f"{name} has no {key}"
            if name in ("prop", "prop_search"):
                assert hasattr(arguments[0], arguments[1]), arguments
                self.seen.append(f"{name} {arguments[1]}")
            elif name == "operator":
                self.seen.append(f"operator {arguments[0]}")
                module, operator = arguments[0].split(".")
                return Operator(getattr(getattr(bpy.ops, module), operator).get_rna_type())
            else:
                self.seen.append(str(named.get("text", "")))
            return Layout(self.seen)

        return call


class Operator:
    def __init__(self, rna: bpy.types.Struct) -> None:
        object.__setattr__(self, "rna", rna)

    def __setattr__(self, name: str, value: object) -> None:
        assert name in self.rna.properties, name


def draw() -> str:
    """Draws all panels; returns what they show."""
    seen: list[str] = []
    region = SimpleNamespace(width=400, type="WINDOW")
    context = SimpleNamespace(scene=bpy.context.scene, region=region, preferences=bpy.context.preferences)
    panel = kit.module("panel")
    for name in ("RENDER_PT_hush", "RENDER_PT_hush_settings", "RENDER_PT_hush_folders", "NODE_PT_hush"):
        getattr(panel, name).draw(SimpleNamespace(layout=Layout(seen)), context)
    return "\n".join(seen)


def look(scene: bpy.types.Scene) -> None:
    """What the timer does in a window."""
    refresh = kit.module("refresh")
    kit.module("status").shot_status(scene)
    refresh._problems[scene.session_uid] = kit.module("checks.check").problems(scene, fresh=True)


def test_before_anything_is_known() -> None:
    bpy.ops.wm.read_homefile(use_empty=True)
    shown = draw()
    steps = ["hush.prepare_shot", "render.render", "hush.denoise_shot", "hush.composite_shot"]
    places = [shown.index(f"operator {step}") for step in steps]
    assert places == sorted(places)
    assert "operator hush.add_node" in shown and "prop lam" in shown and "operator hush.whole_shot" in shown


def test_problems_and_status_are_shown() -> None:
    shot = kit.copy_of_shot("drawn")
    scene, _ = frames.scene_with_node(shot)
    frames.denoise(scene, [1, 2])
    scene.cycles.use_animated_seed = False
    look(scene)
    shown = draw().replace("\n", " ")
    assert "2 of 5 frames denoised, 3 to do" in shown
    assert "operator hush.fix" in shown and "seed" in shown
    assert "operator hush.add_node" not in shown
    assert shown.count("operator hush.composite_shot") == 2, "one in each panel"
    scene.hush.lam = 3.0
    look(scene)
    assert draw().count("operator hush.composite_shot") == 3, "and one that takes frames out of date"


def test_the_node_tells_why_it_passes_the_image() -> None:
    """Beside the nodes and in the render properties."""
    shot = kit.copy_of_shot("why")
    scene, _ = frames.scene_with_node(shot)
    frames.denoise(scene, [1])
    scene.frame_set(1)
    kit.module("nodes.node").sync(scene)
    assert "passes through" not in draw()
    scene.frame_set(2)
    kit.module("nodes.node").sync(scene)
    assert draw().replace("\n", " ").count("this frame is not denoised yet; press Denoise Shot") == 2
    scene.frame_set(1)
    scene.render.resolution_percentage = 50
    kit.module("nodes.node").sync(scene)
    shown = draw().replace("\n", " ")
    assert "96 × 54" in shown and "48 × 27" in shown


def test_a_node_of_an_earlier_hush_can_be_replaced_from_the_panels() -> None:
    scene = kit.build_scene()
    tree = kit.module("compat").ensure_compositor_tree(scene)
    node = kit.module("nodes.node").new(tree)
    node.node_tree.animation_data_clear()
    look(scene)
    assert draw().count("operator hush.fix") == 2


def test_many_scenes_and_layers() -> None:
    scene = kit.build_scene("blur")
    bpy.data.scenes.new("Other")
    bpy.ops.hush.add_node()
    scene.hush.driver_add("lam")
    look(scene)
    shown = draw()
    assert "prop scene" in shown and "prop_search view_layer" in shown and "prop_search vector_layer" in shown
    assert "driver" in shown


def test_paths_that_cannot_be_used() -> None:
    scene = kit.build_scene()
    scene.render.filepath = "/tmp/{nothing}/x" if frames.BLENDER_5 else "//unsaved"
    look(scene)
    draw()


def test_lines_fit_and_lose_nothing() -> None:
    paragraph = kit.module("paragraph")
    text = "The shot is not rendered yet, there are no frames in /jobs/a_film/sequence_010/shot_0040/lighting/v012: press Render Animation"
    for room in (60.0, 121.0, 203.0, 480.0):
        lines = paragraph.lines(text, room, 11.0)
        assert "".join(lines).replace(" ", "") == text.replace(" ", "")
        assert all(paragraph._width_of(line, 11.0) <= room for line in lines), (room, lines)
        longest = max(paragraph._width_of(line, 11.0) for line in lines)
        assert longest > 0.7 * room or len(lines) == 1, (room, longest)
    assert len(paragraph.lines(text, 480.0, 11.0)) < len(paragraph.lines(text, 480.0, 16.0)), "a greater font takes more lines"
    assert paragraph.lines("", 100.0, 11.0) == ()


def test_the_sidebar_is_beside_the_compositor_only() -> None:
    panel = kit.module("panel").NODE_PT_hush
    for kind, there in (("CompositorNodeTree", True), ("ShaderNodeTree", False)):
        assert panel.poll(SimpleNamespace(space_data=SimpleNamespace(tree_type=kind))) == there
    assert (panel.bl_space_type, panel.bl_region_type, panel.bl_category) == ("NODE_EDITOR", "UI", "Hush")


def test_drawing_does_not_look_at_the_disk() -> None:
    scene, _ = frames.scene_with_node(kit.copy_of_shot("undisturbed"))
    kit.module("refresh").look()
    check, shot = kit.module("checks.check"), kit.module("shot")

    def fails(*_: object, **__: object) -> None:
        raise AssertionError("it looks at the disk")

    real = shot._patterns_in, check.file_problems
    shot._patterns_in = check.file_problems = fails
    check._seen[scene.session_uid] = (None, 0.0, check._seen[scene.session_uid][2])
    seen: list[str] = []
    try:
        shown = draw()
        check.HUSH_OT_check_shot.draw(SimpleNamespace(layout=Layout(seen), scene=""), SimpleNamespace(scene=scene))
    finally:
        shot._patterns_in, check.file_problems = real
    whole = "".join(shown.split())  # a long path is broken anywhere
    assert "undisturbed" in whole and "denoised" in whole
    assert seen

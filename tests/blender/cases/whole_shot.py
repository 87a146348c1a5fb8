"""Render and Denoise Shot goes the whole way, goes on where it was stopped, and says so where it cannot."""

from __future__ import annotations

import time
from pathlib import Path
from types import SimpleNamespace

import bpy
import fingerprint
import kit
import windows

TIME_LIMIT = 600.0
compat, whole_shot, rendering, job = (kit.module(name) for name in ("compat", "denoising.whole_shot", "denoising.rendering", "jobs.job"))
IMAGE = "ViewLayer.Combined"
NAMES = [f"frame_{frame:04d}.exr" for frame in (1, 2, 3)]


def scene_of_three(name: str, *, node: bool = True) -> tuple[bpy.types.Scene, Path]:
    """A scene that was never rendered, as Blender makes it, and the folder of its frames."""
    folder = kit.folder(name)
    scene = kit.build_scene("bare", folder)
    scene.frame_end = 3
    scene.cycles.use_animated_seed = False
    if node:
        tree = compat.ensure_compositor_tree(scene)
        layers = next(each for each in tree.nodes if each.bl_idname == "CompositorNodeRLayers")
        group = bpy.data.node_groups.new("Temporal Denoise", "CompositorNodeTree")
        group["hush_form"] = "test"
        for direction in ("INPUT", "OUTPUT"):
            group.interface.new_socket("Image", in_out=direction, socket_type="NodeSocketColor")
        group.links.new(group.nodes.new("NodeGroupInput").outputs[0], group.nodes.new("NodeGroupOutput").inputs[0])
        ours = tree.nodes.new("CompositorNodeGroup")
        ours.node_tree = group
        tree.links.new(layers.outputs["Image"], ours.inputs[0])
        tree.links.new(ours.outputs[0], compat.output_node(tree).inputs[0])
    return scene, folder


def images(folder: Path) -> list[str]:
    return [name for name in kit.files(folder) if name.endswith(".exr")]


def stamps(folder: Path) -> dict[str, int]:
    return {name: (folder / name).stat().st_mtime_ns for name in NAMES}


def test_as_one_headless_command() -> None:
    scene, folder = scene_of_three("headless")
    blend = kit.folder("headless-file") / "shot.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(blend))
    code = "import sys; bpy.ops.wm.open_mainfile(filepath=sys.argv[1]); print(bpy.ops.hush.whole_shot())"
    told = kit.blender(code, blend, limit=200)
    assert "FINISHED" in told and "denoised with" in told, told
    for place in (folder, folder / "denoised", folder / "composited"):
        assert [name for name in images(place) if "/" not in name] == NAMES, place
    assert any("Denoising Albedo" in name for name in kit.channels(folder / NAMES[0])), "it was not prepared"
    kit.assert_differs(kit.layer(folder / NAMES[1], IMAGE), kit.layer(folder / "denoised" / NAMES[1], IMAGE), 0.005)


def test_it_goes_on_where_it_was_stopped() -> None:
    scene, folder = scene_of_three("resumed", node=False)
    assert bpy.ops.hush.whole_shot() == {"FINISHED"}
    assert not (folder / "composited").exists()
    assert bpy.ops.hush.whole_shot() == {"FINISHED"}, "Blender's own first steps are behind it"
    before, first = stamps(folder), fingerprint.take()
    (folder / NAMES[1]).unlink()
    (folder / NAMES[2]).write_bytes((folder / NAMES[2]).read_bytes()[:9000])
    assert bpy.ops.hush.whole_shot() == {"FINISHED"}
    now = stamps(folder)
    assert now[NAMES[0]] == before[NAMES[0]] and now[NAMES[1]] != before[NAMES[1]] and now[NAMES[2]] != before[NAMES[2]]
    changed = fingerprint.changes(first, fingerprint.take())
    assert not changed, changed[:20]
    assert bpy.ops.hush.whole_shot(render_again=True) == {"FINISHED"}
    assert all(stamps(folder)[name] != now[name] for name in NAMES)


def test_rows_of_frames() -> None:
    assert whole_shot.runs([1, 2, 3, 7, 9, 10], 1) == [(1, 3), (7, 7), (9, 10)]
    assert whole_shot.runs([1, 3, 5, 9], 2) == [(1, 5), (9, 9)]
    assert whole_shot.runs([], 1) == []


def test_frames_of_another_size_are_rendered() -> None:
    scene, folder = scene_of_three("size", node=False)
    scene.frame_end = 1
    assert bpy.ops.hush.whole_shot() == {"FINISHED"}
    scene.render.resolution_percentage = 50
    assert whole_shot.to_render(scene) == [1]
    assert bpy.ops.hush.whole_shot() == {"FINISHED"}
    assert kit.layer(folder / "denoised" / NAMES[0], IMAGE).shape[:2] == (27, 48)


def test_what_is_refused() -> None:
    scene, folder = scene_of_three("refused")
    scene.camera = None
    kit.refused(bpy.ops.hush.whole_shot, "camera")
    kit.refused(bpy.ops.hush.whole_shot, "no scene Nowhere", scene="Nowhere")
    scene.render.engine = "BLENDER_WORKBENCH"
    kit.refused(bpy.ops.hush.whole_shot, "Cycles")
    scene, folder = scene_of_three("elsewhere")
    scene.hush.input_folder = str(kit.folder("farm"))
    kit.refused(bpy.ops.hush.whole_shot, "not rendered: render what is missing, or choose another folder")
    assert kit.files(folder) == []


def test_in_a_window() -> None:
    """Blender's render is run to its end at once; a real window could not be tried."""
    scene, folder = scene_of_three("window")
    window = windows.Window()
    fake = window.operator(whole_shot.HUSH_OT_whole_shot, render_again=False)
    real = rendering._render_in_window

    def render(arguments: dict[str, object]) -> set[str]:
        result = bpy.ops.render.render(**arguments)
        scene.name = "Renamed while it was rendered"
        return result

    rendering._render_in_window = render
    try:
        with windows.foreground(whole_shot):
            assert fake.invoke(window, None) == {"RUNNING_MODAL"}
        until = time.monotonic() + 120
        while (result := fake.modal(window, SimpleNamespace(type="TIMER", value="PRESS"))) in ({"PASS_THROUGH"}, {"RUNNING_MODAL"}):
            assert time.monotonic() < until, "it does not end"
            time.sleep(0.01)
    finally:
        rendering._render_in_window = real
    assert result == {"FINISHED"} and "3 frames rendered, denoised and composited" in window.reports[-1][1], window.reports
    assert images(folder / "composited") == NAMES and job.current() is None
    assert (scene.frame_start, scene.frame_end) == (1, 3)
    assert not any("rendering" in str(getattr(each, "__module__", "")) for each in bpy.app.handlers.render_complete)
    assert any("Denoising" in str(text) for text in window.shown) and any("Compositing" in str(text) for text in window.shown)


def test_overwrite_and_placeholders_do_not_keep_old_frames() -> None:
    scene, folder = scene_of_three("kept", node=False)
    assert bpy.ops.hush.whole_shot() == {"FINISHED"}
    render, before = scene.render, stamps(folder)
    render.use_overwrite, render.use_placeholder = False, True
    assert bpy.ops.hush.whole_shot(render_again=True) == {"FINISHED"}
    assert all(stamps(folder)[name] != before[name] for name in NAMES), "old frames are told to be rendered"
    render.resolution_percentage = 50
    assert bpy.ops.hush.whole_shot() == {"FINISHED"}
    assert kit.layer(folder / "denoised" / NAMES[0], IMAGE).shape[:2] == (27, 48)
    assert (render.use_overwrite, render.use_placeholder) == (False, True), "they were not given back"


def test_frames_that_were_rendered_before_the_scene_was_prepared_are_told() -> None:
    scene, _ = scene_of_three("unprepared", node=False)
    assert bpy.ops.hush.whole_shot() == {"FINISHED"}
    scene.view_layers[0].cycles.denoising_store_passes = False
    todo, notes = whole_shot.begin(scene, render_again=False)
    assert not todo and [level for level, _ in notes] == ["INFO", "WARNING"], notes
    assert "Frames 1-3 are rendered already and kept, without what Prepare Shot" in notes[1][1], notes
    assert [level for level, _ in whole_shot.begin(scene, render_again=False)[1]] == ["INFO"], "it is prepared now"
    assert len(whole_shot.begin(scene, render_again=True)[0]) == 3
    told: list[tuple[set[str], str]] = []
    fake = SimpleNamespace(report=lambda level, text: told.append((level, text)), _todo=todo, _warnings=[notes[1][1]])
    assert whole_shot.HUSH_OT_whole_shot._sum_up(fake, scene) == {"FINISHED"}
    assert told[-1] == ({"WARNING"}, notes[1][1]), "it is not told at the end"


def test_frames_that_were_not_written_again_are_told() -> None:
    scene, folder = scene_of_three("unwritten", node=False)
    assert bpy.ops.hush.whole_shot() == {"FINISHED"}
    real = whole_shot.runs
    whole_shot.runs = lambda frames, step: real(frames[1:], step)
    try:
        kit.refused(bpy.ops.hush.whole_shot, "Frame 1 is not rendered", render_again=True)
    finally:
        whole_shot.runs = real


def test_a_refusal_changes_nothing() -> None:
    """Neither where that is known before anything is prepared, nor where preparing brings it to light."""
    scene, folder = scene_of_three("unchanged", node=False)
    scene.render.use_motion_blur = True
    assert bpy.ops.hush.prepare_shot() == {"FINISHED"}
    scene.cycles.use_animated_seed = False
    camera = scene.camera
    scene.camera = None
    untouched(scene, "camera")
    scene.camera = camera
    other = bpy.data.scenes.new("Other")
    other.render.engine, other.camera, other.render.filepath = "CYCLES", camera, scene.render.filepath
    compat.use_multilayer(other.render.image_settings)
    # Blender 5.2 fills in what a new scene's view layer has when it is first asked for.
    other.view_layers[0].update()
    compat.use_image_format(scene.render.image_settings, "PNG")
    untouched(scene, "same files")
    for each in ("Hush Vectors", "ViewLayer"):
        assert each in scene.view_layers
    scene.hush.prepared = ""
    scene.hush.vector_layer = ""
    scene.view_layers.remove(scene.view_layers["Hush Vectors"])
    untouched(scene, "same files")
    assert len(scene.view_layers) == 1
    assert kit.files(folder) == []


def untouched(scene: bpy.types.Scene, *words: str) -> None:
    before = fingerprint.take()
    kit.refused(bpy.ops.hush.whole_shot, *words, scene=scene.name)
    changed = [text for text in fingerprint.changes(before, fingerprint.take()) if not text.startswith("dirty")]
    assert not changed, changed


def test_preparing_is_a_step_of_its_own_in_undo() -> None:
    scene, _ = scene_of_three("undo", node=False)
    scene.frame_end = 1
    bpy.ops.ed.undo_push(message="before")
    bpy.context.scene.render.resolution_x = 80
    bpy.ops.ed.undo_push(message="the artist's own")
    assert bpy.ops.hush.whole_shot() == {"FINISHED"}
    assert bpy.context.scene.hush.prepared
    assert bpy.ops.ed.undo() == {"FINISHED"}
    scene = bpy.context.scene
    assert not scene.hush.prepared and scene.render.resolution_x == 80, (scene.hush.prepared, scene.render.resolution_x)


def test_strips_that_are_seen_are_refused_before_rendering() -> None:
    scene, folder = scene_of_three("strips", node=False)
    editor = scene.sequence_editor_create()
    strips = editor.strips if hasattr(editor, "strips") else editor.sequences
    length = "length" if "length" in strips.bl_rna.functions["new_effect"].parameters else "frame_end"
    strip = strips.new_effect(name="Colour", type="COLOR", channel=1, frame_start=1, **{length: 10})
    kit.refused(bpy.ops.hush.whole_shot, "Sequencer")
    assert kit.files(folder) == [] and scene.render.use_sequencer
    strip.mute = True
    scene.frame_end = 1
    if bpy.app.version < (4, 5):
        # There a muted strip is rendered in place of the scene, too.
        kit.refused(bpy.ops.hush.whole_shot, "Sequencer")
        strips.remove(strip)
    assert bpy.ops.hush.whole_shot() == {"FINISHED"}


def test_a_linked_scene_of_the_same_name_is_no_trouble() -> None:
    scene, folder = scene_of_three("namesake")
    scene.frame_end, scene.name = 1, "Shot"
    library = kit.folder("namesake-library") / "library.blend"
    bpy.data.libraries.write(str(library), {scene})
    with bpy.data.libraries.load(str(library), link=True) as (_, into):
        into.scenes = ["Shot"]
    assert [each.name for each in bpy.data.scenes] == ["Shot", "Shot"]
    assert bpy.ops.hush.whole_shot() == {"FINISHED"}
    assert images(folder / "composited") == NAMES[:1]

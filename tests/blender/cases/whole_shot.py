"""Render and Denoise Shot goes the whole way, goes on where it was stopped, and says so where it cannot."""

from __future__ import annotations

import time
from pathlib import Path
from types import MethodType, SimpleNamespace

import bpy
import fingerprint
import kit

TIME_LIMIT = 600.0
compat, whole_shot, job = (kit.module(name) for name in ("compat", "denoising.whole_shot", "jobs.job"))
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
    kit.refused(bpy.ops.hush.whole_shot, "not rendered")
    assert kit.files(folder) == []


def test_in_a_window() -> None:
    """Blender's render is run to its end at once; a real window could not be tried."""
    scene, folder = scene_of_three("window")
    nothing, reports, shown = (lambda *_: None), [], []
    manager = SimpleNamespace(progress_begin=nothing, progress_update=nothing, progress_end=nothing, event_timer_remove=nothing)
    window = SimpleNamespace(window_manager=manager, workspace=SimpleNamespace(status_text_set=shown.append), scene=scene)
    fake = SimpleNamespace(scene="", render_again=False, _timer=object(), _job=None, _render=None, _range=None)
    names = (
        "scene_of",
        "_prepare",
        "_render_next",
        "_give_range_back",
        "_next",
        "_ended",
        "_look_at_renders",
        "_sum_up",
        "_show",
        "_hide",
        "cancel",
    )
    for name in names:
        setattr(fake, name, MethodType(getattr(whole_shot.HUSH_OT_whole_shot, name), fake))
    fake.report = lambda level, text: reports.append((*level, text))
    background = kit.module("jobs.background")

    def modal(event: SimpleNamespace) -> set[str]:
        if fake._job is None:
            return whole_shot.HUSH_OT_whole_shot.modal(fake, window, event)
        return background.JobOperator.modal(fake, window, event)

    real, whole_shot._render_in_window = whole_shot._render_in_window, lambda arguments: bpy.ops.render.render(**arguments)
    try:
        assert fake._prepare(window) == scene
        fake.scene = scene.name
        fake._render_next(scene)
        until = time.monotonic() + 120
        while (result := modal(SimpleNamespace(type="TIMER", value="PRESS"))) in ({"PASS_THROUGH"}, {"RUNNING_MODAL"}):
            assert time.monotonic() < until, "it does not end"
            time.sleep(0.01)
    finally:
        whole_shot._render_in_window = real
    assert result == {"FINISHED"} and "3 frames rendered, denoised and composited" in reports[-1][1], reports
    assert images(folder / "composited") == NAMES and job.current() is None
    assert (scene.frame_start, scene.frame_end) == (1, 3)
    assert not any("whole_shot" in str(getattr(each, "__module__", "")) for each in bpy.app.handlers.render_complete)
    assert any("Denoising" in str(text) for text in shown) and any("Compositing" in str(text) for text in shown), shown

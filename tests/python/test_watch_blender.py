"""A real Blender render into a watched folder. Wants HUSH_BPY_PYTHON: a Python with `bpy`."""

from __future__ import annotations

import json
import os
import subprocess
from pathlib import Path

import pytest
from conftest import ROOT, Hush
from images import channels

FRAMES = 12
RENDER = """
import sys
import bpy

bpy.ops.wm.read_factory_settings(use_empty=True)
scene = bpy.context.scene
scene.render.engine = "CYCLES"
scene.cycles.samples, scene.cycles.use_denoising, scene.cycles.use_animated_seed = 8, False, True
scene.render.resolution_x, scene.render.resolution_y = 160, 90
scene.render.threads_mode, scene.render.threads = "FIXED", 2
scene.frame_start, scene.frame_end = 1, int(sys.argv[2])
bpy.ops.mesh.primitive_monkey_add()
monkey = bpy.context.object
for frame, angle in ((1, 0.0), (int(sys.argv[2]), 0.6)):
    monkey.rotation_euler[2] = angle
    monkey.keyframe_insert("rotation_euler", frame=frame)
bpy.ops.object.light_add(type="SUN", rotation=(0.6, 0.3, 0))
bpy.ops.object.camera_add(location=(0, -5, 0), rotation=(1.5708, 0, 0))
scene.camera = bpy.context.object
layer = bpy.context.view_layer
layer.use_pass_vector = layer.cycles.denoising_store_passes = True
if hasattr(scene.render.image_settings, "media_type"):
    scene.render.image_settings.media_type = "MULTI_LAYER_IMAGE"
scene.render.image_settings.file_format = "OPEN_EXR_MULTILAYER"
scene.render.filepath = sys.argv[1] + "/frame_"
bpy.ops.render.render(animation=True)
"""


@pytest.mark.skipif("HUSH_BPY_PYTHON" not in os.environ, reason="HUSH_BPY_PYTHON names no Python with bpy")
def test_every_frame_of_a_render_is_denoised_right_after_it(hush: Hush, tmp_path: Path) -> None:
    binary = Path(os.environ.get("HUSH_BIN", ROOT / "target" / "release" / "hush"))
    shot, output, log = tmp_path / "shot", tmp_path / "out", tmp_path / "events.jsonl"
    script = tmp_path / "render.py"
    script.write_text(RENDER, encoding="utf-8")
    shot.mkdir()
    with log.open("wb") as events:
        watch = subprocess.Popen([binary, "watch", shot, "-o", output, "--frames", f"1-{FRAMES}", "--json"], stdout=events)
    try:
        python = os.environ["HUSH_BPY_PYTHON"]
        render = subprocess.run([python, script, shot, str(FRAMES)], capture_output=True, text=True, timeout=300, check=False)
        assert render.returncode == 0, render.stdout + render.stderr
        last = shot / f"frame_{FRAMES:04d}.exr"
        rendered = last.stat().st_mtime
        names = [f"frame_{n:04d}.exr" for n in range(1, FRAMES + 1)]
        # It ends by itself with the last frame.
        code = watch.wait(timeout=60)
        written = (output / last.name).stat().st_mtime
    finally:
        watch.kill()
        watch.wait()
    told = [json.loads(line) for line in log.read_text(encoding="utf-8").splitlines()]
    frames = [event for event in told if event["event"] == "frame"]
    assert code == 0 and sorted(event["frame"] for event in frames) == list(range(1, FRAMES + 1)), told
    assert all(event["status"] == "denoised" for event in frames)
    # The last frame shares its run with those that waited for it.
    tail = sum(event["seconds"] for event in frames if event["frame"] > FRAMES - 3)
    assert written - rendered < 2.0 + tail, f"{written - rendered:.2f} s after the render, {tail:.2f} s of computing"
    assert min((output / name).stat().st_mtime for name in names) < rendered, "frames come during the render"
    plain = hush("denoise", shot, "--output", tmp_path / "plain")
    assert plain.returncode == 0, plain.stderr
    for name in names:
        assert (output / name).read_bytes() == (tmp_path / "plain" / name).read_bytes(), name
        assert set(channels(output / name)) == set(channels(shot / name))

"""Saves the sample's scene as an artist has it before Hush: PNG, Cycles' denoiser on, a seed that stands still. For run.py, in Blender."""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path

import bpy

ABOUT = json.loads(os.environ["HUSH_WINDOW"])
sys.path.append(str(Path(ABOUT["root"]) / "samples"))

import still_life  # noqa: E402 - from the repository's samples

scene = still_life.build()
render, cycles = scene.render, scene.cycles
render.engine, cycles.device, cycles.samples, cycles.use_adaptive_sampling = "CYCLES", "CPU", 12, False
render.resolution_x, render.resolution_y, render.resolution_percentage = 480, 270, 100
render.use_persistent_data, render.filepath = True, "//render/frame_"
scene.frame_start, scene.frame_end = 1, 8
bpy.ops.wm.save_as_mainfile(filepath=str(Path(ABOUT["work"]) / "still_life.blend"))

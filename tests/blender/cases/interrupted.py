"""Ctrl-C in a script, and a process that is on its way out."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from types import SimpleNamespace

import bpy
import kit

background, job = kit.module("jobs.background"), kit.module("jobs.job")


@contextmanager
def ctrl_c() -> Iterator[None]:
    """Ctrl-C is pressed once while a process is waited for; a second one is taken for impatience, and ends it all."""
    presses = iter([True])

    def sleep(seconds: float) -> None:
        if next(presses, False):
            raise KeyboardInterrupt
        time.sleep(seconds)

    background.time = SimpleNamespace(sleep=sleep)
    try:
        yield
    finally:
        background.time = time


def test_denoising_is_an_error_then() -> None:
    """What comes next in the script must not take the shot for done."""
    frames = kit.copy_of_shot("denoised")
    kit.build_scene("plain", frames)
    with ctrl_c():
        kit.refused(bpy.ops.hush.denoise_shot, "stopped")
    assert len(list((frames / "denoised").glob("*.exr"))) < len(kit.FRAMES)
    assert bpy.ops.hush.denoise_shot() == {"FINISHED"}


def test_the_whole_shot_is_an_error_then() -> None:
    kit.build_scene("plain", kit.copy_of_shot("whole"))
    with ctrl_c():
        kit.refused(bpy.ops.hush.whole_shot, "stopped")


def test_a_process_that_closes_its_output_and_stays() -> None:
    """As Blender does on its way out: nobody waits for it in the interface."""
    code = (
        "import json, os, sys, time; sys.stdin.readline(); print(json.dumps({'event': 'finished'}), flush=True); os.close(1); time.sleep(3)"
    )
    running = job.Job(bpy.context.scene, [sys.executable, "-c", code], {})
    until = time.monotonic() + 20
    while not running._closed:
        began = time.monotonic()
        running.poll()
        assert time.monotonic() - began < 1.0 and began < until, "it was waited for"
        time.sleep(0.01)
    assert not running.ended
    assert kit.ended(running).errors == []

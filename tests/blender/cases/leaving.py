"""Blender ends, and with its own exit code, while the extension is on and its node is in use."""

from __future__ import annotations

import subprocess
import sys

USE = """
import bpy, sys, kit
kit.enable()
scene = kit.build_scene()
bpy.ops.hush.add_node()
scene.hush.lam = 2.0
print("in use", flush=True)
"""


def ends(code: str) -> int:
    """Exit code of a Blender that uses the extension and then does this; an exception where it hangs."""
    result = subprocess.run([sys.executable, "-c", USE + code], capture_output=True, text=True, timeout=30, check=False)
    assert "in use" in result.stdout, result.stdout + result.stderr
    return result.returncode


def test_at_the_end_of_a_script() -> None:
    assert ends("") == 0


def test_by_sys_exit() -> None:
    assert ends("sys.exit(0)") == 0
    assert ends("sys.exit(3)") == 3


def test_by_an_error() -> None:
    assert ends("raise RuntimeError('as it may happen')") == 1


def test_after_it_was_switched_off() -> None:
    assert ends("kit.disable()") == 0


def test_after_another_file_was_opened() -> None:
    assert ends("bpy.ops.wm.read_homefile(use_empty=True)") == 0

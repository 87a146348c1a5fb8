"""Installing again, loading factory settings and switching on and off while the node is in the open file; 4.2 crashed."""

from __future__ import annotations

import os
import subprocess
import sys

TIME_LIMIT = 1000.0
USE = """
import bpy, sys, kit
kit.enable()
scene = kit.build_scene()
assert bpy.ops.hush.add_node() == {"FINISHED"}
tree = scene.compositing_node_group if bpy.app.version >= (5, 0) else scene.node_tree

def work():
    names = [(node.name, node.bl_idname) for node in tree.nodes]
    bpy.context.view_layer.update()
    scene.frame_set(scene.frame_current + 1)
    bpy.ops.ed.undo_push(message="work")
    return names

before = work()
"""
END = """
print("came to the end", flush=True)
"""


def comes_to_the_end(code: str) -> None:
    """Fails if a Blender that does this with the node in the open file crashes."""
    result = subprocess.run([sys.executable, "-c", USE + code + END], capture_output=True, text=True, timeout=240, check=False)
    assert result.returncode == 0 and "came to the end" in result.stdout, f"exit code {result.returncode}\n{result.stdout}{result.stderr}"


def test_installing_again() -> None:
    comes_to_the_end(f"""
for _ in range(3):
    told = bpy.ops.extensions.package_install_files(
        filepath={os.environ["HUSH_ZIP"]!r}, repo="user_default", enable_on_install=True, overwrite=True
    )
    assert told == {{"FINISHED"}} and kit.MODULE in bpy.context.preferences.addons
    assert work() == before
bpy.ops.wm.save_as_mainfile(filepath={os.environ["HUSH_CASE_FOLDER"] + "/again.blend"!r})
bpy.ops.wm.open_mainfile(filepath={os.environ["HUSH_CASE_FOLDER"] + "/again.blend"!r})
""")


def test_loading_factory_settings() -> None:
    comes_to_the_end("""
for empty in (False, True):
    bpy.ops.wm.read_factory_settings(use_empty=empty)
    kit.enable()
    scene = kit.build_scene()
    assert bpy.ops.hush.add_node() == {"FINISHED"}
    tree = scene.compositing_node_group if bpy.app.version >= (5, 0) else scene.node_tree
    work()
bpy.ops.wm.read_homefile(use_empty=True)
""")


def test_ten_times_off_and_on() -> None:
    comes_to_the_end("""
for _ in range(10):
    kit.disable()
    assert work() == before
    kit.enable()
    assert work() == before
""")


def test_uninstalling() -> None:
    comes_to_the_end("""
repositories = bpy.context.preferences.extensions.repos
index = next(i for i, repository in enumerate(repositories) if repository.module == "user_default")
assert bpy.ops.extensions.package_uninstall(repo_index=index, pkg_id="hush") == {"FINISHED"}
assert work() == before
""")

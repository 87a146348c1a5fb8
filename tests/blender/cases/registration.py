"""Switching on and off leaves nothing behind; a second time works as the first."""

from __future__ import annotations

import bpy
import kit

ENABLE = False


def test_nothing_is_registered_before_it_is_switched_on() -> None:
    assert kit.leftovers() == []


def test_on_and_off_twice() -> None:
    before = kit.registered()
    for _ in range(2):
        kit.enable()
        assert len(kit.leftovers()) >= 5, kit.leftovers()
        assert hasattr(bpy.context.scene, "hush")
        kit.disable()
        left = sorted(kit.registered() - before)
        assert left == [], left
        lost = sorted(before - kit.registered())
        assert lost == [], lost


def test_scenes_keep_their_settings_over_off_and_on() -> None:
    kit.enable()
    bpy.context.scene.hush.lam = 7.0
    kit.disable()
    kit.enable()
    assert bpy.context.scene.hush.lam == 7.0
    kit.disable()

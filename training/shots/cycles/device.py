"""Which device Cycles renders on."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import bpy

DEVICES = ("cpu", "cuda", "optix", "hip", "metal", "oneapi")


def choose(scene: bpy.types.Scene, device: str) -> None:
    """Has Cycles render the scene on the CPU or on all GPUs of one kind.

    Raises:
        SystemExit: Cycles finds no such GPU.
    """
    import bpy  # only where it is used: whoever lists the devices needs none

    if device == "cpu":
        scene.cycles.device = "CPU"
        return
    kind = device.upper()
    preferences = bpy.context.preferences.addons["cycles"].preferences
    try:
        preferences.compute_device_type = kind
    except TypeError:
        raise SystemExit(f"this Blender has no {kind} for Cycles; --device cpu works everywhere") from None
    preferences.refresh_devices()
    found = [each for each in preferences.devices if each.type == kind]
    if not found:
        raise SystemExit(f"Cycles finds no {kind} device; --device cpu works everywhere")
    for each in preferences.devices:
        each.use = each in found
    scene.cycles.device = "GPU"

# SPDX-FileCopyrightText: 2026 Hush authors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Hush: temporal denoising of Cycles animations, as a Blender extension."""

import importlib
import sys
from types import ModuleType

# Those with something to register, in this order: properties first, as the rest draws and reads them.
_NAMES = (
    "properties",
    "prepare",
    "checks.check",
    "denoising.denoise",
    "compositing.composite",
    "denoising.whole_shot",
    "preview.preview",
    "nodes.node",
    "checks.fixes",
    "menus",
    "panel",
    "handlers",
    "jobs.background",
)
_registered: list[ModuleType] = []
# Blender runs this file again when it reloads the extension, but none of the others.
_stale = f"{__package__}.properties" in sys.modules


def _modules() -> list[ModuleType]:
    """The modules, read anew where an update has replaced their files."""
    prefix = f"{__package__}."
    if _stale:
        for name in [name for name in sys.modules if name.startswith(prefix)]:
            del sys.modules[name]
            globals().pop(name.removeprefix(prefix), None)
    return [importlib.import_module(prefix + name) for name in _NAMES]


def register() -> None:
    """Registers everything, or nothing where a part fails."""
    try:
        for module in _modules():
            module.register()
            _registered.append(module)
    except Exception:
        unregister()
        raise


def unregister() -> None:
    """Takes back whatever is registered, last first; harmless when nothing is."""
    while _registered:
        _registered.pop().unregister()

# SPDX-FileCopyrightText: 2026 Hush authors
# SPDX-License-Identifier: Apache-2.0
"""Hush: temporal denoising of Cycles animations, as a Blender extension."""

import atexit
import importlib
import importlib.util
from types import ModuleType

# In the order of registration: properties first, as the rest draws and reads them.
_NAMES = ("properties", "prepare", "check", "denoise", "composite", "node", "menus", "panel", "handlers")
_registered: list[ModuleType] = []


def _modules() -> list[ModuleType]:
    present = [name for name in _NAMES if importlib.util.find_spec(f"{__package__}.{name}")]
    return [importlib.import_module(f"{__package__}.{name}") for name in present]


def register() -> None:
    """Registers everything, or nothing where a part fails."""
    try:
        for module in _modules():
            module.register()
            _registered.append(module)
    except Exception:
        unregister()
        raise
    # Blender 4.5 hangs at exit while a Python node class is still registered.
    atexit.register(unregister)


def unregister() -> None:
    """Takes back whatever is registered, last first; harmless when nothing is."""
    atexit.unregister(unregister)
    while _registered:
        _registered.pop().unregister()

"""Which Python reads a USD stage in a process of its own."""

from __future__ import annotations

import sys
from pathlib import Path

from . import _hush

# Loads the library's file itself: an isolated Python may not know the folder that the package lies in.
_PROGRAM = """\
import importlib.util, sys
spec = importlib.util.spec_from_file_location("hush._hush", sys.argv[1])
module = importlib.util.module_from_spec(spec)
spec.loader.exec_module(module)
sys.exit(module.main(["hush", *sys.argv[2:]]))
"""


def register() -> None:
    """Says how a stage is read. Nothing is started."""
    python = _python()
    library = _hush.__file__
    if python is None or library is None:
        _hush.read_stages_with([], f"USD is read in a process of its own, and no Python is in {sys.prefix} to start one")
    else:
        # Isolated, so that no file of the working folder and no variable of the user's stands in for Python's own modules.
        _hush.read_stages_with([str(python), "-I", "-c", _PROGRAM, library], "")


def _python() -> Path | None:
    """The interpreter of this process; where a program such as Blender holds it, the one that came with it."""
    running = Path(sys.executable or "")
    if running.stem.lower().startswith("python"):
        return running
    names = (f"python{sys.version_info.major}.{sys.version_info.minor}", "python3", "python", "python.exe")
    folders = (Path(sys.prefix, "bin"), Path(sys.prefix))
    return next((folder / name for folder in folders for name in names if (folder / name).is_file()), None)

"""Blender as a Python module for each version that is tested: a virtual environment each, made once and kept.

sudo python3 tests/blender/venvs.py installs the system's libraries that they want.
"""

from __future__ import annotations

import ctypes
import os
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Version:
    """A Blender and what goes with it. numpy is the version that this Blender ships."""

    bpy: str
    python: str
    numpy: str

    @property
    def requirements(self) -> list[str]:
        return [f"bpy=={self.bpy}", f"numpy=={self.numpy}", "OpenEXR==3.5.3"]


VERSIONS = {
    "4.2": Version("4.2.23", "3.11", "1.24.4"),
    "4.5": Version("4.5.15", "3.11", "1.26.4"),
    "5.0": Version("5.0.1", "3.11", "1.26.4"),
    "5.2": Version("5.2.3", "3.13", "2.3.4"),
    "5.3": Version("5.3.0", "3.13", "2.3.4"),
}

# What the bpy package loads but does not bring along: library, Debian package.
LIBRARIES = {
    "libXrender.so.1": "libxrender1",
    "libXxf86vm.so.1": "libxxf86vm1",
    "libXfixes.so.3": "libxfixes3",
    "libXi.so.6": "libxi6",
    "libxkbcommon.so.0": "libxkbcommon0",
    "libSM.so.6": "libsm6",
    "libICE.so.6": "libice6",
    "libGL.so.1": "libgl1",
    "libEGL.so.1": "libegl1",
}


class Unavailable(Exception):
    """Why a Blender cannot be had here, and what to do."""


def _missing_libraries() -> list[str]:
    missing = []
    for library, package in LIBRARIES.items():
        try:
            ctypes.CDLL(library)
        except OSError:
            missing.append(package)
    return missing


def install_libraries() -> None:
    """Sees to the system's libraries; installs them where this user may."""
    missing = _missing_libraries() if sys.platform == "linux" else []
    if not missing:
        return
    command = ["apt-get", "install", "-y", "--no-install-recommends", *missing]
    if os.geteuid() != 0 or shutil.which("apt-get") is None:
        raise Unavailable(f"Blender wants system libraries. On Debian or Ubuntu: sudo {' '.join(command)}")
    quiet = {**os.environ, "DEBIAN_FRONTEND": "noninteractive"}
    for step in (["apt-get", "update", "-qq"], command):
        result = subprocess.run(step, env=quiet, stdin=subprocess.DEVNULL, capture_output=True, text=True, check=False)
        if result.returncode:
            raise Unavailable(f"{' '.join(step)} failed:\n{result.stderr}")
    if still := _missing_libraries():
        raise Unavailable(f"installed, but not found: {' '.join(still)}")


def _interpreter(wanted: str) -> str:
    """A Python of the wanted version: PYTHON3_11, python3.11 on the path, the one that runs this, or one of pyenv."""
    named = os.environ.get(f"PYTHON{wanted.replace('.', '_')}")
    kept = sorted(map(str, Path.home().glob(f".pyenv/versions/*/bin/python{wanted}")))
    for candidate in (named, f"python{wanted}", sys.executable, "python3", *kept):
        path = shutil.which(candidate) if candidate else None
        if path is None:
            continue
        ask = [path, "-c", "import sys, ensurepip, venv; print('%d.%d' % sys.version_info[:2])"]
        result = subprocess.run(ask, capture_output=True, text=True, check=False)
        if result.returncode == 0 and result.stdout.strip() == wanted:
            return path
    where = f"apt install python{wanted} python{wanted}-venv, or name one: PYTHON{wanted.replace('.', '_')}=/path/to/python{wanted}"
    raise Unavailable(f"no Python {wanted} with venv ({where})")


def python_with_blender(name: str, folder: Path) -> Path:
    """The Python of the environment for Blender `name` below `folder`, made if it is not there yet."""
    version = VERSIONS[name]
    place = folder / f"bpy-{version.bpy}"
    python = place / "bin" / "python"
    check = [str(python), "-c", f"import bpy, OpenEXR; assert bpy.app.version_string.startswith('{version.bpy}')"]
    if python.exists() and subprocess.run(check, capture_output=True, check=False).returncode == 0:
        return python
    interpreter = _interpreter(version.python)
    shutil.rmtree(place, ignore_errors=True)
    subprocess.run([interpreter, "-m", "venv", str(place)], check=True)
    pip = [str(python), "-m", "pip", "install", "--quiet", "--disable-pip-version-check", *version.requirements]
    result = subprocess.run(pip, capture_output=True, text=True, check=False)
    if result.returncode:
        raise Unavailable(f"pip cannot install {' '.join(version.requirements)}:\n{result.stderr}")
    result = subprocess.run(check, capture_output=True, text=True, check=False)
    if result.returncode:
        raise Unavailable(f"Blender {version.bpy} does not start:\n{result.stderr}")
    return python


if __name__ == "__main__":
    install_libraries()

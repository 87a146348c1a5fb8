"""Windows programs under Wine: built here, started with Windows' paths."""

from __future__ import annotations

import os
import shutil
from dataclasses import dataclass
from pathlib import Path

from conftest import ROOT, TARGET, WINDOWS, Result, cargo, command, succeeded, tool

HERE = Path(__file__).resolve().parent
GCC = "x86_64-w64-mingw32-gcc"


def windows_path(path: Path) -> str:
    """As a Windows program names a file of this machine: drive letter and backslashes."""
    return "Z:" + str(path.resolve()).replace("/", "\\")


@dataclass(frozen=True)
class Wine:
    """Wine with an empty prefix, hush.exe, and helpers in C."""

    program: str
    folder: Path
    exe: Path

    @property
    def variables(self) -> dict[str, str]:
        """Those that Wine goes by."""
        return {"WINEPREFIX": str(self.folder / "prefix"), "WINEDEBUG": "-all", "LC_ALL": "C.UTF-8"}

    @property
    def environment(self) -> dict[str, str]:
        return {name: value for name, value in os.environ.items() if not name.startswith(("HUSH_", "WINE"))} | self.variables

    @property
    def drive_c(self) -> Path:
        return self.folder / "prefix" / "drive_c"

    def hush(self, *words: str | Path, cwd: Path = ROOT, **variables: str) -> Result:
        """Runs hush.exe to its end; paths become Windows' own."""
        return command(*self.line(*words), env=self.environment | variables, cwd=cwd, limit=1800)

    def line(self, *words: str | Path) -> list[str]:
        """The command line of hush.exe."""
        return [self.program, str(self.exe), *(windows_path(word) if isinstance(word, Path) else word for word in words)]

    def helper(self, name: str) -> Path:
        """A program of this folder, compiled."""
        made = self.folder / f"{name}.exe"
        succeeded(command(tool(GCC), "-municode", "-o", made, HERE / f"{name}.c"))
        return made

    def stop(self) -> None:
        """Ends what is left in the prefix."""
        server = shutil.which("wineserver") or "/usr/lib/wine/wineserver"
        command(server, "-k", env=self.environment)


def start() -> Wine:
    """Builds hush.exe and makes the prefix."""
    succeeded(cargo(WINDOWS, "build"))
    folder = TARGET / "wine"
    folder.mkdir(parents=True, exist_ok=True)
    exe = folder / "hush.exe"
    shutil.copy2(TARGET / WINDOWS / "release" / "hush.exe", exe)
    # Found beside each program, the tests' own too.
    for place in (folder, TARGET / WINDOWS / "release" / "deps"):
        place.mkdir(parents=True, exist_ok=True)
        prng = HERE / "process_prng.c"
        succeeded(command(tool(GCC), "-shared", "-o", place / "bcryptprimitives.dll", prng, "-ladvapi32"))
    made = Wine(tool("wine64", "/usr/lib/wine/wine64", "wine"), folder, exe)
    succeeded(command(made.program, "wineboot", "-i", env=made.environment))
    return made

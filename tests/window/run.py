"""Presses the extension's buttons in a window of a real Blender, checks what comes of it and takes pictures of how it looks.

    python tests/window/run.py                                    # as root on Debian: Blender 4.3 in a Debian of its own, 2 GB, ten minutes
    python tests/window/run.py --suite sid                        # the Blender of another Debian: 5.2 in November 2026
    python tests/window/run.py --blender ~/blender-5.0/blender    # any other Blender, under Xvfb or on the screen that is there
    python tests/window/run.py --zip hush-0.1.0-linux_x64.zip     # this zip; without, one is built from the sources

Blender as a Python module, which all other tests take, has no window. The events are Blender's own (`--enable-event-simulate`): it takes
none of the mouse and keyboard meanwhile. A small shot is rendered on the way, some minutes on two cores.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
TARGET = Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target")).resolve()
MIRROR = "http://deb.debian.org/debian"
PACKAGES = ["blender", "xvfb", "xauth", "libgl1-mesa-dri", "libegl1", "python3-numpy", "python3-cattr", "python3-requests", "imagemagick"]
SIZE = "1400x860"
TIME_LIMIT = 1800.0


def debian(suite: str, place: Path) -> None:
    """A Debian with Blender, unless it is there."""
    if (place / "usr/bin/blender").exists():
        return
    if shutil.which("debootstrap") is None:
        sys.exit("run.py: debootstrap is missing (apt install debootstrap); or name a Blender with --blender")
    subprocess.run(["debootstrap", "--variant=minbase", suite, place, MIRROR], check=True)
    install = ["apt-get", "install", "--yes", "--no-install-recommends", *PACKAGES]
    subprocess.run([*inside(place, []), "env", "DEBIAN_FRONTEND=noninteractive", *install], check=True)


def inside(place: Path, seen: list[Path]) -> list[str | Path]:
    """What runs the command behind it in that Debian, where some folders of this machine lie where they lie here; the mounts go with it."""
    mounts = [f"mount --bind /{name} '{place}/{name}'" for name in ("proc", "dev")]
    for path in seen:
        (place / path.relative_to("/")).mkdir(parents=True, exist_ok=True)
        mounts.append(f"mount --bind '{path}' '{place}{path}'")
    script = " && ".join([*mounts, 'exec chroot "$@"'])
    return ["unshare", "--mount", "sh", "-c", script, "sh", place]


def built_zip() -> Path:
    """The zip of this system, from the sources."""
    subprocess.run([sys.executable, ROOT / "blender_addon" / "build.py"], check=True)
    return max((TARGET / "blender").glob("hush-*-linux_x64.zip"), key=lambda path: path.stat().st_mtime)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--blender", type=Path, help="the program; without, Debian's")
    parser.add_argument("--suite", default="trixie", help="of Debian, whose Blender it is (trixie)")
    parser.add_argument("--zip", type=Path, help="of the extension")
    parser.add_argument("--scratch", type=Path, default=TARGET / "window", help="folder for everything (target/window)")
    parser.add_argument("--pictures", type=Path, help="folder for the pictures (pictures, in scratch)")
    chosen = parser.parse_args()
    scratch, archive = chosen.scratch.resolve(), (chosen.zip or built_zip()).resolve()
    pictures = (chosen.pictures or scratch / "pictures").resolve()
    work, user = scratch / "work", scratch / "user"
    for folder in (work, user):
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
    pictures.mkdir(parents=True, exist_ok=True)
    shutil.copy(archive, work / archive.name)
    variables = {
        "BLENDER_USER_RESOURCES": user,
        "XDG_RUNTIME_DIR": work,
        "LIBGL_ALWAYS_SOFTWARE": "1",
        "PYTHONPATH": "",
        "HUSH_WINDOW": json.dumps({"root": str(ROOT), "work": str(work), "pictures": str(pictures)}),
    }
    blender = str(chosen.blender.resolve()) if chosen.blender else "blender"
    install = [blender, "--command", "extension", "install-file", "-r", "user_default", "-e", str(work / archive.name)]
    width, height = SIZE.split("x")
    look = ["--window-geometry", "0", "0", width, height, "--enable-event-simulate"]
    shot = [blender, "--background", "--factory-startup", "--python-exit-code", "1", "--python", str(HERE / "shot.py")]
    press = [blender, str(work / "still_life.blend"), *look, "--python", str(HERE / "press.py")]
    screen = ["xvfb-run", "--auto-servernum", f"--server-args=-screen 0 {SIZE}x24"]
    press = press if chosen.blender and os.environ.get("DISPLAY") else [*screen, *press]
    settings = ["env", *(f"{name}={value}" for name, value in variables.items())]
    machine: list[str | Path] = []
    if not chosen.blender:
        debian(chosen.suite, scratch / chosen.suite)
        machine = inside(scratch / chosen.suite, [ROOT, scratch, pictures])
    with (work / "log.txt").open("wb") as log:
        for words in (install, shot, press):
            subprocess.run([*machine, *settings, *words], check=False, timeout=TIME_LIMIT, stdout=log, stderr=log)
    said = (work / "log.txt").read_text(errors="replace")
    results = work / "results.json"
    cases = json.loads(results.read_text()) if results.exists() else []
    for case in cases:
        print(f"{'FAILED' if case['error'] else 'ok':>6}  {case['name']}  ({case['seconds']:.1f} s)")
    wrong = [f"{case['name']}\n{case['error']}" for case in cases if case["error"]]
    wrong += [] if cases and cases[-1]["name"] == "end" else [f"it did not come to its end\n{said[-3000:]}"]
    wrong += [f"an error in a window\n{said[-3000:]}"] if "Traceback" in said else []
    print("\n".join(wrong) or f"{len(cases)} passed; pictures in {pictures}")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())

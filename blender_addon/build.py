"""Builds the Blender extension: hush-<version>-<platform>.zip, with the wheel of Hush inside.

    python blender_addon/build.py                                # builds the wheel first where there is none
    python blender_addon/build.py --wheel a.whl --wheel b.whl    # one zip a platform, from wheels made elsewhere

The same sources and wheels give the same bytes. The zip is checked by Blender's own `validate` where Blender is at hand:
`--blender blender`, or a Python with the bpy package running this script.
"""

from __future__ import annotations

import argparse
import fnmatch
import importlib.util
import os
import re
import shutil
import subprocess
import sys
import tomllib
import zipfile
from collections import defaultdict
from pathlib import Path

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent
MANIFEST = "blender_manifest.toml"
DISTRIBUTION = "hush_denoise"
# Every entry of the zip has this date, the earliest a zip can hold.
DATE = (1980, 1, 1, 0, 0, 0)
SYSTEMS = {"manylinux": "linux", "linux": "linux", "macosx": "macos", "win": "windows"}
MACHINES = {"x86_64": "x64", "amd64": "x64", "aarch64": "arm64", "arm64": "arm64"}


class BuildError(Exception):
    """What keeps the zip from being built, in words."""


def platforms(wheel: Path) -> list[str]:
    """Blender's names of the platforms a wheel runs on: `linux-x64`, `windows-x64`, `macos-arm64` …"""
    fields = wheel.stem.split("-")
    if wheel.suffix != ".whl" or len(fields) not in (5, 6):
        raise BuildError(f"{wheel} is not named as a wheel")
    found: list[str] = []
    for tag in fields[-1].split("."):
        system = next((SYSTEMS[name] for name in SYSTEMS if re.match(rf"{name}\d*_", tag)), None)
        machines = ["x64", "arm64"] if tag.endswith("universal2") else [new for old, new in MACHINES.items() if tag.endswith(f"_{old}")]
        if system is None or not machines:
            raise BuildError(f"{wheel.name}: unknown platform {tag}")
        found += [f"{system}-{machine}" for machine in machines]
    return sorted(set(found))


def version() -> str:
    """The version of the extension; the crate's must be the same."""
    extension = tomllib.loads((HERE / MANIFEST).read_text(encoding="utf-8"))["version"]
    crate = tomllib.loads((ROOT / "Cargo.toml").read_text(encoding="utf-8"))["package"]["version"]
    if extension != crate:
        raise BuildError(f"{MANIFEST} says version {extension}, Cargo.toml {crate}: make them the same")
    return extension


def target() -> Path:
    return Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target"))


def checked(wheel: Path) -> Path:
    """The wheel, if it is there, of this version, and for every Python from 3.11 on."""
    if not wheel.is_file():
        raise BuildError(f"{wheel} is not there")
    expected = f"{DISTRIBUTION}-{version()}-cp311-abi3-"
    if not wheel.name.startswith(expected):
        raise BuildError(f"{wheel.name}: a wheel of this version starts with {expected}")
    try:
        with zipfile.ZipFile(wheel) as archive:
            broken = archive.testzip()
    except zipfile.BadZipFile as error:
        raise BuildError(f"{wheel} is damaged: {error}") from error
    if broken is not None:
        raise BuildError(f"{wheel} is damaged: {broken}")
    return wheel


def built_wheel() -> Path:
    """The wheel of this machine in target/wheels, built by maturin; cargo sees to it that only what changed is compiled."""
    folder = target() / "wheels"
    beside = Path(sys.executable).with_name("maturin")
    maturin = str(beside) if beside.is_file() else shutil.which("maturin")
    if maturin is None:
        raise BuildError("maturin is not there to build the wheel: pip install maturin, or name a wheel with --wheel")
    subprocess.run([maturin, "build", "--release", "--locked", "--out", str(folder)], cwd=ROOT, check=True)
    found = sorted(folder.glob(f"{DISTRIBUTION}-{version()}-cp311-abi3-*.whl"), key=lambda path: path.stat().st_mtime)
    if not found:
        raise BuildError(f"maturin left no wheel of version {version()} for all Pythons (abi3) in {folder}")
    return found[-1]


def sources() -> list[Path]:
    """The files of blender_addon/ that belong in the zip, by the manifest's exclude patterns."""
    patterns = tomllib.loads((HERE / MANIFEST).read_text(encoding="utf-8"))["build"]["paths_exclude_pattern"]

    def excluded(path: Path) -> bool:
        parts = path.relative_to(HERE).parts
        for pattern in patterns:
            name, places = pattern.strip("/"), parts[:1] if pattern.startswith("/") else parts
            if pattern.endswith("/"):
                places = places[: len(parts) - 1]
            if any(fnmatch.fnmatchcase(part, name) for part in places):
                return True
        return False

    # The wheels are named one by one.
    found = [path for path in sorted(HERE.rglob("*")) if path.is_file() and path.suffix != ".whl" and not excluded(path)]
    if HERE / "__init__.py" not in found:
        raise BuildError(f"{HERE / '__init__.py'} is not there")
    return found


def manifest(names: list[str], wheels: list[str]) -> str:
    """The manifest for these platforms with these wheels."""
    text = (HERE / MANIFEST).read_text(encoding="utf-8")
    head, permissions, tail = text.partition("[permissions]")
    # Those of a release make room for these.
    head = re.sub(r"(?ms)^(#[^\n]*\n)?(platforms|wheels) = \[.*?\]\n", "", head)
    quoted = lambda values: ", ".join(f'"{value}"' for value in values)
    lines = head.splitlines()
    while not lines[-1]:
        lines.pop()
    if names:
        lines.append(f"platforms = [{quoted(names)}]")
    if wheels:
        lines.append(f"wheels = [{quoted(wheels)}]")
    return "\n".join(lines) + "\n\n" + permissions + tail


def pack(destination: Path, names: list[str], wheels: list[Path]) -> None:
    """Writes one zip, aside and then renamed."""
    destination.parent.mkdir(parents=True, exist_ok=True)
    aside = destination.with_name(f".{destination.name}.part")
    inside = [f"./wheels/{wheel.name}" for wheel in wheels]
    entries = {path.relative_to(HERE).as_posix(): path.read_bytes() for path in sources()}
    entries[MANIFEST] = manifest(names, inside).encode()
    entries.update({f"wheels/{wheel.name}": wheel.read_bytes() for wheel in wheels})
    try:
        with zipfile.ZipFile(aside, "w") as archive:
            for name in sorted(entries):
                info = zipfile.ZipInfo(name, DATE)
                info.external_attr = 0o644 << 16
                info.create_system = 3
                info.compress_type = zipfile.ZIP_STORED if name.endswith(".whl") else zipfile.ZIP_DEFLATED
                archive.writestr(info, entries[name])
        aside.replace(destination)
    finally:
        aside.unlink(missing_ok=True)


def blender_validate(destination: Path, blender: str | None) -> str:
    """Has Blender check the zip; says by which means, or that there was none."""
    if blender is not None:
        command = [blender, "--command", "extension", "validate", str(destination)]
    else:
        spec = importlib.util.find_spec("bpy")
        folder = Path(spec.origin).parent if spec and spec.origin else None
        script = next(iter(sorted(folder.glob("*/scripts/addons_core/bl_pkg/cli/blender_ext.py"))), None) if folder else None
        if script is None:
            return "not validated: no Blender at hand (--blender)"
        command = [sys.executable, str(script), "validate", str(destination)]
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    if result.returncode:
        raise BuildError(f"Blender refuses {destination}:\n{result.stdout}{result.stderr}")
    return "validated by Blender"


def build(wheels: list[Path], output: Path, blender: str | None) -> list[Path]:
    """One zip a platform; returns their paths."""
    by_platform: dict[str, list[Path]] = defaultdict(list)
    for wheel in map(checked, wheels):
        for platform in platforms(wheel):
            by_platform[platform].append(wheel)
    made: list[Path] = []
    for platform, bundled in sorted(by_platform.items()):
        if len(bundled) > 1:
            raise BuildError(f"several wheels for {platform}: {', '.join(wheel.name for wheel in bundled)}")
        destination = output / f"hush-{version()}-{platform.replace('-', '_')}.zip"
        pack(destination, [platform], bundled)
        print(f"{destination} ({destination.stat().st_size / 1e6:.1f} MB, {blender_validate(destination, blender)})")
        made.append(destination)
    return made


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--wheel", type=Path, action="append", help="wheel to bundle, one a platform; built by maturin if none is named")
    parser.add_argument("--output", type=Path, default=target() / "blender", help="folder for the zips (target/blender)")
    parser.add_argument("--blender", help="Blender to validate with")
    parser.add_argument(
        "--without-wheel", action="store_true", help="only the Python files, for work on the add-on itself; it cannot denoise"
    )
    chosen = parser.parse_args()
    try:
        if chosen.without_wheel:
            destination = chosen.output / f"hush-{version()}-without-wheel.zip"
            pack(destination, [], [])
            print(f"{destination} ({blender_validate(destination, chosen.blender)})")
        else:
            build(chosen.wheel or [built_wheel()], chosen.output, chosen.blender)
    except BuildError as error:
        print(f"build.py: {error}", file=sys.stderr)
        return 1
    except subprocess.CalledProcessError as error:
        print(f"build.py: {' '.join(map(str, error.cmd))} failed", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())

"""The version, which stands in several files: tells whether all of them agree, or puts another one into all of them.

    python release/version.py --check            # exit with 1, naming each place that has another one
    python release/version.py --check v0.2.0     # as that of the tag too, with the heading of it in CHANGELOG.md
    python release/version.py --set 0.2.0
    python release/version.py --notes            # what CHANGELOG.md says of it

`Cargo.toml` has the word.
"""

from __future__ import annotations

import argparse
import re
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
# Each place as a pattern around the version, which may match more than once.
PLACES = {
    "Cargo.toml": r'(?m)(?<=^name = "hush-denoise"\nversion = ")[^"]+',
    "Cargo.lock": r'(?<=name = "hush-denoise"\nversion = ")[^"]+',
    "fuzz/Cargo.lock": r'(?<=name = "hush-denoise"\nversion = ")[^"]+',
    "blender_addon/blender_manifest.toml": r'(?m)(?:(?<=^version = ")|(?<=/hush_denoise-))[0-9][^"-]*',
    "docs/install.md": r"(?:(?<=`hush-)|(?<=hush_denoise-))[0-9]+\.[0-9]+\.[0-9]+",
    "docs/releasing.md": r"(?:(?<=git tag v)|(?<=origin v)|(?<=download v))[0-9]+\.[0-9]+\.[0-9]+",
}


def text(name: str, root: Path) -> str:
    return (root / name).read_text(encoding="utf-8")


def version(root: Path = ROOT) -> str:
    """That of `Cargo.toml`."""
    return re.findall(PLACES["Cargo.toml"], text("Cargo.toml", root))[0]


def notes(root: Path = ROOT) -> str | None:
    """What stands in CHANGELOG.md below the heading of the version; None without one."""
    found = re.search(rf"(?ms)^## \[?v?{re.escape(version(root))}\b(?![.-])[^\n]*\n(.*?)(?=^## |\Z)", text("CHANGELOG.md", root))
    return found[1].strip() + "\n" if found else None


def wrong(tag: str | None, root: Path = ROOT) -> list[str]:
    """What does not agree, a line for each."""
    expected, said = version(root), []
    for name, pattern in PLACES.items():
        found = re.findall(pattern, text(name, root))
        if not found:
            said.append(f"{name}: the version is not where it was: see PLACES in release/version.py")
        said += [f"{name} says {other}, Cargo.toml {expected}" for other in sorted(set(found) - {expected})]
    if tag is not None and tag != f"v{expected}":
        said.append(f"the tag is {tag}, Cargo.toml says {expected}")
    if tag is not None and notes(root) is None:
        said.append(f"CHANGELOG.md has no heading '## {expected}, the day'")
    return said


def put(new: str, root: Path = ROOT) -> None:
    """Puts a version into all places."""
    for name, pattern in PLACES.items():
        (root / name).write_text(re.sub(pattern, new, text(name, root)), encoding="utf-8", newline="\n")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument("--check", nargs="?", const="", metavar="TAG", help="whether all places agree, and with a tag")
    what.add_argument("--set", metavar="VERSION", help="the new one, for all places")
    what.add_argument("--notes", action="store_true", help="print what CHANGELOG.md says of it")
    chosen = parser.parse_args()
    if chosen.set is not None:
        if not re.fullmatch(r"\d+\.\d+\.\d+", chosen.set):
            parser.error(f"{chosen.set}: three numbers, as in 0.2.0")
        put(chosen.set)
    elif chosen.notes:
        sys.stdout.write(notes() or sys.exit(f"CHANGELOG.md has no heading '## {version()}, the day'"))
    elif said := wrong(chosen.check or None):
        sys.exit("\n".join(said))


if __name__ == "__main__":
    main()

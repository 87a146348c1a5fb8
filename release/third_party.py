"""Writes THIRD-PARTY.txt: what is linked into the program and the wheel, and the licences that ask to be handed on.

    python release/third_party.py            # after a change of Cargo.lock; --check tells whether it is current

Crates under Apache-2.0, alone or by choice, are listed: the text is in LICENSE. The others' own texts follow, each once. Needs cargo, and
the crates' sources, which cargo fetches.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from collections import defaultdict
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
TARGET = ROOT / "THIRD-PARTY.txt"
FONT = ROOT / "assets" / "DejaVuSans-LICENSE.txt"
HEAD = (
    "The program and the wheel of Hush hold code of these crates, and a part of the font DejaVu Sans. Written by\n"
    "release/third_party.py.\n\n"
)


def cargo(*arguments: str) -> str:
    return subprocess.run(["cargo", *arguments], cwd=ROOT, capture_output=True, text=True, check=True).stdout


def linked() -> set[tuple[str, str]]:
    """Name and version of every crate that the program or the wheel links on some system."""
    tree = cargo("tree", "--locked", "--edges", "normal", "--prefix", "none", "--features", "python", "--target", "all", "--format", "{p}")
    words = (line.split() for line in tree.splitlines() if line.strip())
    return {(name, version.removeprefix("v")) for name, version, *_ in words if name != "hush-denoise"}


def texts(folder: Path) -> list[str]:
    """The licences in a crate's folder, Apache's own text left out."""
    names = ("license", "licence", "copying", "unlicense", "notice")
    found = sorted(path for path in folder.iterdir() if path.is_file() and path.name.lower().startswith(names))
    read = [path.read_text(encoding="utf-8", errors="replace").replace("\r\n", "\n").strip() for path in found]
    return [text for text in read if "Apache License" not in text[:400]]


def document() -> str:
    """The whole file."""
    metadata = json.loads(cargo("metadata", "--locked", "--features", "python", "--format-version", "1"))
    packages = {(p["name"], p["version"]): p for p in metadata["packages"]}
    apache, others, silent = [], defaultdict(list), []
    for name, version in sorted(linked()):
        package = packages[name, version]
        licence, title = package["license"] or "", f"{name} {version}"
        if "Apache-2.0" in licence and " AND " not in licence:
            apache.append(f"{title} ({licence})")
            continue
        own = texts(Path(package["manifest_path"]).parent)
        if not own:
            silent.append(f"{title} ({licence}), {', '.join(package['authors']) or package['repository']}")
        for text in own:
            others[text].append(f"{title} ({licence})")
    parts = [HEAD, "Under Apache-2.0, whose text is in LICENSE:\n", *(f"  {line}\n" for line in apache)]
    parts += ["\nWithout a licence text in the crate:\n", *(f"  {line}\n" for line in silent)] if silent else []
    for text, crates in [*others.items(), (FONT.read_text(encoding="utf-8").strip(), ["DejaVu Sans"])]:
        parts.append(f"\n{'-' * 80}\n{', '.join(crates)}\n\n{text}\n")
    return "".join(parts)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--check", action="store_true", help="write nothing; exit with 1 where the file is out of date")
    chosen = parser.parse_args()
    text = document()
    if chosen.check:
        there = TARGET.read_text(encoding="utf-8") if TARGET.exists() else ""
        sys.exit(None if there == text else f"{TARGET.name} is out of date: python release/third_party.py")
    TARGET.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()

"""What a packaged crate holds: all that it is built from, and nothing under another licence than it says."""

from __future__ import annotations

import re
import subprocess

from conftest import ROOT


def test_the_crate_holds_what_it_is_built_from() -> None:
    told = subprocess.run(
        ["cargo", "package", "--list", "--allow-dirty", "--offline"], cwd=ROOT, capture_output=True, text=True, check=True
    ).stdout
    inside = set(told.splitlines())
    built_from = {"LICENSE", "THIRD-PARTY.txt", "README.md", "Cargo.lock", "assets/DejaVuSans-LICENSE.txt"}
    for source in sorted(ROOT.glob("src/**/*.rs")):
        built_from.add(source.relative_to(ROOT).as_posix())
        for name in re.findall(r'include_(?:bytes|str)!\("([^"]+)"\)', source.read_text(encoding="utf-8")):
            built_from.add((source.parent / name).resolve().relative_to(ROOT).as_posix())
    # The golden tensors are the unit tests', which come from the repository.
    missing = {name for name in built_from - inside if not name.startswith("tests/data/")}
    assert missing == set()
    foreign = [name for name in inside if name.endswith((".py", ".rs")) and "GPL-3.0" in (ROOT / name).read_text(encoding="utf-8")]
    assert foreign == []
    size = sum((ROOT / name).stat().st_size for name in inside if (ROOT / name).is_file())
    assert size < 10_000_000, "crates.io takes 10 MiB, packed"

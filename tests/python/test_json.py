"""The JSON of commands that give one object: it has the fields that docs/command-line.md names, and no others at its top."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from conftest import ROOT, Hush

SECTION = "## JSON of the other commands"


def rows() -> dict[str, str]:
    """The table's fields by command."""
    text = (ROOT / "docs" / "command-line.md").read_text(encoding="utf-8").split(SECTION)[1].split("\n## ")[0]
    return dict(re.findall(r"^\| `([^`]+)` \| (.+) \|$", text, re.MULTILINE))


def keys(value: object) -> Iterator[str]:
    """The names of all fields, at any depth."""
    if isinstance(value, dict):
        for key, inner in value.items():
            yield key
            yield from keys(inner)
    elif isinstance(value, list):
        for inner in value:
            yield from keys(inner)


def outermost(text: str) -> str:
    """Without what stands in parentheses, one in the other or not."""
    while (shorter := re.sub(r"\([^()]*\)", "", text)) != text:
        text = shorter
    return text


@pytest.mark.parametrize("command", rows())
def test_the_fields_are_those_of_the_docs(command: str, hush: Hush, shot: Path, reference: Path, denoised: Path, tmp_path: Path) -> None:
    inputs: dict[str, list[str | Path]] = {
        "denoise --dry-run": [shot, "--output", tmp_path / "out", "--frames", "1,30"],
        "check": [shot, "--output", denoised],
        "inspect": [shot / "frame_0001.exr"],
        "survey": [shot],
        "shot show": [shot],
        "eval": [reference, denoised],
    }
    made = json.loads(hush(*command.split(), "--json", *inputs[command]).stdout)
    told = rows()[command]
    named = lambda text: set(re.findall(r"`(\w+)`", text))
    assert named(outermost(told)) == set(made)
    assert named(told) <= set(keys(made))

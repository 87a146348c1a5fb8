"""What the pages and the programs' own first lines say can be typed: python -m pytest training"""

from __future__ import annotations

import importlib
import re
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
SOURCES = [path for path in sorted(ROOT.glob("training/**/*.py")) if 'if __name__ == "__main__":\n' in path.read_text()]
PROGRAMS = {".".join(path.relative_to(ROOT).with_suffix("").parts): path for path in SOURCES}
PAGES = [ROOT / "training/README.md", ROOT / "training/RESULTS.md", ROOT / "training/NOTES.md", ROOT / "docs/training.md"]
OPTION = re.compile(r"(?<![\w-])--[a-z][a-z-]*")


def help_of(program: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> str:
    """What `--help` prints; the test is skipped where another environment has what the program wants."""
    for wanted in ("mitsuba", "pyoidn"):
        if re.search(rf"^import {wanted}\b", PROGRAMS[program].read_text(), re.MULTILINE):
            pytest.importorskip(wanted)
    monkeypatch.setattr(sys, "argv", [program, "--help"])
    with pytest.raises(SystemExit) as ended:
        importlib.import_module(program).main()
    assert not ended.value.code
    return capsys.readouterr().out


def told() -> list[tuple[str, str]]:
    """Each command on the pages and in the programs, as the program and what follows it."""
    found = []
    for path in (*PAGES, *SOURCES):
        text = re.sub(r"\\\n\s*", "", path.read_text())
        for program, rest in re.findall(r"-m (training\.[\w.]+)((?:[ \n]+[^`\n]*(?:\n--[^`\n]*)?)?)", text):
            found.append((program, re.split(r"`|  #|\s&&\s", rest)[0]))
    return found


@pytest.mark.parametrize("program", sorted(PROGRAMS))
def test_every_program_tells_its_options_and_has_those_that_are_told(
    program: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    _, found, text = help_of(program, monkeypatch, capsys).partition("\noptions:\n")  # before them the program's first lines
    assert found
    used = {option for name, rest in told() if name == program for option in OPTION.findall(rest)}
    assert used <= set(OPTION.findall(text)), used - set(OPTION.findall(text))


def test_every_program_that_is_told_is_there() -> None:
    names = {name for name, _ in told()}
    assert len(names) > 15
    assert names <= set(PROGRAMS), names - set(PROGRAMS)

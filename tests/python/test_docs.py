"""The documents: links and pictures that exist, a README of one screen, commands and options that the program has."""

from __future__ import annotations

import re
import shlex
from functools import cache
from pathlib import Path

import pytest
from conftest import ROOT, Hush

BUILT = re.compile(r"(^|/)(\.|target/|runs/|venv/|node_modules/)")  # and hidden folders
PAGES = sorted(p for p in ROOT.rglob("*.md") if not BUILT.search(str(p.relative_to(ROOT))))
# Commands of days gone by are told in the changelog, and measurements of then in the notes.
OF_TODAY = [p for p in PAGES if p.name not in {"CHANGELOG.md", "NOTES.md", "RESULTS.md", "STABILITY.md"}]

FOLDERS = "benches|blender_addon|docs|examples|farm|fuzz|models|python|release|samples|src|tests|training"
FENCE = re.compile(r"^```.*?^```$", re.MULTILINE | re.DOTALL)
LINK = re.compile(r"!?\[[^\]]*\]\(([^)\s]+)\)")
HEADING = re.compile(r"^#+ (.+)$", re.MULTILINE)
OPTION = re.compile(r"(?<![\w-])--[a-z][a-z-]*")


def name_of(page: Path) -> str:
    return str(page.relative_to(ROOT))


@cache
def anchors(page: Path) -> set[str]:
    """What a link may name behind the `#`, as GitHub makes it of the headings."""
    titles = (re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", title) for title in HEADING.findall(FENCE.sub("", page.read_text())))
    return {re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in titles}


def wrong_links(page: Path, text: str) -> list[str]:
    """The links of a page that lead nowhere."""
    wrong = []
    for link in LINK.findall(FENCE.sub("", text)):
        if re.match(r"[a-z]+:", link):
            continue
        name, _, anchor = link.partition("#")
        target = (page.parent / name).resolve() if name else page
        if not target.exists() or (anchor and anchor not in anchors(target)):
            wrong.append(link)
    return wrong


def commands(text: str) -> list[list[str]]:
    """The calls of hush in a page's code, each as its words."""
    blocks = [block.strip("`") for block in FENCE.findall(text)]
    lines = [line for block in blocks for line in block.replace("\\\n", " ").splitlines()]
    lines += re.findall(r"`([^`\n]+)`", FENCE.sub("", text))
    calls = []
    for line in lines:
        call = re.match(r"(?:RemoteCmd \{|python -m )?(?:target/release/)?hush ((?!-).+?)(?: #|\}|$)", line.strip())
        if call:
            calls.append(shlex.split(call[1]))
    return calls


@pytest.fixture(scope="session")
def help_of(hush: Hush) -> dict[tuple[str, ...], str]:
    """The help of every command and subcommand."""
    texts: dict[tuple[str, ...], str] = {}

    def read(*names: str) -> None:
        texts[names] = hush(*names, "--help").stdout
        below = re.search(r"^Commands:\n((?:  .*\n)+)", texts[names], re.MULTILINE)
        for name in re.findall(r"^  ([a-z-]+)", below[1], re.MULTILINE) if below else ():
            if name != "help":
                read(*names, name)

    read()
    return texts


def unknown(words: list[str], help_of: dict[tuple[str, ...], str]) -> list[str]:
    """What of a call of hush the program does not know."""
    name: tuple[str, ...] = ()
    for word in words:
        if (*name, word) not in help_of:
            break
        name = (*name, word)
    if not name and words[0] != "COMMAND":
        return [words[0]]
    known = set(OPTION.findall("".join(help_of.values()) if not name else help_of[name]))
    return [option for word in words for option in OPTION.findall(word) if option not in known]


def test_the_readme_is_one_screen() -> None:
    assert len((ROOT / "README.md").read_text().splitlines()) <= 150


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_links_and_pictures_lead_somewhere(page: Path) -> None:
    assert wrong_links(page, page.read_text()) == []


def test_a_link_to_nowhere_is_found() -> None:
    text = "[a](no-such-file.md) ![b](docs/no.png) [c](README.md#no-such-heading) [d](README.md#licence) [e](https://example.org)"
    assert wrong_links(ROOT / "README.md", text) == ["no-such-file.md", "docs/no.png", "README.md#no-such-heading"]


@pytest.mark.parametrize("page", OF_TODAY, ids=name_of)
def test_commands_and_their_options_are_the_programs(page: Path, help_of: dict[tuple[str, ...], str]) -> None:
    assert {" ".join(call): wrong for call in commands(page.read_text()) if (wrong := unknown(call, help_of))} == {}


def test_a_command_that_is_none_is_found(help_of: dict[tuple[str, ...], str]) -> None:
    calls = commands("`hush denoize a`\n```\nhush denoise a --no-such  # why\nhush shot show a --json\n```\n")
    assert [unknown(call, help_of) for call in calls] == [["--no-such"], [], ["denoize"]]


def test_every_command_and_option_is_in_the_docs(help_of: dict[tuple[str, ...], str]) -> None:
    text = (ROOT / "docs" / "command-line.md").read_text()
    settings = (ROOT / "docs" / "settings.md").read_text()
    assert [" ".join(name) for name in help_of if name and f"hush {' '.join(name)}" not in text] == []
    told = set(OPTION.findall(text + settings)) | {"--help", "--version"}
    assert sorted(set(OPTION.findall("".join(help_of.values()))) - told) == []


def test_every_name_of_the_python_module_is_in_the_docs() -> None:
    listed = re.search(r"__all__ = \[(.*?)\]", (ROOT / "python" / "hush" / "__init__.py").read_text(), re.DOTALL)
    assert listed
    text = (ROOT / "docs" / "python.md").read_text()
    names = [name for name in re.findall(r"\"(\w+)\"", listed[1]) if not name.startswith("__")]
    assert len(names) > 10
    assert [name for name in names if not re.search(rf"\b{name}\b", text)] == []


@pytest.mark.parametrize("page", OF_TODAY, ids=name_of)
def test_files_that_are_named_exist(page: Path) -> None:
    named = re.findall(rf"`((?:{FOLDERS})/[\w./-]*)`", page.read_text())
    assert sorted({path for path in named if not (ROOT / path).exists()}) == []


def test_every_room_is_on_the_floor_plan() -> None:
    rooms = re.findall(r"^\| `(\w+)` \|", (ROOT / "docs" / "architecture.md").read_text(), re.MULTILINE)
    assert [path.name for path in (ROOT / "src").iterdir() if path.is_dir() and path.name not in rooms] == []


def test_no_picture_is_left_over() -> None:
    shown = {link.split("#")[0].rsplit("/", 1)[-1] for page in PAGES for link in LINK.findall(page.read_text())}
    pictures = [p.name for p in (ROOT / "docs").iterdir() if p.suffix in {".png", ".svg"}]
    assert [name for name in pictures if name not in shown] == []


def test_every_kind_of_warning_is_named() -> None:
    kinds = re.search(r"pub enum WarningKind \{(.*?)\n\}", (ROOT / "src/rules/checks.rs").read_text(), re.DOTALL)
    named = re.search(r"^Kinds of warnings: (.*?)\n\n", (ROOT / "docs/command-line.md").read_text(), re.DOTALL | re.MULTILINE)
    assert kinds
    assert named
    words = (re.sub(r"(?<!^)(?=[A-Z])", "_", kind).lower() for kind in re.findall(r"^    (\w+),$", kinds[1], re.MULTILINE))
    assert sorted(words) == sorted(re.findall(r"`(\w+)`", named[1]))

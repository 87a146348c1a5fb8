"""Tests the Blender extension: installs the real zip in each Blender and runs the cases in it.

    python tests/blender/run.py                                  # builds the zip; all cases in 5.3, 5.2, 5.0, 4.5 and 4.2
    python tests/blender/run.py --version 5.0 --case denoise     # cases whose name contains this
    python tests/blender/run.py --zip hush-0.1.0-linux_x64.zip   # this zip

Environments with Blender are kept in HUSH_TEST_VENVS, by default target/bpy. See README.md beside this file.
"""

from __future__ import annotations

import argparse
import ast
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path

import venvs

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
TARGET = Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target")).resolve()
VENVS = Path(os.environ.get("HUSH_TEST_VENVS", TARGET / "bpy")).resolve()
TIME_LIMIT = 300.0


@dataclass
class Tally:
    passed: int = 0
    failures: list[str] = field(default_factory=list)

    def add(self, name: str, seconds: float, error: str | None) -> None:
        print(f"{'FAILED' if error else 'ok':>6}  {name}  ({seconds:.1f} s)", flush=True)
        if error:
            self.failures.append(f"{name}\n{error}")
        else:
            self.passed += 1


def time_limit(case: Path) -> float:
    """`TIME_LIMIT = seconds` in the case, else the default."""
    for node in ast.parse(case.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name) and node.targets[0].id == "TIME_LIMIT":
            return float(ast.literal_eval(node.value))
    return TIME_LIMIT


def environment(user: Path, scratch: Path, version_folder: Path) -> dict[str, str]:
    """Of a process with Blender: its own user folder, the same words and threads everywhere."""
    kept = {name: value for name, value in os.environ.items() if not name.startswith(("BLENDER_", "PYTHON"))}
    kept.update(
        BLENDER_USER_RESOURCES=str(user),
        PYTHONPATH=str(HERE),
        PYTHONDONTWRITEBYTECODE="1",
        PYTHONUNBUFFERED="1",
        LC_ALL="C.UTF-8",
        TMPDIR=str(scratch / "tmp"),
        HUSH_CASE_FOLDER=str(scratch),
        HUSH_TEST_VENVS=str(VENVS),
        HUSH_SHOTS=str(version_folder / "shots"),
    )
    return kept


def call(command: list[str], env: dict[str, str], cwd: Path, log: Path, limit: float) -> str | None:
    """Runs a command in a group of its own; returns what went wrong: exit code, time, processes left behind."""
    (cwd / "tmp").mkdir(parents=True, exist_ok=True)
    with log.open("ab") as output:
        process = subprocess.Popen(
            command, env=env, cwd=cwd, stdin=subprocess.DEVNULL, stdout=output, stderr=subprocess.STDOUT, start_new_session=True
        )
        wrong = None
        try:
            code = process.wait(limit)
            if code:
                wrong = f"exit code {code}"
        except subprocess.TimeoutExpired:
            wrong = f"still running after {limit:.0f} s"
        left = False
        for _ in range(30):
            left = group_alive(process.pid)
            if wrong or not left:
                break
            time.sleep(0.1)
        if left:
            wrong = wrong or "left a process running"
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()
    return wrong


def group_alive(group: int) -> bool:
    try:
        os.killpg(group, 0)
    except ProcessLookupError:
        return False
    return True


def tail(log: Path, lines: int = 40) -> str:
    return "\n".join(log.read_text(encoding="utf-8", errors="replace").splitlines()[-lines:])


def validate(python: str, archive: Path) -> str | None:
    """What Blender's own check of extensions says against the zip, if anything."""
    script = next(Path(python).parents[1].glob("lib/*/site-packages/bpy/*/scripts/addons_core/bl_pkg/cli/blender_ext.py"))
    result = subprocess.run([python, str(script), "validate", str(archive)], capture_output=True, text=True, check=False)
    return f"{result.stdout}{result.stderr}" if result.returncode else None


def run_version(name: str, archive: Path, cases: list[Path], tally: Tally, keep: bool) -> None:
    """Installs the zip into a fresh user folder, then runs each case in its own process with a copy of that folder."""
    python = str(venvs.python_with_blender(name, VENVS))
    folder = TARGET / "blender" / name
    shutil.rmtree(folder, ignore_errors=True)
    user = folder / "user"
    log = folder / "install.log"
    (folder / "shots").mkdir(parents=True)
    user.mkdir()
    began = time.perf_counter()
    wrong = validate(python, archive)
    tally.add(f"{name} validating the zip", time.perf_counter() - began, wrong)
    began = time.perf_counter()
    wrong = call([python, str(HERE / "install.py"), str(archive)], environment(user, folder, folder), folder, log, TIME_LIMIT)
    tally.add(f"{name} installing the zip", time.perf_counter() - began, f"{wrong}\n{tail(log)}" if wrong else None)
    if wrong:
        return
    for case in cases:
        scratch = folder / "cases" / case.stem
        scratch.mkdir(parents=True)
        shutil.copytree(user, scratch / "user", symlinks=True)
        results, log = scratch / "results.jsonl", scratch / "log.txt"
        env = environment(scratch / "user", scratch, folder)
        env["HUSH_ZIP"] = str(archive)
        began = time.perf_counter()
        wrong = call([python, str(HERE / "inside.py"), str(case), str(results)], env, scratch, log, time_limit(case))
        seconds = time.perf_counter() - began
        failed = False
        for line in results.read_text(encoding="utf-8").splitlines() if results.exists() else []:
            result = json.loads(line)
            error = result["error"]
            failed |= error is not None
            tally.add(f"{name} {case.stem} {result['test']}", result["seconds"], f"{error}\n(log: {log})" if error else None)
        tally.add(f"{name} {case.stem} (process)", seconds, f"{wrong}\n{tail(log)}" if wrong else None)
        if not (keep or failed or wrong):
            shutil.rmtree(scratch)
    if not keep:
        shutil.rmtree(folder / "shots")


def built_zip(without_wheel: bool, wheel: Path | None) -> Path:
    """The zip for this machine, by the script that users run."""
    output = TARGET / "blender"
    for old in output.glob("hush-*.zip"):
        old.unlink()
    command = [sys.executable, str(ROOT / "blender_addon" / "build.py"), "--output", str(output)]
    command += ["--without-wheel"] if without_wheel else ["--wheel", str(wheel)] if wheel else []
    subprocess.run(command, check=True)
    found = list(output.glob("hush-*.zip"))
    if len(found) != 1:
        raise venvs.Unavailable(f"build.py should leave one zip in {output}: {found}")
    return found[0]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--version", nargs="+", choices=list(venvs.VERSIONS), default=["5.3", "5.2", "5.0", "4.5", "4.2"])
    parser.add_argument("--case", nargs="+", default=[""], help="only the cases whose name contains one of these")
    parser.add_argument("--zip", type=Path, help="the extension; built by default")
    parser.add_argument("--wheel", type=Path, help="the wheel to put into the zip; built by default")
    parser.add_argument("--without-wheel", action="store_true", help="build the zip without Hush itself")
    parser.add_argument("--keep", action="store_true", help="keep the folders of the cases that pass")
    chosen = parser.parse_args()
    cases = [path for path in sorted((HERE / "cases").glob("*.py")) if any(part in path.stem for part in chosen.case)]
    tally = Tally()
    try:
        if not cases:
            raise venvs.Unavailable(f"no case is named so: {' '.join(chosen.case)}")
        venvs.install_libraries()
        archive = (chosen.zip or built_zip(chosen.without_wheel, chosen.wheel)).resolve()
        for name in chosen.version:
            run_version(name, archive, cases, tally, chosen.keep)
    except (venvs.Unavailable, subprocess.CalledProcessError, OSError) as error:
        print(f"tests/blender: {error}\nHUSH_TEST_BLENDER=0 bash tests/run tests all but the Blender extension.", file=sys.stderr)
        return 1
    for failure in tally.failures:
        print(f"\n=== {failure}")
    print(f"\n{tally.passed} passed, {len(tally.failures)} failed")
    return 1 if tally.failures or not tally.passed else 0


if __name__ == "__main__":
    sys.exit(main())

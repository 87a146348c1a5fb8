"""hush.exe under Wine: the same bits as on Linux, and Windows' own ways with paths, open files, Ctrl-C and locks."""

from __future__ import annotations

import json
import os
import pty
import re
import shutil
import subprocess
import time
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from conftest import SHOT, WINDOWS, Result, Wheels, cargo, command, instruction_sets, pixels, succeeded, tool
from wine import Wine, start, windows_path

MANIFEST = "hush-manifest.json"
LARGEST = 15_000_000
FRAMES = sorted(path.name for path in SHOT.glob("*.exr"))
# Frames take seconds; what hangs is found out.
LIMIT = 600.0

Run = Callable[..., Result]


@pytest.fixture(scope="module")
def wine() -> Iterator[Wine]:
    made = start()
    yield made
    made.stop()


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The first three frames of the sample shot."""
    folder = tmp_path_factory.mktemp("small")
    for name in FRAMES[:3]:
        shutil.copy2(SHOT / name, folder / name)
    return folder


def imports(file: Path) -> set[str]:
    """The libraries that a Windows program or library wants."""
    told = succeeded(command(tool("x86_64-w64-mingw32-objdump"), "-p", file))
    return {name.lower() for name in re.findall(r"DLL Name: (\S+)", told)}


def of_windows(name: str) -> bool:
    """Whether a library is there on every Windows 10."""
    known = {"advapi32.dll", "bcryptprimitives.dll", "kernel32.dll", "msvcrt.dll", "ntdll.dll", "shell32.dll", "userenv.dll", "ws2_32.dll"}
    return name in known or name.startswith(("api-ms-win-core-", "api-ms-win-crt-"))


def wait_for(what: Callable[[], bool], limit: float = LIMIT) -> None:
    end = time.monotonic() + limit
    while not what():
        assert time.monotonic() < end, "it did not come to pass"
        time.sleep(0.1)


def test_the_program_wants_only_windows_libraries(wine: Wine) -> None:
    assert {name for name in imports(wine.exe) if not of_windows(name)} == set()


def test_wheel(wheels: Wheels, tmp_path: Path) -> None:
    wheel = wheels.of("win_amd64")
    assert wheel.name.endswith("-cp311-abi3-win_amd64.whl") and wheel.stat().st_size <= LARGEST
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(tmp_path)
    assert ["Apache License" in path.read_text() for path in tmp_path.glob("*/licenses/LICENSE")] == [True]
    library = tmp_path / "hush" / "_hush.pyd"
    wanted = imports(library)
    assert "python3.dll" in wanted, "not the stable interface of Python"
    assert {name for name in wanted - {"python3.dll"} if not of_windows(name)} == set()
    assert "PyInit__hush" in succeeded(command(tool("x86_64-w64-mingw32-objdump"), "-p", library))


def test_the_engine_agrees_with_pytorch(wine: Wine) -> None:
    runner = {"CARGO_TARGET_X86_64_PC_WINDOWS_GNU_RUNNER": wine.program}
    told = succeeded(cargo(WINDOWS, "test", "--lib", **runner, **wine.variables))
    assert re.search(r"engine::golden_tests::\S+ \.\.\. ok", told), told


@pytest.mark.parametrize("simd", instruction_sets())
def test_the_bits_of_linux(wine: Wine, linux_hush: Run, tmp_path: Path, simd: str) -> None:
    succeeded(linux_hush("denoise", SHOT, "--output", tmp_path / "linux", HUSH_SIMD=simd))
    succeeded(wine.hush("denoise", SHOT, "--output", tmp_path / "windows", HUSH_SIMD=simd))
    linux, windows = pixels(tmp_path / "linux"), pixels(tmp_path / "windows")
    assert linux.keys() == windows.keys() == set(FRAMES)
    assert [name for name in FRAMES if linux[name] != windows[name]] == []


def test_paths(wine: Wine, small: Path, tmp_path: Path) -> None:
    expected = tmp_path / "expected"
    succeeded(wine.hush("denoise", small, "--output", expected))
    spaced = tmp_path / "Ein Film — 霧の朝 (v2) [a]" / "shot 01"
    shutil.copytree(small, spaced)
    on_c = wine.drive_c / "renders"
    shutil.rmtree(on_c, ignore_errors=True)
    shutil.copytree(small, on_c / "shot")
    deep = tmp_path.joinpath("long", *("a folder of many letters" for _ in range(12)))
    shutil.copytree(small, deep)
    assert len(windows_path(deep)) > 300
    z = windows_path(spaced)
    cases: dict[str, tuple[list[str | Path], Path, Path]] = {
        "spaces and unicode": ([spaced, "-o", spaced.parent / "aus"], spaced.parent / "aus", tmp_path),
        "forward slashes": ([z.replace("\\", "/"), "-o", f"{z}/slashes"], spaced / "slashes", tmp_path),
        "a trailing backslash": ([z + "\\", "-o", z + "\\backslash\\"], spaced / "backslash", tmp_path),
        "a pattern with backslashes": ([f"{z}\\frame_####.exr", "-o", f"{z}\\pattern"], spaced / "pattern", tmp_path),
        "a glob, which no shell expands": (["shot\\frame_*.exr", "-o", "globbed"], on_c / "globbed", on_c),
        "drive letter": (["C:\\renders\\shot", "-o", "c:\\renders\\out"], on_c / "out", tmp_path),
        "relative, with dots": ([".\\shot", "-o", "shot\\..\\dots"], on_c / "dots", on_c),
        "verbatim": (["\\\\?\\C:\\renders\\shot", "-o", "\\\\?\\C:\\renders\\verbatim"], on_c / "verbatim", tmp_path),
        "longer than 260": ([deep, "-o", deep / "denoised"], deep / "denoised", tmp_path),
    }
    for what, (words, output, cwd) in cases.items():
        result = wine.hush("denoise", *words, cwd=cwd)
        assert result.returncode == 0, (what, result.stdout, result.stderr)
        assert pixels(output) == pixels(expected), what
    again = json.loads(wine.hush("denoise", deep, "-o", deep / "denoised", "--json").stdout.splitlines()[-1])
    assert (again["skipped"], again["written"]) == (3, 0), again


def test_the_inputs_are_not_written_over(wine: Wine, small: Path, tmp_path: Path) -> None:
    folder = tmp_path / "Shot"
    shutil.copytree(small, folder)
    for same in (windows_path(folder), windows_path(folder).upper(), windows_path(folder) + "\\.", "\\\\?\\" + windows_path(folder)):
        result = wine.hush("denoise", folder, "-o", same)
        assert result.returncode == 1 and "would be overwritten" in result.stderr, (same, result.stderr)
    assert pixels(folder) == pixels(small)


def test_letter_case_makes_no_difference(wine: Wine, small: Path, tmp_path: Path) -> None:
    """A frame that is named in other letter case has its neighbours, and its own name in the output."""
    succeeded(wine.hush("denoise", small, "-o", tmp_path / "expected", "--frames", "2"))
    folder = wine.drive_c / "case"
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(small, folder / "Shot")
    cases: dict[str, list[str]] = {
        "a file": ["C:\\case\\shot\\FRAME_0002.EXR"],
        "a pattern": ["C:\\CASE\\Shot\\Frame_####.EXR", "--frames", "2"],
        "a glob": ["C:\\case\\Shot\\FRAME_*.EXR", "--frames", "2"],
        "two spellings": ["C:\\case\\Shot", "--frames", "2"],
    }
    for what, words in cases.items():
        if what == "two spellings":
            (folder / "Shot" / FRAMES[2]).rename(folder / "Shot" / FRAMES[2].upper())
        succeeded(wine.hush("denoise", *words, "-o", f"C:\\case\\{what}"))
        assert pixels(folder / what) == pixels(tmp_path / "expected"), what


def test_a_stage_is_told_as_it_is_named(wine: Wine, small: Path, tmp_path: Path) -> None:
    """Without what real paths begin with on Windows, which other programs do not take."""
    stage = tmp_path / "a stage.usda"
    product = 'def RenderProduct "Frames" { token productName = "frames/frame_$F4.exr" }'
    render = 'def RenderPass "Pass" { float hush:lambda = 4\r\nrel renderSource = </Settings> }'
    stage.write_bytes(f'#usda 1.0\r\n{product}\r\n{render}\r\ndef RenderSettings "Settings" {{ rel products = </Frames> }}\r\n'.encode())
    shutil.copytree(small, tmp_path / "frames")
    told = succeeded(wine.hush("shot", "show", "--usd", stage))
    frames = windows_path(tmp_path / "frames" / "frame_####.exr")
    assert frames in told.replace("/", "\\") and windows_path(stage) in told and "\\\\?\\" not in told, told


def test_a_quote_behind_a_backslash_is_told(wine: Wine) -> None:
    for words in (['C:\\my shots" -o C:\\out'], ["C:\\my shots", "-o", 'C:\\out" --overwrite']):
        result = wine.hush("denoise", *words)
        assert result.returncode == 1 and "closing quote" in result.stderr, result.stderr


def test_a_folder_that_cannot_be_written(wine: Wine, small: Path) -> None:
    # Linux' own, where nobody may write, root included.
    result = wine.hush("denoise", small, "-o", "Z:\\proc\\self\\denoised")
    assert result.returncode == 1 and "denoised" in result.stderr and "panic" not in result.stderr, result.stderr


def test_a_file_that_is_open_elsewhere(wine: Wine, small: Path, tmp_path: Path) -> None:
    hold, output = wine.helper("hold"), tmp_path / "out"
    succeeded(wine.hush("denoise", small, "-o", output))
    before = pixels(output)

    def denoise_while_held(milliseconds: int) -> Result:
        words = [wine.program, str(hold), windows_path(output / FRAMES[1]), str(milliseconds)]
        holder = subprocess.Popen(words, env=wine.environment, stdout=subprocess.PIPE, text=True)
        assert holder.stdout is not None and holder.stdout.readline().strip() == "held"
        result = wine.hush("denoise", small, "-o", output, "--overwrite", "--lambda", "8")
        holder.kill()
        holder.wait()
        wine.stop()
        return result

    refused = denoise_while_held(600_000)
    assert refused.returncode != 0 and FRAMES[1] in refused.stderr and "open in another program" in refused.stderr, refused.stderr
    assert pixels(output)[FRAMES[1]] == before[FRAMES[1]], "the old file is whole"
    assert [path.name for path in output.iterdir() if path.name.startswith(".")] == []
    succeeded(wine.hush("denoise", small, "-o", output, "--lambda", "8"))
    assert all(pixels(output)[name] != before[name] for name in FRAMES[:3])


@pytest.mark.parametrize("how", [[], ["--poll=1"]], ids=["native", "polling"])
def test_watch(wine: Wine, small: Path, tmp_path: Path, how: list[str]) -> None:
    expected, shot, output = tmp_path / "expected", tmp_path / "shot", tmp_path / "out"
    succeeded(wine.hush("denoise", small, "-o", expected))
    shot.mkdir()
    words = wine.line("watch", shot, "-o", output, "--frames", "1-3", "--json", *how)
    watch = subprocess.Popen(words, env=wine.environment, stdout=subprocess.PIPE, text=True)
    try:
        assert watch.stdout is not None and json.loads(watch.stdout.readline())["event"] == "watching"
        for name in FRAMES[:3]:
            # Written in place and slowly, as Blender does.
            content = (small / name).read_bytes()
            with (shot / name).open("wb") as file:
                for start in range(0, len(content), 1 << 16):
                    file.write(content[start : start + (1 << 16)])
                    time.sleep(0.05)
        events = [json.loads(line) for line in watch.stdout]
        assert watch.wait(LIMIT) == 0, events
    finally:
        watch.kill()
        watch.wait()
    assert [event["frame"] for event in events if event["event"] == "landed"] == [1, 2, 3]
    assert pixels(output) == pixels(expected)
    assert {path.name for path in output.iterdir()} == {*FRAMES[:3], MANIFEST}


def test_ctrl_c(wine: Wine, tmp_path: Path) -> None:
    output = tmp_path / "out"
    # In a terminal of its own, whose Ctrl-C Wine's console turns into Windows'.
    child, terminal = pty.fork()
    if child == 0:
        os.execvpe(wine.program, wine.line("denoise", SHOT, "-o", output), wine.environment | {"TERM": "xterm"})
    said = bytearray()
    try:
        os.set_blocking(terminal, False)

        def read() -> None:
            try:
                while chunk := os.read(terminal, 1 << 16):
                    said.extend(chunk)
            except OSError:
                pass

        def begun() -> bool:
            read()
            return output.is_dir() and bool(pixels(output))

        wait_for(begun)
        os.write(terminal, b"\x03")
        code: list[int] = []

        def ended() -> bool:
            read()
            done, status = os.waitpid(child, os.WNOHANG)
            if done:
                code.append(os.waitstatus_to_exitcode(status))
            return bool(done)

        wait_for(ended)
    finally:
        os.close(terminal)
    assert code == [130], said.decode(errors="replace")
    finished = pixels(output)
    assert 0 < len(finished) < len(FRAMES)
    assert {path.name for path in output.iterdir()} == {*finished, MANIFEST}, "nothing half-written is left"
    frames = json.loads((output / MANIFEST).read_text())["frames"]
    assert finished.keys() == {name for name, frame in frames.items() if frame["status"] == "denoised"}


def test_two_processes_in_one_folder(wine: Wine, small: Path, tmp_path: Path) -> None:
    expected, output = tmp_path / "expected", tmp_path / "out"
    succeeded(wine.hush("denoise", small, "-o", expected))
    lines = [wine.line("denoise", small, "-o", output, "--frames", frames) for frames in ("1", "2", "3")]
    running = [subprocess.Popen(line, env=wine.environment, stdout=subprocess.DEVNULL) for line in lines]
    assert [process.wait(LIMIT) for process in running] == [0, 0, 0]
    assert pixels(output) == pixels(expected)
    assert json.loads((output / MANIFEST).read_text())["frames"].keys() == set(FRAMES[:3])
    assert {path.name for path in output.iterdir()} == {*FRAMES[:3], MANIFEST}


def test_two_watches_share_the_work(wine: Wine, tmp_path: Path) -> None:
    output = tmp_path / "out"
    line = wine.line("watch", SHOT, "-o", output, "--once", "--json")
    running = [subprocess.Popen(line, env=wine.environment, stdout=subprocess.PIPE, text=True) for _ in range(2)]
    told = [process.communicate(timeout=LIMIT)[0] for process in running]
    assert [process.returncode for process in running] == [0, 0]
    events = [event for text in told for event in map(json.loads, text.splitlines())]
    made = sorted(event["frame"] for event in events if event["event"] == "frame" and event["status"] == "denoised")
    assert made == list(range(1, len(FRAMES) + 1)), "each frame once, by either"
    assert pixels(output).keys() == set(FRAMES)

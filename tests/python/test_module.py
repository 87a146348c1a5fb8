"""The Python module on files, and the command line that comes with it."""

from __future__ import annotations

import inspect as introspect
import json
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

import hush
import numpy as np
import pytest
from conftest import ROOT, Hush
from exr_shots import write_shot
from images import channels

COUNT = 4
Events = list[dict[str, Any]]


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A shot of four small frames."""
    return write_shot(tmp_path_factory.mktemp("small") / "shot", COUNT)


@pytest.fixture(scope="module")
def layered(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two frames with two view layers."""
    return write_shot(tmp_path_factory.mktemp("layered") / "shot", 2, ("Near", "Far"))


def pixels(folder: Path) -> dict[str, dict[str, bytes]]:
    return {path.name: {name: image.tobytes() for name, image in channels(path).items()} for path in sorted(folder.glob("*.exr"))}


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir()) if folder.is_dir() else []


def command() -> list[str]:
    """The console script that the wheel installs beside the interpreter."""
    script = Path(sys.executable).parent / ("hush.exe" if os.name == "nt" else "hush")
    assert script.is_file(), f"{script} is not there: install the wheel"
    return [str(script)]


def test_the_module_says_what_it_is() -> None:
    assert hush.LAMBDA_RANGE == (1.0, 64.0)
    assert hush.MAX_WINDOW == 3
    assert issubclass(hush.HushError, Exception)
    assert f'version = "{hush.__version__}"' in (ROOT / "Cargo.toml").read_text()
    assert all(hasattr(hush, name) for name in hush.__all__)
    for name in ("denoise", "Denoiser", "denoise_sequence", "dry_run_sequence", "inspect", "main"):
        assert len(getattr(hush, name).__doc__) > 100, name


def test_the_dry_run_takes_what_the_run_takes() -> None:
    run = introspect.signature(hush.denoise_sequence).parameters
    dry = introspect.signature(hush.dry_run_sequence).parameters
    assert [str(run[name]) for name in dry] == [str(parameter) for parameter in dry.values()]
    assert run.keys() - dry.keys() == {"progress", "cancel"}


def test_the_result_is_that_of_the_command_line(command_line: Hush, small: Path, tmp_path: Path) -> None:
    result = command_line("denoise", small, "--output", tmp_path / "command", "--lambda", "2:3,4:9", "--window", "1", "--json")
    assert result.returncode == 0, result.stderr
    events: Events = []
    done = hush.denoise_sequence(small, tmp_path / "module", lam={2: 3, 4: 9.0}, window=1, progress=events.append)
    assert pixels(tmp_path / "module") == pixels(tmp_path / "command") != {}
    told = [json.loads(line) for line in result.stdout.splitlines()]
    keys = lambda found: sorted((event["event"], *sorted(event)) for event in found)
    assert keys(events) == keys(told)
    assert {"event": "done", **done} == events[-1]
    assert (done["written"], done["failed"], done["interrupted"], done["stopped"]) == (COUNT, [], False, None)


def test_a_second_run_skips_and_the_dry_run_says_so(small: Path, tmp_path: Path) -> None:
    output = tmp_path / "out"
    planned = hush.dry_run_sequence(small, output, frames=[1, 2])
    assert [(frame["frame"], frame["action"]) for frame in planned["frames"]] == [(1, "denoise"), (2, "denoise")]
    assert not output.exists()
    assert hush.denoise_sequence(small, output, frames=[1, 2])["written"] == 2
    assert [frame["action"] for frame in hush.dry_run_sequence(small, output, frames="1-2")["frames"]] == ["skip", "skip"]
    assert hush.denoise_sequence(small, output, frames=np.arange(1, 4))["skipped"] == 2
    again = hush.dry_run_sequence(small, output, frames="1-2", lam=8)["frames"]
    assert all(frame["action"] == "denoise" and "lambda" in frame["reason"] for frame in again)


def test_lambda_follows_the_frames(small: Path, tmp_path: Path) -> None:
    hush.denoise_sequence(small, tmp_path / "out", lam={1: 1.0, 3: 9.0}, window=0)
    manifest = json.loads((tmp_path / "out" / "hush-manifest.json").read_text())
    dial = [manifest["settings"][entry["settings"]]["lambda"] for entry in manifest["frames"].values()]
    assert dial == [1, 5, 9, 9]


def test_inputs_come_in_many_forms(small: Path, tmp_path: Path) -> None:
    files = sorted(small.glob("*.exr"))
    for i, inputs in enumerate(
        [str(small), small, small / "f_####.exr", str(small / "f_*.exr"), files, tuple(map(str, files)), small.glob("*.exr")]
    ):
        planned = hush.dry_run_sequence(inputs, tmp_path / f"out{i}")
        assert [Path(frame["source"]) for frame in planned["frames"]] == files


def test_view_layers_are_chosen(layered: Path, tmp_path: Path) -> None:
    before = pixels(layered)
    for layers, changed in ((("Far",), {"Far"}), (("all",), {"Near", "Far"}), (["Near", "Far"], {"Near", "Far"}), ("all", {"Near", "Far"})):
        output = tmp_path / ("text" if layers == "all" else "-".join(layers))
        hush.denoise_sequence(layered, output, layers=layers)
        for name, after in pixels(output).items():
            assert {channel.split(".")[0] for channel in after if after[channel] != before[name][channel]} == changed


def test_inspect_tells_what_the_command_tells(command_line: Hush, small: Path) -> None:
    path = small / "f_0001.exr"
    found = hush.inspect(path)
    assert found == json.loads(command_line("inspect", "--json", path).stdout)
    assert {use["purpose"] for use in found["uses"]} >= {"vector"}


@pytest.mark.parametrize(
    ("change", "error", "text"),
    [
        ({"lam": 0.5}, ValueError, "lam"),
        ({"lam": {}}, ValueError, "lam"),
        ({"lam": float("nan")}, ValueError, "lam"),
        ({"lam": "8"}, TypeError, "lam"),
        ({"lam": {"one": 2}}, TypeError, "lam"),
        ({"window": 4}, ValueError, "window"),
        ({"window": 1.5}, TypeError, "window"),
        ({"frames": "a-b"}, ValueError, "a-b"),
        ({"frames": []}, ValueError, "frames"),
        ({"frames": [99]}, ValueError, "none of the frames"),
        ({"frames": [1.5]}, TypeError, "frames"),
        ({"threads": 0}, ValueError, "threads"),
        ({"memory": -1}, ValueError, "memory"),
        ({"aovs": ["Nothing"]}, hush.HushError, "Nothing"),
        ({"layers": ["Nothing"]}, hush.HushError, "Nothing"),
        ({"model": "/nowhere.safetensors"}, FileNotFoundError, "nowhere"),
        ({"model": __file__}, hush.HushError, "test_module"),
        ({"renderer": "arnold"}, ValueError, "cycles, mitsuba"),
        ({"inputs": "/nowhere"}, FileNotFoundError, "nowhere"),
        ({"inputs": "/nowhere/f_####.exr"}, FileNotFoundError, "nowhere"),
        ({"inputs": []}, ValueError, "inputs"),
        ({"inputs": 3}, TypeError, "inputs"),
        ({"output": None}, ValueError, "output"),
        ({"albedo": True}, TypeError, "albedo"),
        ({"inputs": b"shot"}, TypeError, "inputs: expected str or os.PathLike, got bytes"),
        ({"output": b"out"}, TypeError, "output: expected str or os.PathLike, got bytes"),
        ({"model": b"weights"}, TypeError, "model: expected str or os.PathLike, got bytes"),
    ],
)
def test_bad_arguments_are_refused(small: Path, tmp_path: Path, change: dict[str, Any], error: type[Exception], text: str) -> None:
    arguments = {"inputs": small, "output": tmp_path / "out", **change}
    for call in (hush.denoise_sequence, hush.dry_run_sequence):
        with pytest.raises(error) as raised:
            call(**arguments)
        assert text in str(raised.value)
        assert type(raised.value) is error
    assert names(tmp_path / "out") == []


def test_files_are_never_put_at_risk(small: Path, tmp_path: Path) -> None:
    before = pixels(small)
    with pytest.raises(ValueError, match="where the input"):
        hush.denoise_sequence(small, small, overwrite=True)
    foreign = tmp_path / "foreign" / "f_0001.exr"
    foreign.parent.mkdir()
    foreign.write_bytes(b"mine")
    with pytest.raises(FileExistsError, match="f_0001"):
        hush.denoise_sequence(small, foreign.parent)
    assert foreign.read_bytes() == b"mine"
    blocked = tmp_path / "file"
    blocked.touch()
    with pytest.raises(NotADirectoryError, match="file"):
        hush.denoise_sequence(small, blocked / "out")
    assert pixels(small) == before
    with pytest.raises(FileNotFoundError) as raised:
        hush.inspect(tmp_path / "nothing.exr")
    assert Path(raised.value.filename).name == "nothing.exr"
    with pytest.raises(hush.HushError, match="foreign"):
        hush.inspect(foreign)


def test_a_bad_frame_does_not_raise(small: Path, tmp_path: Path) -> None:
    shot = write_shot(tmp_path / "shot", 3)
    path = shot / "f_0002.exr"
    path.write_bytes(path.read_bytes()[:-2000])
    events: Events = []
    done = hush.denoise_sequence(shot, tmp_path / "out", progress=events.append)
    assert (done["failed"], done["written"]) == ([2], 2)
    assert any(event["event"] == "error" and event["frame"] == 2 for event in events)
    with pytest.raises(hush.HushError, match="f_0002"):
        hush.inspect(path)


def test_progress_is_called_in_the_calling_thread(small: Path, tmp_path: Path) -> None:
    threads = set()
    hush.denoise_sequence(small, tmp_path / "out", frames="1", progress=lambda event: threads.add(threading.get_ident()))
    assert threads == {threading.get_ident()}
    found: list[int] = []
    run = lambda: hush.denoise_sequence(small, tmp_path / "other", frames="1", progress=lambda event: found.append(threading.get_ident()))
    thread = threading.Thread(target=run)
    thread.start()
    thread.join()
    assert set(found) == {thread.ident}


@pytest.mark.parametrize("event", ["start", "working", "frame"])
def test_what_progress_raises_stops_the_run(small: Path, tmp_path: Path, event: str) -> None:
    class Stop(Exception):
        pass

    calls = []

    def progress(told: dict[str, Any]) -> None:
        calls.append(told)
        if told["event"] == event:
            raise Stop(event)

    with pytest.raises(Stop, match=event):
        hush.denoise_sequence(small, tmp_path / "out", progress=progress)
    assert calls[-1]["event"] == event, "progress is not called again"
    written = [name for name in names(tmp_path / "out") if name.endswith(".exr")]
    assert len(written) <= {"start": 0, "working": 1, "frame": 3}[event]
    assert all(name.endswith((".exr", ".json")) for name in names(tmp_path / "out")), "nothing half-written is left"
    assert hush.denoise_sequence(small, tmp_path / "out")["written"] == COUNT - len(written)


def test_cancel_stops_after_the_frame_in_hand(small: Path, tmp_path: Path) -> None:
    seen: Events = []
    done = hush.denoise_sequence(small, tmp_path / "out", progress=seen.append, cancel=lambda: seen[-1:] and seen[-1]["event"] == "working")
    assert done["interrupted"] is True
    assert done["written"] == 1
    assert seen[-1]["event"] == "done"
    assert names(tmp_path / "out") == ["f_0001.exr", "hush-manifest.json"]
    assert hush.denoise_sequence(small, tmp_path / "out")["written"] == COUNT - 1


def test_what_cancel_raises_comes_through(small: Path, tmp_path: Path) -> None:
    with pytest.raises(ZeroDivisionError):
        hush.denoise_sequence(small, tmp_path / "out", cancel=lambda: 1 // 0)
    assert all(name.endswith((".exr", ".json")) for name in names(tmp_path / "out"))


def test_cancel_is_asked_often_and_other_threads_run(shot: Path, tmp_path: Path) -> None:
    asked: list[float] = []
    hush.denoise_sequence(shot, tmp_path / "out", frames="4", threads=1, cancel=lambda: asked.append(time.monotonic()))
    gaps = np.diff(asked)
    assert len(asked) >= 3
    # Every 50 ms; a busy machine may be late.
    assert np.median(gaps) < 0.1, gaps


@pytest.mark.skipif(os.name == "nt", reason="sends SIGINT")
def test_ctrl_c_stops_a_run_cleanly(shot: Path, tmp_path: Path) -> None:
    def progress(event: dict[str, Any]) -> None:
        if event["event"] == "working":
            signal.raise_signal(signal.SIGINT)

    with pytest.raises(KeyboardInterrupt):
        hush.denoise_sequence(shot, tmp_path / "out", progress=progress)
    assert all(name.endswith((".exr", ".json")) for name in names(tmp_path / "out"))
    assert len(names(tmp_path / "out")) <= 2


def test_memory_comes_back_after_runs(small: Path, tmp_path: Path) -> None:
    resident = lambda: int(Path("/proc/self/status").read_text().split("VmRSS:")[1].split()[0]) / 1024
    work = lambda: hush.denoise_sequence(small, tmp_path / "out", overwrite=True, progress=lambda event: None)
    for _ in range(4):
        work()
    before = resident()
    for _ in range(20):
        work()
    assert resident() - before < 12, f"{before:.0f} MiB before, {resident():.0f} MiB after"


def test_the_command_comes_with_the_wheel(command_line: Hush, small: Path, tmp_path: Path) -> None:
    for program in (command(), [sys.executable, "-m", "hush"]):
        run = lambda *arguments, program=program: subprocess.run(
            [*program, *map(str, arguments)], capture_output=True, text=True, check=False
        )
        assert run("--version").stdout == command_line("--version").stdout
        assert run("denoise", "--help").stdout == command_line("denoise", "--help").stdout
        assert run("denoise").returncode == 1
        assert run("inspect", tmp_path / "nothing.exr").returncode == 1
        assert run("inspect", tmp_path / "nothing.exr", small / "f_0001.exr").returncode == 2
        output = tmp_path / Path(program[-1]).name
        assert run("denoise", small, "--output", output, "--threads", "2").returncode == 0
        assert len(pixels(output)) == COUNT


STAGE = """#usda 1.0
def Scope "Render"
{
    def RenderPass "Pass"
    {
        float hush:lambda = 4
        int hush:window = 1
    }
}
"""


@pytest.mark.parametrize("start", ["script", "module", "call"])
def test_usd_is_read_and_nothing_of_the_working_folder_runs(small: Path, tmp_path: Path, start: str) -> None:
    """What is started to read a stage is Hush, whatever lies in the folder that one stands in."""
    shot = tmp_path / "shot"
    shot.mkdir()
    for path in small.glob("*.exr"):
        (shot / path.name).symlink_to(path)
    (shot / "hush.toml").write_text('usd = "stage.usda"\n')
    (shot / "stage.usda").write_text(STAGE)
    trap = f"open({str(tmp_path / 'trapped')!r}, 'w').close()\n"
    # `python -m` itself imports from the working folder, so its traps are those that only the reader could fall into.
    traps = (
        ["read-stage", "sitecustomize.py"] if start == "module" else ["read-stage", "sitecustomize.py", "hush.py", "numpy.py", "json.py"]
    )
    for name in traps:
        (tmp_path / name).write_text(trap)
    programs = {
        "script": command(),
        "module": [sys.executable, "-m", "hush"],
        "call": [sys.executable, "-P", "-c", "import hush, sys; sys.exit(hush.main())"],
    }
    environment = {**os.environ, "PYTHONSTARTUP": str(tmp_path / "read-stage")}
    for arguments in (["show", "--json", "shot/stage.usda"], ["show", "--json", "--usd", "shot/stage.usda"], ["show", "--json", "shot"]):
        run = subprocess.run(
            [*programs[start], "shot", *arguments], cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
        )
        assert run.returncode == 0, run.stderr
        settings = json.loads(run.stdout)["settings"]
        assert (settings["lambda"]["value"], settings["window"]["value"]) == (4.0, 1), arguments
    run = subprocess.run(
        [*programs[start], "denoise", "shot", "-o", "out", "--frames", "1"], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert run.returncode == 0 and "window 1, lambda 4" in run.stderr, run.stderr
    damaged = tmp_path / "bad.usdc"
    damaged.write_bytes(b"PXR-USDC" + b"\xff" * 200)
    run = subprocess.run([*programs[start], "shot", "show", damaged], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert run.returncode == 1 and "bad.usdc" in run.stderr and "Traceback" not in run.stderr, run.stderr
    assert not (tmp_path / "trapped").exists(), "a file of the working folder was run"


def test_a_program_that_holds_python_has_usd_read_by_its_python(tmp_path: Path) -> None:
    """As in Blender, whose sys.executable may be Blender, and whose extensions come on sys.path at run time."""
    (tmp_path / "stage.usda").write_text(STAGE)
    package = Path(hush.__file__).parents[1]
    script = f"""
import sys
sys.executable = "/opt/blender/blender"
sys.path.append({str(package)!r})
import hush
sys.exit(hush.main(["shot", "show", "--json", "stage.usda"]))
"""
    run = subprocess.run([sys.executable, "-I", "-c", script], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    assert json.loads(run.stdout)["settings"]["window"]["value"] == 1
    script = script.replace("import hush", "sys.prefix = '/nowhere'\nimport hush")
    run = subprocess.run([sys.executable, "-I", "-c", script], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert run.returncode == 1 and "no Python is in /nowhere" in run.stderr and "hush.toml" in run.stderr, run.stderr


def test_a_file_that_is_named_has_the_help_of_those_beside_it(small: Path, tmp_path: Path) -> None:
    done = hush.denoise_sequence(small / "f_0002.exr", tmp_path / "one")
    assert (done["frames"], done["written"]) == (1, 1)
    hush.denoise_sequence(small, tmp_path / "all")
    assert pixels(tmp_path / "one")["f_0002.exr"] == pixels(tmp_path / "all")["f_0002.exr"]


def test_a_missing_folder_is_told_in_words(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError) as raised:
        hush.denoise_sequence(tmp_path / "gone" / "f_####.exr", tmp_path / "out")
    assert f"there is no folder {tmp_path / 'gone'}" in str(raised.value) and "Errno" not in str(raised.value)


def test_main_returns_the_exit_code(small: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    before = signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)
    assert hush.main(["--version"]) == 0
    assert capfd.readouterr().out.startswith("hush ")
    assert hush.main([]) == 1
    with pytest.raises(TypeError, match="one by one"):
        hush.main("inspect")
    for threads in ("1", "2"):
        assert hush.main(["denoise", str(small), "-o", str(tmp_path / threads), "--threads", threads, "--quiet"]) == 0
    assert hush.main(["inspect", tmp_path / "nothing.exr"]) == 1
    assert (signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)) == before


@pytest.mark.skipif(os.name == "nt", reason="sends signals")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_the_command_stops_on_a_signal(shot: Path, tmp_path: Path, number: signal.Signals) -> None:
    program = [*command(), "denoise", str(shot), "--output", str(tmp_path / "out"), "--json", "--threads", "1"]
    with subprocess.Popen(program, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        for line in process.stdout:
            if json.loads(line)["event"] == "working":
                process.send_signal(number)
                break
        out, err = process.communicate(timeout=120)
    assert process.returncode == 130, err
    assert "Traceback" not in err
    assert "stopping after the frame in hand" in err
    done = json.loads(out.splitlines()[-1])
    assert done["event"] == "done" and done["interrupted"] is True
    assert 1 <= done["written"] < 8
    assert len(names(tmp_path / "out")) == done["written"] + 1


@pytest.mark.skipif(os.name == "nt", reason="sends signals")
def test_a_second_signal_ends_the_command_at_once(shot: Path, tmp_path: Path) -> None:
    program = [*command(), "denoise", str(shot), "--output", str(tmp_path / "out"), "--json", "--threads", "1"]
    with subprocess.Popen(program, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None and process.stderr is not None
        for line in process.stdout:
            if json.loads(line)["event"] == "working":
                process.send_signal(signal.SIGINT)
                break
        assert "once more stops at once" in process.stderr.readline()
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=120)
    assert process.returncode == 130
    assert all(name.endswith((".exr", ".json")) for name in names(tmp_path / "out"))

"""The farm templates: the OpenJD one is run with its own runner, Flamenco's is compiled as Flamenco does."""

from __future__ import annotations

import itertools
import json
import os
import re
import shutil
import subprocess
import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
import quickjs
from conftest import ROOT, Hush
from images import channels

TEMPLATE = ROOT / "farm" / "openjd" / "hush.yaml"
FLAMENCO = ROOT / "farm" / "flamenco" / "hush_denoise.js"
NAMES = [f"frame_{i:04d}.exr" for i in range(1, 9)]


def openjd(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    tool = Path(sys.executable).with_name("openjd")
    return subprocess.run([tool, *map(str, arguments)], capture_output=True, text=True, timeout=900, check=False)


def run_job(shot: Path, output: Path, frames: str, per_task: int, **more: str) -> subprocess.CompletedProcess[str]:
    binary = os.environ.get("HUSH_BIN", str(ROOT / "target" / "release" / "hush"))
    values = {"Shot": shot, "Output": output, "Frames": frames, "FramesPerTask": per_task, "Hush": binary, **more}
    parameters = [word for name, value in values.items() for word in ("--job-param", f"{name}={value}")]
    return openjd("run", TEMPLATE, *parameters)


def test_the_openjd_template_is_valid() -> None:
    result = openjd("check", TEMPLATE)
    assert result.returncode == 0, result.stdout + result.stderr


def test_chunks_have_the_bits_of_one_run(shot: Path, denoised: Path, tmp_path: Path) -> None:
    """Chunks of three frames, the last one shorter; each sees its neighbours beyond the seam."""
    result = run_job(shot, tmp_path / "out put", "1-8", 3)
    log = result.stdout + result.stderr
    assert result.returncode == 0, log
    told = re.findall(r"openjd_progress: ([\d.]+)", log)
    # A slow frame may tell of 99.96 % too, which is written 100.0.
    assert [share for share, _ in itertools.groupby(told)].count("100.0") == 3, log
    assert "openjd_status: frame 4" in log
    for name in NAMES:
        one, chunked = channels(denoised / name), channels(tmp_path / "out put" / name)
        assert one.keys() == chunked.keys()
        assert all(one[c].tobytes() == chunked[c].tobytes() for c in one), name


def test_a_failed_task_says_why(shot: Path, tmp_path: Path) -> None:
    broken = tmp_path / "broken"
    broken.mkdir()
    shutil.copy(shot / NAMES[0], broken)
    (broken / NAMES[1]).write_bytes((shot / NAMES[1]).read_bytes()[:5000])
    result = run_job(broken, tmp_path / "out", "1-2", 2)
    log = result.stdout + result.stderr
    assert result.returncode != 0, log
    assert "openjd_fail: frame 2: " in log
    assert (tmp_path / "out" / NAMES[0]).is_file()


def test_side_settings_count_unless_they_are_left_out(shot: Path, tmp_path: Path) -> None:
    own = tmp_path / "own"
    own.mkdir()
    shutil.copy(shot / NAMES[0], own)
    (own / "hush.toml").write_text("enable = false\n")
    result = run_job(own, tmp_path / "out", "1", 1)
    assert result.returncode != 0
    assert "openjd_fail: denoising is switched off" in result.stdout + result.stderr
    result = run_job(own, tmp_path / "out", "1", 1, Settings="none", ExtraArguments="--lambda 4 --window 0")
    assert result.returncode == 0, result.stdout + result.stderr
    manifest = json.loads((tmp_path / "out" / "hush-manifest.json").read_text())
    assert [s["lambda"] for s in manifest["settings"].values()] == [4.0]


# What Flamenco gives to the scripts of job types.
AUTHOR = """
const author = {
    Task(name, type) {
        return { name, type, commands: [], dependencies: [],
                 addCommand(command) { this.commands.push(command); },
                 addDependency(task) { this.dependencies.push(task.name); } };
    },
    Command(name, parameters) { return { name, parameters }; },
};
const path = {
    dirname: (p) => p.slice(0, p.lastIndexOf("/")),
    basename: (p) => p.slice(p.lastIndexOf("/") + 1),
    join: (...parts) => parts.join("/"),
};
const print = () => {};
const formatTimestampLocal = () => "2026-01-02_030405";
function frameChunker(frames, size) {
    const all = [];
    for (const part of frames.split(",")) {
        const ends = part.trim().split("-").map(Number);
        for (let f = ends[0]; f <= ends[ends.length - 1]; f++) all.push(f);
    }
    const chunks = [];
    for (let at = 0; at < all.length; at += size) {
        const runs = [];
        for (const f of all.slice(at, at + size)) {
            const last = runs[runs.length - 1];
            if (last && last[1] + 1 === f) last[1] = f; else runs.push([f, f]);
        }
        chunks.push(runs.map(([a, b]) => (a === b ? `${a}` : `${a}-${b}`)).join(","));
    }
    return chunks;
}
"""


@dataclass
class Task:
    name: str
    type: str
    commands: list[dict[str, Any]]
    dependencies: list[str] = field(default_factory=list)


def compile_job(**settings: str | int | bool) -> dict[str, Task]:
    """The tasks that the job type makes of these settings, by name."""
    context = quickjs.Context()
    context.eval(AUTHOR)
    context.eval(FLAMENCO.read_text() + "\nglobalThis.JOB = JOB_TYPE;")
    kinds = json.loads(context.eval("JSON.stringify(JOB)"))["settings"]
    assert {kind["type"] for kind in kinds} <= {"string", "int32", "bool", "float"}
    defaults = {kind["key"]: kind["default"] for kind in kinds if "default" in kind}
    given = {
        "frames": "1-12",
        "render_output_path": "/farm/shot/{timestamp}/noisy/######",
        "blendfile": "/jobs/it's a shot.blend",
        "format": "OPEN_EXR_MULTILAYER",
        "scene": "Scene",
        "render_output_root": "/farm",
    }
    settings = {**defaults, **given, **settings}
    missing = {kind["key"] for kind in kinds if kind.get("required")} - settings.keys()
    assert not missing
    context.eval(f"""
        const tasks = [];
        compileJob({{ created: 0, settings: {json.dumps(settings)}, addTask: (task) => tasks.push(task) }});
    """)
    return {task["name"]: Task(**task) for task in json.loads(context.eval("JSON.stringify(tasks)"))}


def test_flamenco_denoises_after_the_frames_that_help() -> None:
    tasks = compile_job(chunk_size=2, denoise_chunk_size=4, window=1)
    assert "--second-pass=false" in tasks["denoise-5-8"].commands[0]["parameters"]["args"]
    assert [name for name in tasks if name.startswith("render-")] == [f"render-{a}-{a + 1}" for a in range(1, 12, 2)]
    assert tasks["denoise-5-8"].dependencies == ["render-3-4", "render-5-6", "render-7-8", "render-9-10"]
    assert tasks["denoise-1-4"].dependencies == ["render-1-2", "render-3-4", "render-5-6"]
    twice = compile_job(chunk_size=2, denoise_chunk_size=4, window=1, second_pass=True)
    assert twice["denoise-9-12"].dependencies == ["render-7-8", "render-9-10", "render-11-12"]
    twice = compile_job(chunk_size=1, denoise_chunk_size=2, window=1, second_pass=True)
    assert twice["denoise-5-6"].dependencies == [f"render-{n}" for n in range(3, 9)]
    assert tasks["composite"].dependencies == ["denoise-1-4", "denoise-5-8", "denoise-9-12"]
    render = tasks["render-1-2"].commands[0]
    assert render["name"] == "blender-render"
    assert render["parameters"]["args"][-2:] == ["--render-frame", "1..2"]
    assert "OPEN_EXR_MULTILAYER" in render["parameters"]["args"]


def test_flamenco_frames_with_gaps() -> None:
    tasks = compile_job(frames="1-3, 10, 12-13", chunk_size=4, denoise_chunk_size=3, window=2, composite=False)
    assert list(tasks) == ["render-1-3,10", "render-12-13", "denoise-1-3", "denoise-10,12-13"]
    assert tasks["render-1-3,10"].commands[0]["parameters"]["args"][-1] == "1..3,10"
    assert tasks["denoise-1-3"].dependencies == ["render-1-3,10"]
    assert tasks["denoise-10,12-13"].dependencies == ["render-1-3,10", "render-12-13"]


def test_flamencos_denoise_command_runs(hush: Hush, shot: Path, denoised: Path, tmp_path: Path) -> None:
    """The frames of a task are the same, bit for bit, as in one run."""
    output = str(tmp_path / "job" / "noisy" / "frame_####")
    shutil.copytree(shot, tmp_path / "job" / "noisy")
    tasks = compile_job(frames="4-5", denoise_chunk_size=2, render_output_path=output, hush_arguments=" --keep-noisy=false  ")
    command = tasks["denoise-4-5"].commands[0]
    assert (command["name"], command["parameters"]["exe"]) == ("exec", "hush")
    result = hush(*command["parameters"]["args"])
    assert result.returncode == 0, result.stderr
    for name in NAMES[3:5]:
        one, chunked = channels(denoised / name), channels(tmp_path / "job" / "denoised" / name)
        assert all(one[c].tobytes() == chunked[c].tobytes() for c in one), name


def test_flamencos_composite_calls_the_add_on() -> None:
    (command,) = compile_job(render_output_path='/farm/it\'s "here"/noisy/####')["composite"].commands
    arguments = command["parameters"]["args"]
    assert (command["name"], command["parameters"]["exe"]) == ("exec", "{blender}")
    assert arguments[:2] == ["--background", "/jobs/it's a shot.blend"]
    script = arguments[arguments.index("--python-expr") + 1]
    assert arguments.index("--python-exit-code") < arguments.index("--python-expr")
    called: list[str] = []
    scene = type("Hush", (), {})()
    operators = type("Ops", (), {"composite_shot": staticmethod(lambda: called.append("composite"))})
    context = type("Context", (), {"scene": type("Scene", (), {"hush": scene})})
    bpy = type("bpy", (), {"context": context, "ops": type("ops", (), {"hush": operators})})
    exec(script.removeprefix("import bpy; "), {"bpy": bpy})
    assert called == ["composite"]
    assert scene.output_folder == '/farm/it\'s "here"/denoised'
    assert scene.composite_folder == '/farm/it\'s "here"/composited'


def test_flamenco_refuses_files_without_passes() -> None:
    with pytest.raises(quickjs.JSException, match="MultiLayer"):
        compile_job(format="PNG")

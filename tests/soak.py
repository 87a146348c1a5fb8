"""A long watch over a shot that comes in badly: random order, stubs, frames rendered again, and a watcher that is killed often.

At the end every output must have the bytes of a plain `hush denoise` over the finished shot.

    python tests/soak.py target/release/hush --frames 2000 --kills 20 --seconds 600 --memory soak.csv
"""

from __future__ import annotations

import argparse
import csv
import hashlib
import json
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import OpenEXR

COLUMNS, ROWS = 48, 27
# A frame that is asked for and does not come, so that frames rendered again at the end find the watch still there.
NEVER = 1_000_000


def write_frame(path: Path, seed: int) -> None:
    """A small noisy frame with all guides and motion vectors."""
    noise = np.random.default_rng(seed)
    size = (ROWS, COLUMNS)
    channels = {f"ViewLayer.Combined.{c}": noise.random(size, np.float32) for c in "RGB"}
    channels |= {f"ViewLayer.Denoising Albedo.{c}": np.full(size, 0.5, np.float32) for c in "RGB"}
    channels |= {f"ViewLayer.Denoising Normal.{c}": np.full(size, float(c == "Z"), np.float32) for c in "XYZ"}
    channels |= {"ViewLayer.Denoising Depth.Z": np.full(size, 3.0, np.float32)}
    channels |= {f"ViewLayer.Vector.{c}": noise.random(size, np.float32) - 0.5 for c in "XYZW"}
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File(header, channels).write(str(path))


@dataclass
class Settings:
    """One soak."""

    hush: Path
    frames: int
    kills: int
    seconds: float
    seed: int = 1
    watchers: int = 1


@dataclass
class Result:
    """What a soak found."""

    problems: list[str] = field(default_factory=list)
    denoised: Counter[int] = field(default_factory=Counter)
    memory: list[tuple[float, int, float, int]] = field(default_factory=list)
    stubs: int = 0
    rendered_again: int = 0
    kills: int = 0
    seconds: float = 0.0
    wait: float = 0.0


class Watcher:
    """`hush watch` as a process that can be killed and started again."""

    def __init__(self, settings: Settings, folder: Path, index: int) -> None:
        self.settings, self.folder, self.index = settings, folder, index
        self.log = folder / f"events-{index}.jsonl"
        self.log.touch()
        self.starts = 0
        self.start()

    def start(self) -> None:
        """Starts it, its events appended to the log."""
        self.starts += 1
        frames = f"1-{self.settings.frames},{NEVER}"
        arguments = ["watch", self.folder / "in", "--output", self.folder / "out", "--frames", frames, "--json"]
        with self.log.open("ab") as log:
            self.process = subprocess.Popen([self.settings.hush, *arguments], stdout=log, stderr=subprocess.PIPE)

    def kill(self) -> None:
        """Ends it as a power cut would, and starts it again."""
        self.process.kill()
        self.process.communicate()
        with self.log.open("ab") as log:
            log.write(b"\n")  # A line that was cut ends here.
        self.start()

    def stop(self) -> str:
        """Ends it as Ctrl-C would; says what went wrong."""
        self.process.send_signal(signal.SIGTERM)
        _, errors = self.process.communicate(timeout=60)
        return "" if self.process.returncode == 130 else f"exit code {self.process.returncode}: {errors.decode()}"

    def events(self) -> list[dict[str, object]]:
        """All whole events of all its lives."""
        events = []
        for line in self.log.read_text(encoding="utf-8").splitlines():
            try:
                events.append(json.loads(line))
            except json.JSONDecodeError:
                continue
        return events

    def state(self) -> dict[str, object]:
        """The last `waiting` event of this life."""
        with self.log.open("rb") as log:
            log.seek(max(0, self.log.stat().st_size - 65536))
            lines = log.read().split(b"\n")
        found = [line for line in lines if b'"event":"waiting"' in line or b'"event":"watching"' in line or b'"event":"landed"' in line]
        return json.loads(found[-1]) if found and found[-1].endswith(b"}") and b"waiting" in found[-1][:30] else {}

    def memory(self) -> float:
        """Resident memory in MB."""
        try:
            status = Path(f"/proc/{self.process.pid}/status").read_text(encoding="utf-8")
        except OSError:
            return 0.0
        kilobytes = [line.split()[1] for line in status.splitlines() if line.startswith("VmRSS")]
        return int(kilobytes[0]) / 1000 if kilobytes else 0.0


class Render:
    """Writes the frames in the ways that renderers and copy tools do."""

    def __init__(self, settings: Settings, folder: Path, result: Result) -> None:
        self.settings, self.folder, self.result = settings, folder, result
        self.dice = random.Random(settings.seed)
        self.later: list[tuple[float, Callable[[], None]]] = []
        (folder / "in").mkdir()
        (folder / "new").mkdir()

    def fresh(self, number: int, seed: int) -> bytes:
        """The bytes of a frame."""
        path = self.folder / "new" / f"{number}.exr"
        write_frame(path, seed)
        content = path.read_bytes()
        path.unlink()
        return content

    def put(self, number: int, content: bytes) -> None:
        """Writes a frame in place at once, in place slowly, or aside and renamed."""
        path = self.folder / "in" / f"f_{number:05d}.exr"
        way = self.dice.choice(["at once", "slowly", "renamed"])
        if way == "renamed":
            aside = path.with_name(f".{path.name}.tmp")
            aside.write_bytes(content)
            aside.rename(path)
        elif way == "at once":
            path.write_bytes(content)
        else:
            with path.open("wb") as file:
                for start in range(0, len(content), 1 + len(content) // 4):
                    file.write(content[start : start + 1 + len(content) // 4])
                    file.flush()
                    time.sleep(self.dice.uniform(0, 0.01))

    def run(self) -> None:
        """Renders the shot in random order; returns when every frame is there for good."""
        numbers = list(range(1, self.settings.frames + 1))
        self.dice.shuffle(numbers)
        pace = self.settings.seconds / len(numbers)
        began = time.monotonic()
        for turn, number in enumerate(numbers):
            content = self.fresh(number, number)
            if self.dice.random() < 0.05:
                self.result.stubs += 1
                stub = content[: int(len(content) * self.dice.uniform(0.01, 0.99))]
                (self.folder / "in" / f"f_{number:05d}.exr").write_bytes(stub)
                self.plan(self.dice.uniform(5, 60) * pace, lambda number=number, content=content: self.put(number, content))
            else:
                self.put(number, content)
            if self.dice.random() < 0.02:
                self.result.rendered_again += 1
                again = self.fresh(number, number + 1_000_000)
                self.plan(self.dice.uniform(60, 200) * pace, lambda number=number, again=again: self.put(number, again))
            self.do_later()
            time.sleep(max(0.0, began + (turn + 1) * pace * self.dice.uniform(0.9, 1.0) - time.monotonic()))
        while self.later:
            self.do_later()
            time.sleep(0.01)

    def plan(self, after: float, what: Callable[[], None]) -> None:
        self.later.append((time.monotonic() + after, what))

    def do_later(self) -> None:
        due = [what for at, what in self.later if at <= time.monotonic()]
        self.later = [(at, what) for at, what in self.later if at > time.monotonic()]
        for what in due:
            what()


def soak(settings: Settings, folder: Path) -> Result:
    """Runs a soak in an empty folder."""
    result = Result()
    render = Render(settings, folder, result)
    watchers = [Watcher(settings, folder, index) for index in range(settings.watchers)]
    dice = random.Random(settings.seed + 1)
    # The last stretch is left alone, so that the memory of one long life shows.
    kills = sorted(dice.uniform(0.02, 0.75) * settings.seconds for _ in range(settings.kills))
    began, began_at = time.monotonic(), time.time()
    writer = threading.Thread(target=render.run)
    writer.start()
    rendered = 0.0
    next_sample = 0.0
    while True:
        elapsed = time.monotonic() - began
        if kills and elapsed >= kills[0]:
            kills.pop(0)
            dice.choice(watchers).kill()
            result.kills += 1
        if elapsed >= next_sample:
            next_sample = elapsed + 1.0
            there = len(list((folder / "out").glob("*.exr"))) if (folder / "out").is_dir() else 0
            result.memory.extend((elapsed, w.index * 1000 + w.starts, w.memory(), there) for w in watchers)
        if not writer.is_alive():
            rendered = rendered or elapsed
            states = [w.state() for w in watchers]
            full = {"landed": settings.frames, "denoised": settings.frames, "waiting": 0, "incomplete": 0, "elsewhere": 0}
            done = all(all(state.get(key) == value for key, value in full.items()) for state in states) and not kills
            quiet = time.time() - max(w.log.stat().st_mtime for w in watchers) > 3 and elapsed - rendered > 5
            if done and quiet:
                break
            if elapsed - rendered > max(60.0, settings.seconds):
                result.problems.append(f"not done long after the render's end: {states}")
                break
        time.sleep(0.05)
    result.seconds = elapsed
    last = max((p.stat().st_mtime for p in (folder / "out").glob("*.exr")), default=began_at)
    result.wait = max(0.0, last - began_at - rendered)
    result.problems += [problem for problem in (w.stop() for w in watchers) if problem]
    for event in [event for w in watchers for event in w.events()]:
        if event["event"] == "frame" and event["status"] == "denoised":
            result.denoised[int(str(event["frame"]))] += 1
        if event["event"] in ("error", "paused"):
            result.problems.append(json.dumps(event))
    compare(settings, folder, result)
    return result


def compare(settings: Settings, folder: Path, result: Result) -> None:
    """The outputs must be those of a plain run, and nothing else may lie there."""
    batch = subprocess.run([settings.hush, "denoise", folder / "in", "-o", folder / "batch", "--quiet"], capture_output=True, check=False)
    if batch.returncode != 0:
        result.problems.append(f"plain run: {batch.stderr.decode()}")
    digest = lambda path: hashlib.sha256(path.read_bytes()).hexdigest()
    watched, plain = ({p.name: digest(p) for p in (folder / name).glob("*.exr")} for name in ("out", "batch"))
    if len(plain) != settings.frames:
        result.problems.append(f"the plain run wrote {len(plain)} of {settings.frames} frames")
    result.problems += [f"{name} differs from the plain run" for name in plain if watched.get(name) != plain[name]]
    others = [p.name for p in (folder / "out").glob("*") if p.suffix != ".exr" and p.name != "hush-manifest.json"]
    result.problems += [f"left in the output folder: {name}" for name in others]
    skipped = subprocess.run([settings.hush, "denoise", folder / "in", "-o", folder / "out", "--json"], capture_output=True, check=False)
    done = json.loads(skipped.stdout.splitlines()[-1]) if skipped.stdout else {}
    if done.get("skipped") != settings.frames:
        result.problems.append(f"a plain run over the watched outputs finds {done}")


def describe(settings: Settings, result: Result) -> str:
    """The result in words."""
    times = Counter(result.denoised.values())
    lives: dict[int, list[float]] = {}
    for _, life, memory, _ in result.memory:
        lives.setdefault(life, []).append(memory)
    last = lives[max(lives)]
    third = max(1, len(last) // 3)
    thirds = " ".join(f"{np.mean(part):.0f}" for part in (last[:third], last[third:-third] or last, last[-third:]))
    return "\n".join(
        [
            f"{settings.frames} frames of {COLUMNS}×{ROWS}, {result.stubs} cut short at first, {result.rendered_again} rendered again, "
            f"{settings.watchers} watcher(s) killed {result.kills} times",
            f"{result.seconds:.0f} s, done {result.wait:.1f} s after the last write",
            f"frames written {sum(times.elements())} times: " + ", ".join(f"{n} × {count}" for n, count in sorted(times.items())),
            f"memory: most {max(m for _, _, m, _ in result.memory):.0f} MB; last life {len(last)} s, mean of its thirds {thirds} MB",
            f"problems: {len(result.problems)}",
            *result.problems[:20],
        ]
    )


def main() -> int:
    """Runs one soak from the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("hush", type=Path, help="the binary")
    parser.add_argument("--frames", type=int, default=2000)
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--seconds", type=float, default=600.0, help="how long the render takes")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--watchers", type=int, default=1)
    parser.add_argument("--memory", type=Path, help="a CSV for the memory over time")
    options = parser.parse_args()
    settings = Settings(options.hush.resolve(), options.frames, options.kills, options.seconds, options.seed, options.watchers)
    folder = Path(tempfile.mkdtemp(prefix="hush-soak-"))
    result = soak(settings, folder)
    if options.memory:
        with options.memory.open("w", newline="", encoding="utf-8") as file:
            rows = csv.writer(file)
            rows.writerow(["seconds", "life", "resident_mb", "outputs"])
            rows.writerows([f"{at:.1f}", life, f"{memory:.1f}", there] for at, life, memory, there in result.memory)
    print(describe(settings, result))
    if result.problems:
        print(f"the folder is kept: {folder}")
        return 1
    shutil.rmtree(folder)
    return 0


if __name__ == "__main__":
    sys.exit(main())

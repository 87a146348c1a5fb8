# SPDX-FileCopyrightText: 2026 Hush authors
# SPDX-License-Identifier: Apache-2.0
"""A shot that is being denoised: the worker process, what it has said so far, and how to stop it. Does not touch Blender's data."""

import json
import queue
import subprocess
import sys
import threading
import time
from collections import deque
from pathlib import Path
from typing import Any

_WORKER = Path(__file__).with_name("worker.py")
# How long a stopped worker may go on with the frame in hand when Blender ends.
_PATIENCE = 10.0
_current: "Job | None" = None


class JobError(Exception):
    """Why a job cannot be started."""


class Job:
    """One run of the worker. Call `poll` now and then until `ended`."""

    def __init__(self, scene_name: str, runs: list[dict[str, Any]]) -> None:
        self.scene_name = scene_name
        self.fraction = 0.0
        self.text = "Starting"
        self.warnings: list[str] = []
        self._bad: dict[tuple[int, int | None], str] = {}
        self.results: list[dict[str, Any]] = []
        self.ended = False
        self.cancelled = False
        self.began = time.monotonic()
        self._runs = max(1, len(runs))
        self._lines: queue.SimpleQueue[str | None] = queue.SimpleQueue()
        self._last_words: deque[str] = deque(maxlen=20)
        self._said_the_end = False
        self._process = self._start(runs)

    @property
    def errors(self) -> list[str]:
        """What went wrong, first what concerns the whole run."""
        whole = [text for (_, frame), text in self._bad.items() if frame is None]
        frames = [text for (_, frame), text in self._bad.items() if frame is not None]
        return [*whole, *(text for text in frames if not any(text in other for other in whole))]

    @property
    def seconds(self) -> float:
        """Since the start."""
        return time.monotonic() - self.began

    def poll(self) -> list[dict[str, Any]]:
        """The events since the last call; `fraction`, `text` and the rest are up to date after it."""
        events = []
        while not self.ended:
            try:
                line = self._lines.get_nowait()
            except queue.Empty:
                break
            if line is None:
                self._end()
                break
            try:
                event = json.loads(line)
            except ValueError:
                self._last_words.append(line)
                continue
            self._take(event)
            events.append(event)
        return events

    def cancel(self) -> None:
        """Stops after the frame in hand, so that no file is left half-written."""
        if not self.cancelled and not self.ended:
            self.cancelled = True
            self.text = "Stopping after this frame"
            self._say("cancel\n")

    def close(self) -> None:
        """Sees to it that the worker ends: at once if it does not do so by itself in a few seconds."""
        self.cancel()
        try:
            self._process.wait(_PATIENCE)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self.ended = True

    def _start(self, runs: list[dict[str, Any]]) -> subprocess.Popen[str]:
        try:
            process = subprocess.Popen(
                # Isolated: neither the add-on's folder nor the user's environment may stand in for Python's own modules.
                [_python(), "-I", str(_WORKER)],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                text=True,
                encoding="utf-8",
                errors="replace",
                creationflags=getattr(subprocess, "CREATE_NO_WINDOW", 0),
            )
        except OSError as error:
            raise JobError(f"The process that denoises cannot be started: {error}") from error
        self._process = process
        for target in (self._read_events, self._read_errors):
            threading.Thread(target=target, daemon=True).start()
        self._say(json.dumps({"path": _import_path(), "runs": runs}) + "\n")
        return process

    def _say(self, text: str) -> None:
        try:
            self._process.stdin.write(text)
            self._process.stdin.flush()
        except (OSError, ValueError):
            # It is gone; the end of its output tells.
            pass

    def _read_events(self) -> None:
        for line in self._process.stdout:
            self._lines.put(line)
        self._lines.put(None)

    def _read_errors(self) -> None:
        for line in self._process.stderr:
            self._last_words.append(line.rstrip())

    def _take(self, event: dict[str, Any]) -> None:
        kind, run = event.get("event"), event.get("run", 0)
        if kind == "start":
            self.text = f"Denoising {event.get('todo', 0)} frames"
        elif kind == "working":
            if not self.cancelled:
                self.text = self._progress_text(f"Denoising frame {event['frame']}")
        elif kind == "frame":
            done, frames = event.get("finished", 0), max(1, event.get("frames") or 1)
            self.fraction = min(1.0, (run + done / frames) / self._runs)
            if event.get("status") == "failed":
                self._bad.setdefault((run, event["frame"]), f"Frame {event['frame']}: {event.get('reason') or 'failed'}")
        elif kind == "warning":
            self.warnings.append(event.get("message", ""))
        elif kind == "error":
            self._bad[run, event.get("frame")] = event.get("message", "")
        elif kind == "refused":
            self._said_the_end = True
            self._bad[run, None] = event.get("message", "")
        elif kind == "finished":
            self._said_the_end = True
            self.results = event.get("results", [])

    def _progress_text(self, now: str) -> str:
        if self.fraction < 0.02 or self.seconds < 2.0:
            return now
        return f"{now}, {clock(self.seconds / self.fraction * (1 - self.fraction))} left"

    def _end(self) -> None:
        code = self._process.wait()
        self._process.stdin.close()
        self.ended = True
        if self._said_the_end:
            self.fraction = 1.0 if not self.errors and not self.cancelled else self.fraction
            return
        words = next((line for line in reversed(self._last_words) if line.strip()), "")
        if code < 0 or code in (137, 0xC0000017):
            why = "it was killed" + (", most likely as memory ran out" if code == -9 else f" by signal {-code}")
        else:
            why = f"exit code {code}" + (f": {words}" if words else "")
        self._bad[0, None] = f"The process that denoises ended before its time: {why}. Frames that were finished are kept"


def current() -> Job | None:
    """The job that is running, None where none is."""
    return _current if _current is not None and not _current.ended else None


def start(scene_name: str, runs: list[dict[str, Any]]) -> Job:
    """Starts the one job.

    Raises:
        JobError: There is one already, or the process cannot be started.
    """
    global _current
    running = current()
    if running is not None:
        raise JobError(f"Scene {running.scene_name} is being denoised; wait for it, or stop it with Esc")
    _current = Job(scene_name, runs)
    return _current


def close() -> None:
    """Stops the job that is running, if there is one."""
    running = current()
    if running is not None:
        running.close()


def clock(seconds: float) -> str:
    """Seconds as 2:10 or 1:02:10."""
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02}:{rest:02}" if hours else f"{minutes}:{rest:02}"


def _python() -> str:
    """The Python that runs Blender's scripts."""
    if Path(sys.executable).stem.lower().startswith("python"):
        return sys.executable
    for folder in (Path(sys.prefix, "bin"), Path(sys.prefix)):
        for name in (f"python{sys.version_info.major}.{sys.version_info.minor}", "python3", "python", "python.exe"):
            if (folder / name).is_file():
                return str(folder / name)
    raise JobError(f"Blender's Python is not where it should be, in {sys.prefix}")


def _import_path() -> list[str]:
    """Where the worker finds the Hush library and numpy."""
    try:
        import hush
        import numpy
    except ImportError as error:
        raise JobError(f"The Hush library does not load in this Blender: {error}") from error
    return list(dict.fromkeys(str(Path(module.__file__).parents[1]) for module in (hush, numpy)))

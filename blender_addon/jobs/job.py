# SPDX-FileCopyrightText: 2026 Hush authors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Work that another process does: what it has said so far, and how to stop it. Does not touch Blender's data.

`worker.py` says how the two talk: work and stop on its standard input, events on its standard output.
"""

import importlib
import json
import queue
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .. import messages
from ..messages import Refusal

if TYPE_CHECKING:
    import bpy

WORKER = Path(__file__).with_name("worker.py")
# How long a stopped worker may go on with the frame in hand when Blender ends.
_PATIENCE = 10.0
# Exit codes of a process that got none: SIGKILL, the same from a shell, Windows' STATUS_NO_MEMORY.
_NO_MEMORY = (-9, 137, 0xC0000017)
_current: "Job | None" = None


class Job:
    """One process. Call `poll` now and then until `ended`; a kind of work says what its events mean in `_take`."""

    # What is being done to the shot, and what the process does, for messages.
    doing, does = "worked on", "works"

    def __init__(self, scene: "bpy.types.Scene", command: list[str], work: dict[str, Any]) -> None:
        self.scene_name = scene.name
        self._scene_uid = scene.session_uid
        self.fraction = 0.0
        self.text = messages.text("job_starting")
        self.warnings: list[str] = []
        self.results: Any = []
        self.ended = False
        self.cancelled = False
        self.began = time.monotonic()
        self._bad: dict[tuple[int, int | None], str] = {}
        self._lines: queue.SimpleQueue[str | None] = queue.SimpleQueue()
        self._last_words: deque[str] = deque(maxlen=20)
        self._said_the_end, self._closed, self._ends = False, False, 0.0
        self._process = self._start(command)
        self._say(json.dumps(work) + "\n")

    def is_of(self, scene: "bpy.types.Scene") -> bool:
        """Whether the work is on a scene, whatever its name is by now."""
        return scene.session_uid == self._scene_uid

    @property
    def errors(self) -> list[str]:
        """What went wrong, first what concerns the whole work."""
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
        while not (self.ended or self._closed):
            try:
                line = self._lines.get_nowait()
            except queue.Empty:
                break
            if line is None:
                self._closed = True
                break
            try:
                event = json.loads(line)
            except ValueError:
                event = None
            if not isinstance(event, dict):
                # Blender itself talks on the same line.
                self._last_words.append(line.rstrip())
                continue
            self._take(event)
            events.append(event)
        # Its output may be closed some time before it is gone; Blender must not stand still for so long.
        if self._closed and not self.ended and self._process.poll() is not None:
            self._end()
        elif not self.ended:
            self._end_the_end()
        return events

    def cancel(self) -> None:
        """Stops after the frame in hand, so that no file is left half-written."""
        if not self.cancelled and not self.ended:
            self.cancelled = True
            self.text = messages.text("job_stopping")
            self._say("cancel\n")

    def close(self) -> None:
        """Sees to it that the process ends: at once if it does not do so by itself in a few seconds."""
        self.cancel()
        try:
            self._process.wait(_PATIENCE)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        if not self.ended:
            self.ended = True
            self._clean_up()

    def line(self, event: dict[str, Any]) -> str | None:
        """What a log should have of an event; None for nothing."""
        return None

    def _start(self, command: list[str]) -> subprocess.Popen[str]:
        try:
            process = subprocess.Popen(
                command,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                text=True,
                encoding="utf-8",
                errors="replace",
                creationflags=getattr(subprocess, "CREATE_NO_WINDOW", 0),
            )
        except OSError as error:
            self._clean_up()
            raise Refusal(messages.text("job_no_start", does=self.does, reason=error.strerror or error)) from error
        self._process = process
        for target in (self._read_events, self._read_errors):
            threading.Thread(target=target, daemon=True).start()
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
        """Learns from an event; here what all kinds of work have in common."""
        kind, run = event.get("event"), event.get("run", 0)
        if kind == "warning":
            self.warnings.append(event.get("message", ""))
        elif kind == "error":
            self._bad[run, event.get("frame")] = event.get("message", "")
        elif kind == "refused":
            self._said_the_end = True
            self._bad[run, None] = event.get("message", "")
        elif kind == "finished":
            self._said_the_end = True
            self.results = event.get("results", [])

    def _end(self) -> None:
        code = self._process.wait()
        self._say_goodbye()
        self.ended = True
        self._clean_up()
        if self._said_the_end:
            self.fraction = 1.0 if not self.errors and not self.cancelled else self.fraction
            return
        words = next((line for line in reversed(self._last_words) if line.strip()), "")
        if code in _NO_MEMORY:
            why = messages.text("job_no_memory")
        elif code < 0:
            why = messages.text("job_killed", signal=-code)
        else:
            why = messages.text("job_exit_words", code=code, words=words) if words else messages.text("job_exit", code=code)
        self._bad[0, None] = messages.text("job_ended", does=self.does, reason=why)

    def _end_the_end(self) -> None:
        """A Blender that has sent its results may still hang on its way out."""
        if self._said_the_end or self._closed:
            self._ends = self._ends or time.monotonic()
            if time.monotonic() - self._ends > _PATIENCE:
                self._process.kill()

    def _say_goodbye(self) -> None:
        try:
            self._process.stdin.close()
        except OSError:
            # What it did not read any more.
            pass

    def _clean_up(self) -> None:
        """Takes away what was there for the process only; called once, however it ended."""


def current() -> Job | None:
    """The job that is running, None where none is."""
    return _current if _current is not None and not _current.ended else None


def refuse_second() -> None:
    """One job at a time.

    Raises:
        Refusal: There is one already.
    """
    running = current()
    if running is not None:
        raise Refusal(messages.text("job_running", scene=running.scene_name, doing=running.doing))


def start(new: Callable[[], Job]) -> Job:
    """Starts the one job; `new` makes it.

    Raises:
        Refusal: There is one already, or the process cannot be started.
    """
    global _current
    refuse_second()
    _current = new()
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


def left(seconds: float) -> str:
    """What is left of the time, as about 12 minutes left."""
    minutes = round(seconds / 60)
    if minutes < 1:
        return "less than a minute left"
    hours, rest = divmod(minutes, 60)
    parts = [f"{count} {name}{'' if count == 1 else 's'}" for count, name in ((hours, "hour"), (rest, "minute")) if count]
    return f"about {' '.join(parts)} left"


def command() -> list[str]:
    """Starts the worker in the Python that runs Blender's scripts; neither the add-on's folder nor the user's environment may stand in
    for Python's own modules.

    Raises:
        Refusal: Python is not where it should be.
    """
    return [_python(), "-I", str(WORKER)]


def _python() -> str:
    """The Python that runs Blender's scripts.

    Raises:
        Refusal: Python is not where it should be.
    """
    if Path(sys.executable).stem.lower().startswith("python"):
        return sys.executable
    for folder in (Path(sys.prefix, "bin"), Path(sys.prefix)):
        for name in (f"python{sys.version_info.major}.{sys.version_info.minor}", "python3", "python", "python.exe"):
            if (folder / name).is_file():
                return str(folder / name)
    raise Refusal(messages.text("job_no_python", folder=sys.prefix))


def import_path() -> list[str]:
    """Where a process finds the Hush library and numpy.

    Raises:
        Refusal: The library does not load.
    """
    names = ("hush", "numpy")
    try:
        for name in names:
            importlib.import_module(name)
    except ImportError as error:
        raise Refusal(messages.text("library", reason=error)) from error
    return [entry for entry in sys.path if entry and any(Path(entry, name, "__init__.py").is_file() for name in names)]

# SPDX-FileCopyrightText: 2026 Hush authors
# SPDX-License-Identifier: Apache-2.0
"""One frame that is being denoised for the preview: the process, and what it has said so far. Does not touch Blender's data."""

import json
import queue
import shutil
import subprocess
import tempfile
import threading
from collections import deque
from pathlib import Path
from typing import Any

from . import job

# What the names of the temporary folders begin with.
FOLDER = "hush-preview-"
_WORKER = Path(__file__).with_name("preview_worker.py")
# A worker that is told to stop ends after the step in hand, or is ended.
_PATIENCE = 2.0


class PreviewJob:
    """One run of the worker. Call `poll` now and then until `ended`; then there is a `result` or an `error`, or it was cancelled.

    Raises:
        job.JobError: The process cannot be started.
    """

    def __init__(self, file: Path, border: list[float] | None, arguments: dict[str, Any]) -> None:
        self.fraction = 0.0
        self.result: dict[str, Any] | None = None
        self.error = ""
        self.ended = False
        self.cancelled = False
        self._lines: queue.SimpleQueue[str | None] = queue.SimpleQueue()
        self._last_words: deque[str] = deque(maxlen=20)
        python, path = job._python(), job._import_path()
        self.folder = Path(tempfile.mkdtemp(prefix=FOLDER))
        try:
            self._process = subprocess.Popen(
                [python, "-I", str(_WORKER)],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                encoding="utf-8",
                errors="replace",
                creationflags=getattr(subprocess, "CREATE_NO_WINDOW", 0),
            )
        except OSError as error:
            shutil.rmtree(self.folder, ignore_errors=True)
            raise job.JobError(f"The process that denoises cannot be started: {error}") from error
        for read in (self._read_events, self._read_errors):
            threading.Thread(target=read, daemon=True).start()
        told = {"path": path, "folder": str(self.folder), "file": str(file), "border": border, "arguments": arguments}
        self._say(json.dumps(told) + "\n")

    def poll(self) -> None:
        """Takes what the worker has said."""
        while not self.ended:
            try:
                line = self._lines.get_nowait()
            except queue.Empty:
                return
            if line is None:
                self._end()
                return
            try:
                self._take(json.loads(line))
            except ValueError:
                self._last_words.append(line.rstrip())

    def cancel(self) -> None:
        """Stops it at once: it has nothing that must be finished."""
        self.cancelled = True
        self._process.kill()

    def close(self) -> None:
        """Stops it and waits for that; its images are gone."""
        if not self.ended:
            self.cancel()
            self._end()
        self.discard()

    def discard(self) -> None:
        """Removes the images."""
        shutil.rmtree(self.folder, ignore_errors=True)

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
        kind = event.get("event")
        if kind == "progress":
            self.fraction = event.get("fraction", self.fraction)
        elif kind == "finished":
            self.result = event
        elif kind == "refused":
            self.error = event.get("message", "")

    def _end(self) -> None:
        try:
            code = self._process.wait(_PATIENCE)
        except subprocess.TimeoutExpired:
            self._process.kill()
            code = self._process.wait()
        try:
            self._process.stdin.close()
        except OSError:
            pass
        self.ended = True
        if self.result is None and not self.error and not self.cancelled:
            words = next((line for line in reversed(self._last_words) if line.strip()), f"exit code {code}")
            self.error = f"The process that denoises ended before its time: {words}"

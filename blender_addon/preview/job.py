# SPDX-FileCopyrightText: 2026 Hush authors
# SPDX-License-Identifier: GPL-3.0-or-later
"""One frame that is being denoised for the preview: the process, and what it made. Does not touch Blender's data."""

import shutil
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .. import messages
from ..jobs import job

if TYPE_CHECKING:
    import bpy

# What the names of the temporary folders begin with.
FOLDER = "hush-preview-"


class PreviewJob(job.Job):
    """One run of the worker. Once it has `ended` there is a `result`, with images in `folder`, or an `error`, or it was cancelled.

    Raises:
        Refusal: The process cannot be started.
    """

    doing, does = "previewed", "denoises"

    def __init__(self, scene: "bpy.types.Scene", file: Path, border: list[float] | None, arguments: dict[str, Any]) -> None:
        command, path = job.command(), job.import_path()
        self.result: dict[str, Any] | None = None
        self.folder = Path(tempfile.mkdtemp(prefix=FOLDER))
        work = {"module": "preview.run", "path": path, "folder": str(self.folder), "file": str(file), "border": border}
        super().__init__(scene, command, {**work, "arguments": arguments})
        self.text = messages.text("preview_running")

    @property
    def error(self) -> str:
        """Why there is no result; empty where it was cancelled."""
        return messages.of_error(self.errors[0]) if self.errors and not self.cancelled else ""

    def cancel(self) -> None:
        """Stops it at once: it has nothing that must be finished."""
        self.cancelled = True
        self._process.kill()

    def close(self) -> None:
        """Stops it and waits for that; its images are gone."""
        super().close()
        self.discard()

    def discard(self) -> None:
        """Removes the images."""
        shutil.rmtree(self.folder, ignore_errors=True)

    def _take(self, event: dict[str, Any]) -> None:
        super()._take(event)
        if event.get("event") == "progress":
            self.fraction = event["fraction"]
        elif event.get("event") == "finished":
            self.result = event

    def _clean_up(self) -> None:
        if self.result is None:
            self.discard()

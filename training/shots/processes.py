"""Several processes at once, each with jobs of its own; one that dies costs its job only."""

from __future__ import annotations

import multiprocessing
import sys
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from multiprocessing.context import SpawnProcess


@dataclass
class Running:
    """A process, the pipe to it and the job that it has."""

    process: SpawnProcess
    pipe: Connection
    job: str


def _serve(work: Callable[[str], str], pipe: Connection) -> None:
    """A process's life: a job, its line, the next job; None is the end."""
    while (job := pipe.recv()) is not None:
        pipe.send(work(job))


def _started(work: Callable[[str], str], job: str) -> Running:
    context = multiprocessing.get_context("spawn")
    pipe, theirs = context.Pipe()
    process = context.Process(target=_serve, args=(work, theirs))
    process.start()
    theirs.close()
    pipe.send(job)
    return Running(process, pipe, job)


def _handed(running: Running, job: str) -> bool:
    """Gives a process its next job, or its end; False where there is nothing left for it to do."""
    running.job = job
    try:
        running.pipe.send(job or None)
    except OSError:
        return bool(job)  # it is dead: the next look at its pipe says so
    if not job:
        running.process.join()
    return bool(job)


def run_all(work: Callable[[str], str], jobs: Sequence[str], count: int) -> list[str]:
    """Does all jobs with `count` processes and prints each one's line, if it has one; returns the jobs that were lost.

    `work` is a function of a module (or a partial of one), the same for all; what it keeps in its module stays there for the process's
    next job. A process that dies is named with its job, and another takes its place for the jobs that are left.
    """
    waiting = deque(jobs)
    lost: list[str] = []
    running: list[Running] = []
    while waiting or running:
        while waiting and len(running) < count:
            running.append(_started(work, waiting.popleft()))
        ready = wait([each.pipe for each in running])
        for each in [each for each in running if each.pipe in ready]:
            try:
                line = each.pipe.recv()
            except (EOFError, OSError):
                each.process.join()
                print(f"process {each.process.pid} died at {each.job} (exit code {each.process.exitcode})", file=sys.stderr, flush=True)
                lost.append(each.job)
                running.remove(each)
                continue
            if line:
                print(line, flush=True)
            if not _handed(each, waiting.popleft() if waiting else ""):
                running.remove(each)
    return lost

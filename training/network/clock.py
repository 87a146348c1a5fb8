"""The time of a training run, and how far its schedule is."""

from __future__ import annotations

import math
import time

LOWEST = 0.005
WARM_UP = 200  # steps


class Clock:
    """Wall-clock time of a run of so many seconds, of all its processes together.

    What is no training, such as reading shots, compiling and the search for the fastest convolutions, takes from the time that is left
    and not from the schedule: that goes on where it was and ends when the time does.
    """

    def __init__(self, seconds: float, spent: float = 0.0, done: float = 0.0) -> None:
        """spent: seconds of the processes before; done: how far the schedule was then, 0…1."""
        self.seconds = seconds
        self.begun = time.monotonic() - spent
        self.reserve = 0.0  # seconds that are kept for what comes after training
        self.resumed = done
        self.started: float | None = None

    @property
    def spent(self) -> float:
        return time.monotonic() - self.begun

    def start(self) -> None:
        """Training begins now, in this process."""
        self.started = self.spent

    @property
    def done(self) -> float:
        """How far the schedule is, 0…1."""
        if self.started is None:
            return self.resumed
        left = self.seconds - self.reserve - self.started
        share = (self.spent - self.started) / left if left > 0 else 1.0
        return min(1.0, self.resumed + (1.0 - self.resumed) * share)


def rate_share(step: int, done: float) -> float:
    """The share of the rate at a step: warm-up, then a cosine over the schedule."""
    return min(1.0, (step + 1) / WARM_UP) * max(LOWEST, 0.5 * (1 + math.cos(math.pi * done)))

"""The command line."""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from . import _hush

INTERRUPTED = 130


def main(argv: Sequence[str | os.PathLike[str]] | None = None) -> int:
    """Runs the command line, as the program `hush` does.

    Args:
        argv: The arguments without the program's name; None for those of the process.

    Returns:
        The exit code: 0 all done, 1 nothing done, 2 partly done, 3 switched off by the shot's settings, 130 stopped by Ctrl-C or
        SIGTERM. The first of them lets the frame in hand be finished, the second ends the process at once.
    """
    if isinstance(argv, (str, bytes)):
        # Its letters would be the arguments.
        raise TypeError(f"argv: expected the arguments one by one, such as ['inspect', 'frame.exr'], got {argv!r}")
    arguments = sys.argv[1:] if argv is None else [os.fspath(argument) for argument in argv]
    for stream in (sys.stdout, sys.stderr):
        if stream is not None:
            stream.flush()
    try:
        with _signals_interrupt():
            return _hush.main(["hush", *arguments])
    except KeyboardInterrupt:
        return INTERRUPTED


@contextmanager
def _signals_interrupt() -> Iterator[None]:
    """Has the signals that ask a process to end raise KeyboardInterrupt; only the main thread can."""
    before = {}
    if threading.current_thread() is threading.main_thread():
        for name in ("SIGINT", "SIGTERM", "SIGHUP"):
            number = getattr(signal, name, None)
            if number is not None and signal.getsignal(number) == signal.SIG_DFL:
                before[number] = signal.signal(number, signal.default_int_handler)
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)

"""Signals that end the run: each as Ctrl-C does, so that everything is put away, and within a second."""

from __future__ import annotations

import _thread
import os
import signal
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from types import FrameType

from dfcgs_codec.files import put_away_all

_ENDING = ("SIGINT", "SIGTERM", "SIGHUP", "SIGQUIT")
#: for whatever the main thread is in the middle of; then the process leaves without it
_SECONDS_TO_UNWIND = 0.5
_EXIT_FAILED = 1


class Ended(KeyboardInterrupt):
    """A signal other than Ctrl-C asks the run to end."""


#: the numbers of runs that are under way, so that nothing leaves that has already ended
_runs: set[int] = set()


def _line(name: str | None) -> str:
    return f"interrupted{f' ({name})' if name else ''}; nothing was written"


def message(error: BaseException) -> str:
    """The one line about what ended the run."""
    cause: BaseException | None = error
    while cause is not None and not isinstance(cause, Ended):
        cause = cause.__cause__ or cause.__context__
    return _line(None if cause is None else str(cause))


def _is_ending() -> bool:
    """Whether an earlier signal is being dealt with: what it puts away must not be cut short."""
    error = sys.exception()
    while error is not None:
        if isinstance(error, KeyboardInterrupt):
            return True
        error = error.__context__
    return False


def _leave(run: int, name: str | None) -> None:
    """Leave without the main thread, if it is still busy; workers go when this process does."""
    time.sleep(_SECONDS_TO_UNWIND)
    if run in _runs:
        put_away_all()
        with suppress(OSError):
            os.write(2, f"\ndfcgs: {_line(name)}\n".encode())
        os._exit(_EXIT_FAILED)


def _handler(run: int, number: int) -> None:
    if _is_ending():
        return
    name = None if number == signal.SIGINT else signal.Signals(number).name
    with suppress(RuntimeError):
        # what `threading` does to start one takes locks that the main thread may be holding
        _thread.start_new_thread(_leave, (run, name))
    raise KeyboardInterrupt if name is None else Ended(name)


@contextmanager
def ended_by_signals() -> Iterator[None]:
    """Inside, signals raise in the main thread; those that are ignored, as with nohup, stay so."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    run = time.monotonic_ns()

    def end(number: int, frame: FrameType | None) -> None:
        _handler(run, number)

    before = {}
    for number in (getattr(signal, name) for name in _ENDING if hasattr(signal, name)):
        if signal.getsignal(number) not in (signal.SIG_IGN, None):
            before[number] = signal.signal(number, end)
    _runs.add(run)
    try:
        yield
    finally:
        _runs.discard(run)
        for number, handler in before.items():
            signal.signal(number, handler)

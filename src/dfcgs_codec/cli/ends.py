"""Signals that end the run: each as Ctrl-C does, so that everything is put away."""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

_ENDING = ("SIGINT", "SIGTERM", "SIGHUP", "SIGQUIT")


class Ended(KeyboardInterrupt):
    """A signal other than Ctrl-C asks the run to end."""


def _is_ending() -> bool:
    """Whether an earlier signal is being dealt with: what it puts away must not be cut short."""
    error = sys.exception()
    while error is not None:
        if isinstance(error, KeyboardInterrupt):
            return True
        error = error.__context__
    return False


def _end(number: int, frame: FrameType | None) -> None:
    if _is_ending():
        return
    if number == signal.SIGINT:
        raise KeyboardInterrupt
    raise Ended(signal.Signals(number).name)


@contextmanager
def ended_by_signals() -> Iterator[None]:
    """Inside, signals raise in the main thread; those that are ignored, as with nohup, stay so."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {}
    for number in (getattr(signal, name) for name in _ENDING if hasattr(signal, name)):
        if signal.getsignal(number) not in (signal.SIG_IGN, None):
            before[number] = signal.signal(number, _end)
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def message(error: BaseException) -> str:
    """The one line about what ended the run."""
    cause: BaseException | None = error
    while cause is not None and not isinstance(cause, Ended):
        cause = cause.__cause__ or cause.__context__
    return f"interrupted ({cause}); nothing was written" if cause else "interrupted; nothing was written"

"""Moments that an interrupt must not cut in two."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

_NAMES = ("SIGINT", "SIGTERM", "SIGHUP", "SIGQUIT")


@contextmanager
def uninterrupted() -> Iterator[list[int]]:
    """Signals that arrive inside come too late: they are only listed. Of effect in the main thread.

    A signal that kills the process at once, as it does where nothing handles it, still does.
    """
    late: list[int] = []
    if threading.current_thread() is not threading.main_thread():
        yield late
        return

    def note(number: int, frame: FrameType | None) -> None:
        late.append(number)

    before = {}
    for number in (getattr(signal, name) for name in _NAMES if hasattr(signal, name)):
        handler = signal.getsignal(number)
        # only what would raise in this thread
        if callable(handler):
            before[number] = handler
    try:
        for number in before:
            signal.signal(number, note)
        yield late
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)

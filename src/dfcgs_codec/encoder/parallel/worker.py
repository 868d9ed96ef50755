"""A worker process: codes segments until its encoder says enough, or is gone."""

from __future__ import annotations

import os
import pickle
import queue
import signal
import threading
import time
import traceback
from contextlib import suppress
from typing import Any, BinaryIO

from dfcgs_codec.encoder.frame.segment import SegmentEncoder
from dfcgs_codec.encoder.parallel.process import receive, send
from dfcgs_codec.errors import DfcgsError

#: those of a terminal reach all its processes: they are the encoder's to handle, it ends its workers
_IGNORED = ("SIGINT", "SIGHUP", "SIGQUIT")
_SECONDS_BETWEEN_LOOKS = 0.5
_STDIN, _STDOUT, _STDERR = 0, 1, 2


def _own_pipes() -> tuple[BinaryIO, BinaryIO]:
    """The pipes to and from the encoder, out of reach of anything that prints or reads."""
    nothing = os.open(os.devnull, os.O_RDWR)
    if nothing == _STDERR:
        # it was closed, and must not become one of the pipes
        nothing = os.dup(nothing)
    source, sink = os.fdopen(os.dup(_STDIN), "rb"), os.fdopen(os.dup(_STDOUT), "wb")
    os.dup2(nothing, _STDIN)
    os.dup2(_STDERR, _STDOUT)
    os.close(nothing)
    return source, sink


def _listen(source: BinaryIO, messages: queue.SimpleQueue[Any]) -> None:
    """Pass messages on; where the encoder is gone, so is this process, whatever it is doing."""
    try:
        while True:
            message = receive(source)
            messages.put(message)
            if message is None:
                return
    except EOFError:
        os._exit(1)


def _watch(parent: int) -> None:
    """Should others hold the pipe open: a process whose parent is gone gets another one."""
    while os.getppid() == parent:
        time.sleep(_SECONDS_BETWEEN_LOOKS)
    os._exit(1)


def _coded(encoder: SegmentEncoder, segment: tuple[int, int]) -> Any:
    try:
        return encoder.encode(*segment)
    except BaseException as error:
        if not isinstance(error, DfcgsError):
            error.add_note(f"in a worker process:\n{traceback.format_exc()}")
        try:
            pickle.loads(pickle.dumps(error))
        except Exception:
            return RuntimeError(f"{type(error).__name__}: {error}")
        return error


def main(parent: int) -> None:
    """Serve the process `parent`."""
    for name in _IGNORED:
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_IGN)
    source, sink = _own_pipes()
    messages: queue.SimpleQueue[Any] = queue.SimpleQueue()
    threading.Thread(target=_listen, args=(source, messages), daemon=True).start()
    if os.name != "nt":
        threading.Thread(target=_watch, args=(parent,), daemon=True).start()
    with suppress(OSError):
        _serve(sink, messages)
    # at once, whatever the other threads are doing
    os._exit(0)


def _serve(sink: BinaryIO, messages: queue.SimpleQueue[Any]) -> None:
    try:
        source, plan = pickle.loads(messages.get())
    except Exception as error:
        send(sink, f"{type(error).__name__}: {error}")
        return
    encoder = SegmentEncoder(source, plan)
    send(sink, None)
    while (segment := messages.get()) is not None:
        send(sink, _coded(encoder, segment))

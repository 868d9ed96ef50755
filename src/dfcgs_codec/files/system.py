"""What the system is asked and told: errors name their file, bytes are on the disk, nothing interrupts."""

from __future__ import annotations

import errno
import os
import signal
import threading
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from types import FrameType

_NAMES = ("SIGINT", "SIGTERM", "SIGHUP", "SIGQUIT")
#: file systems that cannot do it say so in these words
_CANNOT = (errno.EINVAL, errno.ENOTSUP, errno.ENOSYS)
#: what only writing meets; the system gives these errors no name
_WRITING = {errno.ENOSPC, errno.EFBIG, errno.EROFS, getattr(errno, "EDQUOT", errno.ENOSPC)}


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


def sync_open(descriptor: int) -> None:
    """Return when the bytes of an open file are on its disk."""
    try:
        os.fsync(descriptor)
    except OSError as error:
        if error.errno not in _CANNOT:
            raise


def sync_files(paths: Iterable[Path]) -> None:
    """Return when the bytes of all files are on their disk."""
    for path in paths:
        descriptor = os.open(path, os.O_RDWR if os.name == "nt" else os.O_RDONLY)
        try:
            sync_open(descriptor)
        finally:
            os.close(descriptor)


def begin_sync(path: Path) -> None:
    """Have the system begin to write a file that is whole, so that less is left to wait for at the end."""
    if not hasattr(os, "posix_fadvise"):
        return
    with suppress(OSError):
        descriptor = os.open(path, os.O_RDONLY)
        try:
            # what is not on the disk yet is sent there, and stays in memory
            os.posix_fadvise(descriptor, 0, 0, os.POSIX_FADV_DONTNEED)
        finally:
            os.close(descriptor)


def sync_names(folder: Path) -> None:
    """Return when the names in `folder` are on its disk, where the system can say so of folders."""
    with suppress(OSError):
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


@contextmanager
def named(path: Path, *, writing_only: bool = False) -> Iterator[None]:
    """An OSError without a file name, raised inside, is about `path`.

    `writing_only`: so are only those that mean a full disk, a quota or a limit of size; others may come from
    files that are read meanwhile.
    """
    try:
        yield
    except OSError as error:
        if error.filename is not None or (writing_only and error.errno not in _WRITING):
            raise
        # array libraries say only how much was written
        reason = (
            error.strerror or f"not written whole ({error}): the disk, a quota or a file size limit is full"
        )
        raise OSError(error.errno or errno.EIO, reason, str(path)) from error

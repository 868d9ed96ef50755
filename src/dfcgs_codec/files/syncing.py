"""Bytes and names that are on the disk, not only on their way to it."""

from __future__ import annotations

import errno
import os
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path

#: file systems that cannot do it say so in these words
_CANNOT = (errno.EINVAL, errno.ENOTSUP, errno.ENOSYS)


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

"""Locks that end with their process: who can take one knows that its owner is gone."""

from __future__ import annotations

import os
import sys
from pathlib import Path

if sys.platform != "win32":
    import fcntl


def try_lock(descriptor: int) -> bool | None:
    """Lock an open file or folder until it is closed; False where another has it, None where none can."""
    if sys.platform == "win32":
        return None
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:
        return None
    return True


def open_to_lock(path: Path) -> int | None:
    """A descriptor of a file or folder, None where it is gone or not ours."""
    # some network file systems lock only what is open for writing
    flags = (os.O_RDONLY if path.is_dir() else os.O_RDWR) | getattr(os, "O_NOFOLLOW", 0)
    try:
        return os.open(path, flags)
    except OSError:
        return None

"""Hidden names for what is not whole yet; those of dead processes are found and removed."""

from __future__ import annotations

import hashlib
import os
import re
import secrets
import shutil
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from dfcgs_codec.errors import InputError

if sys.platform != "win32":
    import fcntl

_TOKEN_BYTES = 6
_TOKEN = f"[0-9a-f]{{{2 * _TOKEN_BYTES}}}"
#: a name of the target's that is longer gives way to its hash: names have at most 255 bytes
_LONGEST_NAME = 200
#: what this process is writing, and how to put it away
_at_work: dict[Path, Callable[[Path], None]] = {}


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


def _stem(target: Path) -> str:
    name = os.fsencode(target.name)
    if len(name) <= _LONGEST_NAME:
        return target.name
    return hashlib.sha256(name).hexdigest()


def hidden_name(stem: str) -> str:
    """A name that nothing has."""
    return f".{stem}.{secrets.token_hex(_TOKEN_BYTES)}.tmp"


def hidden_names(folder: Path, stem: str) -> list[Path]:
    """All that `hidden_name` has named in `folder`."""
    pattern = re.compile(rf"\.{re.escape(stem)}\.{_TOKEN}\.tmp")
    return sorted(path for path in folder.iterdir() if pattern.fullmatch(path.name))


def beside(target: Path) -> Path:
    """A hidden name beside `target` that nothing has."""
    return target.with_name(hidden_name(_stem(target)))


def another_run(target: Path) -> InputError:
    """What to say where another process is writing the same output."""
    return InputError(f"{target} is being written by another run; wait for its end, or name another output")


def hold(descriptor: int, path: Path, target: Path) -> None:
    """Lock `path`, just made, until it is closed; InputError where another run took it for abandoned."""
    if try_lock(descriptor) is False or not path.exists():
        raise another_run(target)


def remove(path: Path) -> None:
    """A file or a folder, as far as possible."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path, ignore_errors=True)
    else:
        with suppress(OSError):
            path.unlink()


@contextmanager
def put_away_at_end(path: Path, undo: Callable[[Path], None]) -> Iterator[None]:
    """`undo(path)` on an error or an interrupt, also where the process has to leave at once."""
    _at_work[path] = undo
    try:
        yield
    except BaseException:
        undo(path)
        raise
    finally:
        _at_work.pop(path, None)


def put_away_all() -> None:
    """What is not whole goes, at once: for a process that leaves without unwinding."""
    for path, undo in list(_at_work.items()):
        undo(path)


def each_abandoned(found: list[Path], target: Path, deal_with: Callable[[Path], None]) -> None:
    """`deal_with` those whose process is gone; InputError where one is still at work on `target`."""
    for path in found:
        descriptor = open_to_lock(path)
        if descriptor is None:
            continue
        try:
            locked = try_lock(descriptor)
            if locked is False:
                raise another_run(target)
            if locked:
                deal_with(path)
        finally:
            os.close(descriptor)


def clear_beside(place: Path, target: Path) -> None:
    """Remove what dead runs left beside `place`, which the user calls `target`."""
    try:
        found = hidden_names(place.parent, _stem(place))
    except OSError:
        # a folder that may be written but not listed
        return
    each_abandoned(found, target, remove)


@contextmanager
def writable(target: Path, folder: Path) -> Iterator[None]:
    """An error of the system while something is made in `folder` is said to be about `target`."""
    try:
        yield
    except OSError as error:
        raise InputError(
            f"{target}: nothing can be written into {folder}: {error.strerror or error}; name another output"
        ) from None

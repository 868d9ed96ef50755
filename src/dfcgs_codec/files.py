"""Files and folders that appear under their name only when they are whole."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from dfcgs_codec.errors import InputError


def _check_free(target: Path, force: bool) -> None:
    if target.exists() and not force:
        raise InputError(f"{target} exists; --force replaces it")
    if not target.parent.is_dir():
        raise InputError(f"{target.parent}: no such folder; create it first")


@contextmanager
def replace_when_whole(target: Path, *, force: bool) -> Iterator[BinaryIO]:
    """A file to write that becomes `target` at the end; an error or an interrupt leaves nothing behind."""
    _check_free(target, force)
    if target.is_dir():
        raise InputError(f"{target} is a folder; name a file")
    handle, name = tempfile.mkstemp(prefix=f".{target.name}.", suffix=".tmp", dir=target.parent)
    try:
        with os.fdopen(handle, "w+b") as file:
            yield file
        os.chmod(name, 0o666 & ~_umask())
        os.replace(name, target)
    except BaseException:
        Path(name).unlink(missing_ok=True)
        raise


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


@contextmanager
def replace_folder_when_whole(target: Path, *, force: bool) -> Iterator[Path]:
    """A folder to fill that becomes `target` at the end; an empty `target` may exist."""
    target = target.resolve()
    if target in (Path.cwd(), *Path.cwd().parents):
        raise InputError(f"{target} is the working folder or holds it; name another folder")
    empty = target.is_dir() and not any(target.iterdir())
    _check_free(target, force or empty)
    if target.exists() and not target.is_dir():
        raise InputError(f"{target} is a file; name a folder")
    folder = Path(tempfile.mkdtemp(prefix=f".{target.name}.", suffix=".tmp", dir=target.parent))
    try:
        yield folder
        folder.chmod(0o777 & ~_umask())
        if target.exists():
            shutil.rmtree(target)
        os.replace(folder, target)
    except BaseException:
        shutil.rmtree(folder, ignore_errors=True)
        raise

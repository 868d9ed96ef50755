"""Files and folders that appear under their name only when they are whole."""

from __future__ import annotations

import os
import secrets
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

from dfcgs_codec.errors import InputError

#: names of decoded frames
FRAME_NAME = "frame_{:04d}.ply"
FRAME_PATTERN = "frame_*.ply"


def _check_free(target: Path, force: bool) -> None:
    if target.exists() and not force:
        raise InputError(f"{target} exists; --force replaces it")
    if not target.parent.is_dir():
        raise InputError(f"{target.parent}: no such folder; create it first")


def _unfinished(target: Path) -> Path:
    """A name beside `target` that nothing has."""
    return target.with_name(f".{target.name}.{secrets.token_hex(6)}.tmp")


@contextmanager
def replace_when_whole(target: Path, *, force: bool) -> Iterator[BinaryIO]:
    """A file to write that becomes `target` at the end; an error or an interrupt leaves nothing behind."""
    _check_free(target, force)
    if target.is_dir():
        raise InputError(f"{target} is a folder; name a file")
    unfinished = _unfinished(target)
    # from here on: an interrupt right after the file is made must find it
    try:
        with unfinished.open("x+b") as file:
            yield file
        os.replace(unfinished, target)
    except BaseException:
        with suppress(OSError):
            unfinished.unlink()
        raise


def _check_holds_frames_only(target: Path) -> None:
    others = (
        [path.name for path in target.iterdir() if not path.match(FRAME_PATTERN)] if target.exists() else []
    )
    if others:
        raise InputError(
            f"{target} holds {others[0]}, which is no frame: only folders of frames are replaced"
        )


@contextmanager
def replace_folder_when_whole(target: Path, *, force: bool) -> Iterator[Path]:
    """A folder to fill that becomes `target` at the end.

    An empty `target` may exist, and with `force` one that holds nothing but frames; anything else is kept.
    """
    target = target.resolve()
    if target in (Path.cwd(), *Path.cwd().parents):
        raise InputError(f"{target} is the working folder or holds it; name another folder")
    empty = target.is_dir() and not any(target.iterdir())
    _check_free(target, force or empty)
    if target.exists() and not target.is_dir():
        raise InputError(f"{target} is a file; name a folder")
    _check_holds_frames_only(target)
    folder = _unfinished(target)
    try:
        folder.mkdir()
        yield folder
        if target.exists():
            shutil.rmtree(target)
        os.replace(folder, target)
    except BaseException:
        shutil.rmtree(folder, ignore_errors=True)
        raise

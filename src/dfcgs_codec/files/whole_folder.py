"""One output folder of frames, whole or not there."""

from __future__ import annotations

import errno
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from dfcgs_codec.errors import InputError
from dfcgs_codec.files.swap import begin, discard, recover, swap
from dfcgs_codec.files.system import named, sync_files, sync_names, uninterrupted
from dfcgs_codec.files.targets import appeared, check_contents, entries, folder_target, is_frame
from dfcgs_codec.files.unfinished import (
    beside,
    clear_beside,
    each_abandoned,
    hidden_name,
    hidden_names,
    hold,
    put_away_at_end,
    remove,
    writable,
)

#: hidden folders inside an output folder
_STEM = "dfcgs"


@contextmanager
def _held_folder(folder: Path, target: Path, undo: Callable[[Path], None]) -> Iterator[None]:
    """A new folder, locked; `undo` removes it on an error or an interrupt."""
    with put_away_at_end(folder, undo):
        with writable(target, folder.parent):
            folder.mkdir()
        if os.name == "nt":
            yield
            return
        lock = os.open(folder, os.O_RDONLY)
        try:
            hold(lock, folder, target)
            yield
        finally:
            os.close(lock)


def _sync(folder: Path) -> None:
    sync_files(sorted(folder.iterdir()))
    sync_names(folder)


@contextmanager
def _new_folder(place: Path, target: Path) -> Iterator[Path]:
    folder = beside(place)
    with _held_folder(folder, target, remove), named(target, writing_only=True):
        yield folder
        _sync(folder)
        with uninterrupted():
            try:
                # takes the place of nothing, or of an empty folder
                os.rename(folder, place)
            except OSError as error:
                if error.errno in (errno.ENOTEMPTY, errno.EEXIST, errno.ENOTDIR):
                    raise appeared(target) from None
                raise InputError(
                    f"{target}: the finished folder cannot take its name: {error.strerror}"
                ) from None
            sync_names(place.parent)


def _swap(work: Path, place: Path, target: Path, *, force: bool) -> None:
    found = [path for path in entries(place) if path != work]
    if found and not force:
        raise appeared(target / found[0].name)
    # what is no frame came meanwhile and stays
    old = [path for path in found if is_frame(path)]
    try:
        swap(work, place, old)
    except FileExistsError as error:
        raise appeared(Path(error.filename)) from None
    except OSError as error:
        raise InputError(f"{target}: the finished frames cannot take their names: {error.strerror}") from None


def _recover(work: Path) -> None:
    try:
        recover(work)
    except FileExistsError as error:
        raise InputError(
            f"{error.filename} is in the way of a frame that an earlier run left in {work}: move it away, "
            "then try again"
        ) from None


@contextmanager
def _inside(place: Path, target: Path, *, force: bool) -> Iterator[Path]:
    work = place / hidden_name(_STEM)
    with _held_folder(work, target, discard), named(target, writing_only=True):
        filling = begin(work)
        yield filling
        _sync(filling)
        with uninterrupted():
            _swap(work, place, target, force=force)


@contextmanager
def replace_folder_when_whole(target: Path, *, force: bool) -> Iterator[Path]:
    """A folder to fill with files whose contents become those of `target` at the end.

    An empty `target` may exist, and with `force` one that holds nothing but frames: it stays the folder that
    it is (it may be a mount point), only what is in it is replaced. A link's target is used. InputError for
    anything else, and for what has appeared at the end.
    """
    place = folder_target(target)
    clear_beside(place, target)
    if place.is_dir():
        each_abandoned(hidden_names(place, _STEM), target, _recover)
        check_contents(target, place, force=force)
        filled = _inside(place, target, force=force)
    else:
        filled = _new_folder(place, target)
    with filled as folder:
        yield folder

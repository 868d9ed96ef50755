"""One output file, whole or not there."""

from __future__ import annotations

import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from dfcgs_codec.errors import InputError
from dfcgs_codec.files.system import named, sync_names, sync_open, uninterrupted
from dfcgs_codec.files.targets import appeared, file_target
from dfcgs_codec.files.unfinished import beside, clear_beside, hold, put_away_at_end, remove, writable


def _rename_new(source: Path, place: Path) -> None:
    """Give the file its name, unless something has it: FileExistsError."""
    if os.name == "nt":
        # there, this is what it does
        os.rename(source, place)
        return
    try:
        os.link(source, place)
    except FileExistsError:
        raise
    except OSError:
        # no hard links here: an empty file takes the name first
        os.close(os.open(place, os.O_CREAT | os.O_EXCL | os.O_WRONLY))
        os.replace(source, place)
        return
    os.unlink(source)


def _deliver(unfinished: Path, place: Path, target: Path, *, force: bool) -> None:
    try:
        if force and place.is_file():
            # who may read it stays as it was
            os.chmod(unfinished, stat.S_IMODE(place.stat().st_mode))
        if force:
            os.replace(unfinished, place)
        else:
            _rename_new(unfinished, place)
    except FileExistsError:
        raise appeared(target) from None
    except OSError as error:
        raise InputError(f"{target}: the finished file cannot take its name: {error.strerror}") from None


def check_file_target(target: Path, *, force: bool) -> None:
    """InputError where `replace_when_whole` would refuse `target`, found out by trying to write there.

    Before work begins, and what dead runs have left of `target` is removed.
    """
    place = file_target(target, force=force)
    clear_beside(place, target)
    trial = beside(place)
    # an interrupt while the trial is removed must find it, too
    with put_away_at_end(trial, remove):
        with writable(target, place.parent), trial.open("x+b"):
            pass
        remove(trial)


@contextmanager
def replace_when_whole(target: Path, *, force: bool) -> Iterator[BinaryIO]:
    """A file to write and read that becomes `target` at the end; an error or an interrupt leaves nothing.

    A link's target is written. The file is on the disk before it has its name. Without `force`, nothing that
    has the name, even since a moment ago, is replaced: InputError.
    """
    place = file_target(target, force=force)
    clear_beside(place, target)
    unfinished = beside(place)
    # from here on: an interrupt right after the file is made must find it
    with put_away_at_end(unfinished, remove):
        with writable(target, place.parent):
            file = unfinished.open("x+b")
        with named(target, writing_only=True), file:
            hold(file.fileno(), unfinished, target)
            yield file
            file.flush()
            sync_open(file.fileno())
            if os.name == "nt":
                # an open file cannot be renamed there
                file.close()
            with uninterrupted():
                _deliver(unfinished, place, target, force=force)
                sync_names(place.parent)

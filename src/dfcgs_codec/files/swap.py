"""New files for old ones in a folder that stays: a mount point, or a folder in one that may not be written.

A hidden folder W in the target holds, one after the other,

    W/filling           what is being written
    W/new, W/old        all is written; old files are moved aside, one by one
    W/new, W/replaced   all old ones are aside; new ones are moved to their place, one by one

so that what a killed run leaves says what is to be done: throw W away; move the old ones back; or move the
rest of the new ones to their place. Whenever the process dies, all old files or all new ones are there.
"""

from __future__ import annotations

import errno
import os
from pathlib import Path

from dfcgs_codec.files.system import sync_names
from dfcgs_codec.files.unfinished import remove

_FILLING, _NEW, _OLD, _REPLACED = "filling", "new", "old", "replaced"


def begin(work: Path) -> Path:
    """The folder to fill in the hidden folder `work`."""
    filling = work / _FILLING
    filling.mkdir()
    return filling


def _move_all(source: Path, target: Path) -> None:
    """Every file of `source` to `target`, where nothing has its name: FileExistsError otherwise."""
    if not source.is_dir():
        return
    for path in sorted(source.iterdir()):
        place = target / path.name
        # both are ours from the beginning to the end: what has come between is somebody else's
        if os.path.lexists(place):
            raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST), str(place))
        os.rename(path, place)


def _back(work: Path, target: Path, names: list[str]) -> None:
    kept = work / (_OLD if (work / _OLD).is_dir() else _REPLACED)
    for name in names:
        if os.path.lexists(target / name) and not os.path.lexists(work / _NEW / name):
            os.rename(target / name, work / _NEW / name)
    _move_all(kept, target)


def swap(work: Path, target: Path, old: list[Path]) -> None:
    """What was filled for `old`, files in `target`; on an error all is as before."""
    names = sorted(path.name for path in (work / _FILLING).iterdir())
    (work / _OLD).mkdir()
    os.rename(work / _FILLING, work / _NEW)
    sync_names(work)
    try:
        for path in old:
            os.rename(path, work / _OLD / path.name)
        os.rename(work / _OLD, work / _REPLACED)
        sync_names(work)
        _move_all(work / _NEW, target)
    except BaseException:
        _back(work, target, names)
        raise
    sync_names(target)
    remove(work)


def discard(work: Path) -> None:
    """Throw away what was to be new, unless old files are still in `work`."""
    kept = [path for name in (_OLD, _REPLACED) if (work / name).is_dir() for path in (work / name).iterdir()]
    if not kept:
        remove(work)


def recover(work: Path) -> None:
    """Finish or undo what a killed run left in `work`; FileExistsError where a file is in the way."""
    if (work / _REPLACED).is_dir():
        _move_all(work / _NEW, work.parent)
    else:
        _move_all(work / _OLD, work.parent)
    sync_names(work.parent)
    remove(work)

"""What may become an output, and what may not: said before anything is done."""

from __future__ import annotations

import os
import stat
from collections.abc import Iterator
from pathlib import Path

from dfcgs_codec.errors import InputError

#: names of decoded frames
FRAME_NAME = "frame_{:04d}.ply"
FRAME_PATTERN = "frame_*.ply"
#: what systems put into folders on their own; it is left where it is
_SYSTEM_ENTRIES = {"lost+found", ".DS_Store", "Thumbs.db", "desktop.ini", "System Volume Information"}
#: what is neither a file nor a folder
KINDS = {
    stat.S_IFIFO: "a named pipe",
    stat.S_IFSOCK: "a socket",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
}
_MAX_LINKS = 40


def _through_links(path: Path) -> Iterator[Path]:
    """`path`, and what it links to, link by link."""
    for _ in range(_MAX_LINKS):
        yield path
        if not path.is_symlink():
            return
        path = path.parent / path.readlink()
    raise InputError(f"{path}: a link that leads back to itself; name another file")


def _is_stream(path: Path) -> bool:
    """Whether this is a name of what the process has open, such as /dev/stdout."""
    text = str(path)
    return text.startswith(("/dev/std", "/dev/fd/")) or (text.startswith("/proc/") and "/fd/" in text)


def _check_parent(target: Path, place: Path) -> None:
    if place.parent.is_dir():
        return
    if place.parent.exists():
        raise InputError(f"{target}: {place.parent} is a file, not a folder; name another folder")
    raise InputError(f"{target}: {place.parent}: no such folder; create it first")


def file_target(target: Path, *, force: bool) -> Path:
    """Where the file that is called `target` is written: at the end of its links.

    InputError for folders, pipes, devices, sockets, a file that exists unless `force`, a missing folder.
    """
    places = list(_through_links(target))
    place = Path(os.path.realpath(target))
    if any(_is_stream(step) for step in places):
        raise InputError(f"{target} is a stream of this process: the output needs a file; name one")
    if place.is_dir():
        name = Path(target, "frames.dgs")
        raise InputError(f"{target} is a folder: name a file in it, such as {name}")
    if target.suffix.lower() == ".ply":
        raise InputError(f"{target} is the name of a PLY: the output is one .dgs file; name that")
    _check_parent(target, place)
    if not place.exists():
        return place
    kind = KINDS.get(stat.S_IFMT(place.stat().st_mode))
    if kind is not None:
        raise InputError(f"{target} is {kind}: the output needs a file; name one")
    if not force:
        raise InputError(f"{target} exists; --force replaces it")
    return place


def appeared(target: Path) -> InputError:
    """What to say of a name that was free when the run began."""
    return InputError(
        f"{target} appeared during this run and was left as it is: nothing was written; name another output"
    )


def entries(folder: Path) -> list[Path]:
    """What is in `folder`, but for what systems put there, in the order of names."""
    return sorted(path for path in folder.iterdir() if path.name not in _SYSTEM_ENTRIES)


def is_frame(path: Path) -> bool:
    """Whether this is a file of its own under a frame's name."""
    return path.match(FRAME_PATTERN) and not path.is_symlink() and path.is_file()


def check_contents(target: Path, folder: Path, *, force: bool) -> None:
    """InputError where `folder`, which the user calls `target`, holds anything but frames that may go."""
    found = entries(folder)
    if found and not force:
        raise InputError(f"{target} exists; --force replaces the frames in it")
    for path in found:
        if not path.match(FRAME_PATTERN):
            raise InputError(
                f"{target} holds {path.name}, which is no frame: only folders of frames are replaced"
            )
        if not is_frame(path):
            raise InputError(
                f"{target} holds {path.name}, which is a link or no file: only folders of frames are replaced"
            )


def folder_target(target: Path) -> Path:
    """Where the folder that is called `target` is, or will be: at the end of its links.

    InputError for what is no folder, and for a missing folder around it.
    """
    for _ in _through_links(target):
        pass
    place = Path(os.path.realpath(target))
    if place.is_dir():
        return place
    if place.exists():
        kind = KINDS.get(stat.S_IFMT(place.stat().st_mode), "a file")
        raise InputError(f"{target} is {kind}, not a folder: name a folder for the frames")
    _check_parent(target, place)
    return place

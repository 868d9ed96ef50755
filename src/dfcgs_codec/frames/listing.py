"""Files of a folder that match a glob; what is called like a frame and is none is refused, never opened."""

from __future__ import annotations

import fnmatch
import os
import re
import stat
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from dfcgs_codec.errors import InputError
from dfcgs_codec.files.targets import KINDS
from dfcgs_codec.frames.refusals import ending_of_any_case

_MAGIC = re.compile(r"[*?\[]")


@dataclass
class Listing:
    """Relative paths of files that match, sorted, and of hidden ones that are left out."""

    names: list[str] = field(default_factory=list)
    hidden: list[str] = field(default_factory=list)


def entries(folder: Path) -> list[os.DirEntry[str]]:
    """What is in `folder`, by name; InputError where that cannot be read."""
    try:
        with os.scandir(folder) as found:
            return sorted(found, key=lambda entry: entry.name)
    except OSError as error:
        raise InputError(f"{folder}: the folder cannot be read ({error.strerror})") from None


def check_is_file(path: Path, *, or_folder: bool = False) -> bool:
    """Whether `path` is a file. InputError for what only looks like one; a folder is that, or `or_folder`."""
    try:
        mode = path.stat().st_mode
    except OSError as error:
        if path.is_symlink():
            raise InputError(
                f"{path} is a link to {os.readlink(path)}, which cannot be reached ({error.strerror}); mend "
                "or remove it"
            ) from None
        raise InputError(f"{path}: cannot be read ({error.strerror})") from None
    if stat.S_ISREG(mode):
        return True
    if stat.S_ISDIR(mode) and or_folder:
        return False
    what = "a folder" if stat.S_ISDIR(mode) else KINDS.get(stat.S_IFMT(mode), "no file")
    raise InputError(f"{path} is {what}, but called like a frame; move it elsewhere or choose with --pattern")


def _check_pattern(pattern: str) -> list[str]:
    """The pattern's parts; ValueError for what is no relative glob."""
    if not pattern or "\0" in pattern:
        raise ValueError("it is empty" if not pattern else "it holds a zero byte")
    if pattern.startswith("/") or Path(pattern).is_absolute():
        raise ValueError("it is an absolute path")
    return [part for part in pattern.split("/") if part not in ("", ".")]


def _folders_below(folder: Path, relative: str) -> Iterator[tuple[Path, str]]:
    """The folder and all below it; links are not followed, as they may lead back."""
    yield folder, relative
    for entry in entries(folder):
        if not entry.name.startswith(".") and entry.is_dir(follow_symlinks=False):
            yield from _folders_below(folder / entry.name, f"{relative}{entry.name}/")


def _match(folder: Path, relative: str, parts: list[str], found: Listing) -> None:
    part, rest = parts[0], parts[1:]
    if part == "**":
        for below, path in _folders_below(folder, relative):
            _match(below, path, rest or ["*"], found)
        return
    if not _MAGIC.search(part) and rest:
        if (folder / part).is_dir():
            _match(folder / part, f"{relative}{part}/", rest, found)
        return
    wanted = re.compile(fnmatch.translate(part if rest else ending_of_any_case(part)))
    for entry in entries(folder):
        if not wanted.match(entry.name):
            continue
        if entry.name.startswith(".") and not part.startswith("."):
            if not rest:
                found.hidden.append(relative + entry.name)
        elif not rest:
            found.names.append(relative + entry.name)
        elif entry.is_dir():
            _match(folder / entry.name, f"{relative}{entry.name}/", rest, found)


def matches(folder: Path, pattern: str) -> Listing:
    """What in `folder` matches `pattern`, a relative glob that may contain '/' and '**'.

    '.ply' at its end stands for any case. Hidden files are left out and listed apart, unless the pattern
    begins their names with '.'. Other folders than those called '*.ply' are none of the files. InputError for
    other patterns, for links to nothing, folders and pipes called like frames, and unreadable folders.
    """
    found = Listing()
    try:
        parts = _check_pattern(pattern)
    except ValueError as error:
        raise InputError(
            f"{folder}: --pattern {pattern!r}: {error}; it is a relative glob such as '*.ply'"
        ) from None
    if parts:
        _match(folder, "", parts, found)
    files = (
        name
        for name in sorted(set(found.names))
        if check_is_file(folder / name, or_folder=not name.lower().endswith(".ply"))
    )
    return Listing(list(files), sorted(set(found.hidden)))

"""Files that hold Gaussians, but are no PLYs: what they are and how they become PLYs."""

from __future__ import annotations

import shlex
from collections.abc import Iterable
from pathlib import Path

from dfcgs_codec.ply.formats import FOREIGN_SUFFIXES, describe_foreign, reader_installed

_UNPACK = "unpack it first and name the folder of its PLYs"

#: ending -> what it is, what to do
_KINDS = {
    ".zip": ("an archive", "unzip it first: unzip {name} -d frames, then dfcgs encode frames out.dgs"),
    ".tar": ("an archive", _UNPACK),
    ".tgz": ("an archive", _UNPACK),
    ".gz": ("a compressed file", _UNPACK),
    ".xz": ("a compressed file", _UNPACK),
    ".zst": ("a compressed file", _UNPACK),
    ".7z": ("an archive", _UNPACK),
    ".rar": ("an archive", _UNPACK),
}
#: what may be a frame beside PLYs
_SPLATS = (".splat", ".ksplat", ".spz", ".sog")
_MADE_OF_PLY = (".gz", ".xz", ".zst", ".part", ".partial", ".tmp", ".bak", ".download", ".crdownload", "~")


def _ending(name: str) -> str:
    return "." + name.lower().rpartition(".")[2]


def describe(name: str) -> str | None:
    """What a file of this name (or path) is and which command makes a PLY of it, or None."""
    splats = describe_foreign(Path(name))
    if splats is not None:
        return splats
    kind = _KINDS.get(_ending(name))
    if kind is None:
        return None
    stem = shlex.quote(name.rpartition(".")[0])
    return f"{kind[0]}; {kind[1].format(name=shlex.quote(name), stem=stem)}"


def readable(names: Iterable[str]) -> list[str]:
    """Those that are no PLYs and can be read as frames all the same, as a reader for them is installed."""
    return [
        name
        for name in names
        if reader_installed() and not name.startswith(".") and name.lower().endswith(FOREIGN_SUFFIXES)
    ]


def like_frames(names: Iterable[str]) -> list[str]:
    """Those that may be frames, too: splats, and PLYs that are packed or unfinished."""
    found = []
    for name in names:
        lower = name.lower()
        unfinished = any(lower.endswith(f".ply{end}") for end in _MADE_OF_PLY)
        if not name.startswith(".") and (lower.endswith(_SPLATS) or unfinished):
            found.append(name)
    return found


def first_described(names: Iterable[str]) -> str | None:
    """The first of the files that is known, with how many there are of its kind and what to do."""
    shown = [name for name in names if not name.startswith(".")]
    for name in shown:
        what = describe(name)
        if what is not None:
            count = sum(_ending(other) == _ending(name) for other in shown)
            more = f" (and {count - 1} more {_ending(name)})" if count > 1 else ""
            return f"{name}{more}: {what}"
    return None

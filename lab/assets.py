"""Scenes that a measurement can use: larger ones beside the repository, else the small ones in it."""

from __future__ import annotations

from pathlib import Path

from lab.record import REPOSITORY

#: where larger scenes lie when they are there
_BESIDE = REPOSITORY.parent / "shared" / "data"
#: where sequences that were fitted to images lie; a capture has a folder of its name beside its file
STORED = REPOSITORY / "assets" / "fitted"
_FOLDERS = (
    _BESIDE / "splats",
    _BESIDE / "animated",
    REPOSITORY / "assets",
    STORED,
)


def find_asset(*names: str) -> Path:
    """The first of `names` that exists, in the larger collection or in the repository."""
    for name in names:
        for folder in _FOLDERS:
            if (folder / name).exists():
                return folder / name
    raise FileNotFoundError(f"none of {', '.join(names)} is in {', '.join(map(str, _FOLDERS))}")


def has_asset(name: str) -> bool:
    """Whether `find_asset` would find it."""
    return any((folder / name).exists() for folder in _FOLDERS)

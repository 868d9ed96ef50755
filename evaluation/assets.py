"""Scenes that a measurement can use: larger ones beside the repository, else the small ones in it."""

from __future__ import annotations

from pathlib import Path

from evaluation.record import REPOSITORY

#: where larger scenes lie when they are there
_BESIDE = REPOSITORY.parent / "shared" / "data"
_FOLDERS = (
    _BESIDE / "splats",
    _BESIDE / "animated",
    REPOSITORY / "assets",
    REPOSITORY / "assets" / "fitted",
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

"""Scenes that a measurement can use: larger ones beside the repository, else the small ones in it."""

from __future__ import annotations

import sys
from collections.abc import Collection, Iterable, Iterator
from pathlib import Path
from typing import Protocol, TypeVar

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


class _OfAsset(Protocol):
    @property
    def name(self) -> str: ...
    @property
    def asset(self) -> str: ...


_T = TypeVar("_T", bound=_OfAsset)


def present(scenes: Iterable[_T], wanted: Collection[str] = ()) -> Iterator[_T]:
    """The scenes that are wanted by name (empty: all) and on this machine; says which are not there."""
    for scene in scenes:
        if wanted and scene.name not in wanted:
            continue
        if has_asset(scene.asset):
            yield scene
        else:
            print(f"{scene.name}: skipped, {scene.asset} is not on this machine", file=sys.stderr)


def has_asset(name: str) -> bool:
    """Whether `find_asset` would find it."""
    return any((folder / name).exists() for folder in _FOLDERS)

"""Cameras that lie beside the frames, where trainers leave them."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from pathlib import Path

from dfcgs_codec.frames.names import ITERATION
from dfcgs_codec.views.colmap import colmap_ending
from dfcgs_codec.views.read import FILES

_COLMAP = Path("sparse", "0")


def _is_trainers(folder: Path) -> bool:
    """Whether a folder is one that INRIA's trainer makes for its point clouds, inside that of the model."""
    return folder.name == "point_cloud" or ITERATION.fullmatch(folder.name) is not None


def _folders(frame_paths: Sequence[Path]) -> Iterator[Path]:
    """From the first frame's folder up to that of all frames, or of the model that this is part of."""
    folders = {Path(os.path.abspath(path)).parent for path in frame_paths}
    common = Path(os.path.commonpath(folders))
    folder = Path(os.path.abspath(frame_paths[0])).parent
    yield folder
    while (folder.is_relative_to(common) and folder != common) or _is_trainers(folder):
        folder = folder.parent
        yield folder


def find_views(frame_paths: Sequence[Path]) -> Path | None:
    """The nearest file of cameras (or COLMAP's folder `sparse/0`) beside the frames, or None.

    It is looked for beside the first frame, in the folders above it up to that of all frames, and, where
    that is one of `model/point_cloud/iteration_N`, in that of the model. It is not opened.
    """
    for folder in _folders(frame_paths) if frame_paths else ():
        for name in FILES:
            if os.path.isfile(folder / name):
                return folder / name
        if colmap_ending(folder / _COLMAP):
            return folder / _COLMAP
    return None

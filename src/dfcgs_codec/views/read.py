"""The one door to files of cameras: where they lie, and what a file or a folder is shows in what it holds."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from pathlib import Path

from dfcgs_codec.arguments import AnyPath, path_of, real
from dfcgs_codec.errors import InputError
from dfcgs_codec.frames.names import ITERATION
from dfcgs_codec.views.camera import ViewCamera, Views
from dfcgs_codec.views.colmap import cameras_of_colmap, colmap_ending
from dfcgs_codec.views.fields import (
    check_count,
    json_of,
    matrix_of,
    record_of,
    told_of,
    vector_of,
    world_to_camera,
)
from dfcgs_codec.views.transforms import cameras_of_transforms

_COLMAP = Path("sparse", "0")
_KEYS = ("width", "height", "position", "rotation", "fx", "fy")
#: files of cameras in a folder, the first that is there; else a model of COLMAP in one of its places
FILES = ("cameras.json", "transforms.json")
COLMAP_PLACES = ("", "0", "sparse/0", "sparse", "colmap/sparse/0")
EXPECTED = "cameras.json, transforms.json or a folder of COLMAP"
_COLMAP_FILES = tuple(f"{name}{ending}" for name in ("cameras", "images") for ending in (".bin", ".txt"))
_JSON_BEGINS = (b"[", b"{")
_LOOKED_AT = 64


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


def _camera(value: object) -> ViewCamera:
    """One camera; its columns are right, down and forward in the world. The principal point is the middle."""
    found = record_of(value, _KEYS)
    rotation = matrix_of("rotation", found["rotation"], (3,), 3)
    pose = world_to_camera(rotation, vector_of("position", found["position"], 3))
    width, height = found["width"], found["height"]
    cx = found.get("cx", real("width", width) / 2)
    cy = found.get("cy", real("height", height) / 2)
    return ViewCamera(width, height, found["fx"], found["fy"], cx, cy, pose)


def cameras_of_inria(values: Sequence[object]) -> tuple[ViewCamera, ...]:
    """Cameras of the list that the file holds; InputError for anything that is no camera."""
    check_count(len(values))
    cameras = []
    for index, value in enumerate(values):
        with told_of(f"camera {index}"):
            cameras.append(_camera(value))
    return tuple(cameras)


def colmap_in(folder: Path) -> Path | None:
    """The folder of the model that `folder` is or has in one of COLMAP's places, or None."""
    places = (folder / place for place in COLMAP_PLACES)
    return next((place for place in places if colmap_ending(place)), None)


def _of_colmap(folder: Path) -> tuple[ViewCamera, ...]:
    ending = colmap_ending(folder)
    if ending is None:
        raise InputError(f"{folder}: found one of COLMAP's files alone, expected cameras and images")
    return cameras_of_colmap(folder, ending)


def _of_folder(folder: Path) -> Views:
    for path in (folder / name for name in FILES):
        if os.path.isfile(path):
            return Views(_of_file(path), path)
    model = colmap_in(folder)
    if model is None:
        raise InputError(f"{folder}: found a folder without cameras, expected {EXPECTED} in it")
    return Views(_of_colmap(model), model)


def _of_file(path: Path) -> tuple[ViewCamera, ...]:
    if path.name in _COLMAP_FILES:
        return _of_colmap(path.parent)
    with told_of(path):
        if not path.is_file():
            raise InputError(f"found a pipe or a device, expected {EXPECTED}")
        with path.open("rb") as file:
            begins = file.read(_LOOKED_AT).removeprefix(b"\xef\xbb\xbf").lstrip()
        if not begins.startswith(_JSON_BEGINS):
            what = "a file that is no JSON text" if begins else "an empty file"
            raise InputError(f"found {what}, expected {EXPECTED}")
        content = json_of(path)
        if isinstance(content, list):
            return cameras_of_inria(content)
        return cameras_of_transforms(path, content)


def read_views(path: AnyPath) -> Views:
    """The cameras of a file or a folder, in the frame of the splats that belong to it.

    `path`: a `cameras.json` of INRIA's trainer, a `transforms.json` of nerfstudio, instant-ngp or the
    synthetic scenes of NeRF, by any name; or a folder with one of them, or with a model of COLMAP, which may
    be in its `sparse/0`. InputError, which names the file, for anything else and for cameras that are none.
    """
    place = path_of("views", path, EXPECTED)
    if place.is_dir():
        return _of_folder(place)
    with told_of(place):
        place.stat()
    return Views(_of_file(place), place)

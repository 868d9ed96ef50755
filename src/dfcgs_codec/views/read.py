"""The one door to files of cameras: what a file or a folder is shows in what it holds."""

from __future__ import annotations

import os
from pathlib import Path

from dfcgs_codec.arguments import AnyPath, path_of
from dfcgs_codec.errors import InputError
from dfcgs_codec.views.camera import ViewCamera, Views
from dfcgs_codec.views.colmap import cameras_of_colmap, colmap_ending
from dfcgs_codec.views.fields import json_of, told_of
from dfcgs_codec.views.inria import cameras_of_inria
from dfcgs_codec.views.transforms import cameras_of_transforms

#: files of cameras in a folder, the first that is there; else a model of COLMAP in one of its places
FILES = ("cameras.json", "transforms.json")
COLMAP_PLACES = ("", "0", "sparse/0", "sparse", "colmap/sparse/0")
EXPECTED = "cameras.json, transforms.json or a folder of COLMAP"
_COLMAP_FILES = tuple(f"{name}{ending}" for name in ("cameras", "images") for ending in (".bin", ".txt"))
_JSON_BEGINS = (b"[", b"{")
_LOOKED_AT = 64


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

"""COLMAP's `cameras` and `images`, binary or text; distortion is left out.

Read here, as COLMAP's own Python package is a binary of tens of megabytes that is needed for nothing else.
What files announce is never allocated: they are read record by record, as far as the file goes.
"""

from __future__ import annotations

import math
import os
import struct
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from dfcgs_codec.arguments import whole
from dfcgs_codec.array_types import Float64
from dfcgs_codec.errors import InputError
from dfcgs_codec.views.camera import ViewCamera
from dfcgs_codec.views.fields import check_count, pose_matrix, told_of

#: by their numbers: names and parameters; one focal length, or two, then the principal point
_MODELS = (
    ("SIMPLE_PINHOLE", 3, 1),
    ("PINHOLE", 4, 2),
    ("SIMPLE_RADIAL", 4, 1),
    ("RADIAL", 5, 1),
    ("OPENCV", 8, 2),
    ("OPENCV_FISHEYE", 8, 2),
    ("FULL_OPENCV", 12, 2),
    ("FOV", 5, 2),
    ("SIMPLE_RADIAL_FISHEYE", 4, 1),
    ("RADIAL_FISHEYE", 5, 1),
    ("THIN_PRISM_FISHEYE", 12, 2),
    ("RAD_TAN_THIN_PRISM_FISHEYE", 16, 2),
    ("SIMPLE_DIVISION", 4, 1),
    ("DIVISION", 5, 2),
    ("SIMPLE_FISHEYE", 3, 1),
    ("FISHEYE", 4, 2),
    ("EUCM", 6, 2),
)
_MODEL_OF = {name: (count, focals) for name, count, focals in _MODELS}
_BYTES_OF_A_POINT = 24
#: quaternions are of length 1, but for rounding; others may be normalised as well
_SHORTEST = 1e-6
_LONGEST_NAME = 1 << 12
_LONGEST_LINE = 1 << 26

#: width, height, fx, fy, cx, cy
_Lens = tuple[Any, Any, float, float, float, float]


def _lens(model: str, width: object, height: object, parameters: tuple[float, ...]) -> _Lens:
    if model not in _MODEL_OF:
        raise InputError(f"found the camera model {model}, expected one of {', '.join(_MODEL_OF)}")
    count, focals = _MODEL_OF[model]
    if len(parameters) != count:
        raise InputError(f"found {len(parameters)} parameters of {model}, expected {count}")
    return width, height, parameters[0], parameters[focals - 1], parameters[focals], parameters[focals + 1]


def _pose(quaternion: tuple[float, ...], translation: tuple[float, ...]) -> Float64:
    """World to camera (4, 4), of w, x, y, z and a translation."""
    length = math.hypot(*quaternion)
    if not _SHORTEST < length < 1 / _SHORTEST:
        raise InputError(f"found a quaternion of length {length:g}, expected 1")
    w, x, y, z = np.array(quaternion) / length
    rotation = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return pose_matrix(np.array(rotation), np.array(translation))


class _Binary:
    def __init__(self, file: BinaryIO) -> None:
        self._file, self._left = file, os.fstat(file.fileno()).st_size

    def skip(self, count: int) -> None:
        """Leave out bytes; InputError where the file has no more."""
        if count > self._left:
            raise InputError(f"found a file that ends {count - self._left} bytes too early")
        self._left -= count
        self._file.seek(count, os.SEEK_CUR)

    def take(self, layout: str) -> tuple[Any, ...]:
        """The next values."""
        size = struct.calcsize(f"<{layout}")
        self.skip(size)
        self._file.seek(-size, os.SEEK_CUR)
        return struct.unpack(f"<{layout}", self._file.read(size))

    def skip_text(self) -> None:
        """Leave out a text that ends with a zero byte."""
        start = self._file.tell()
        length = self._file.read(_LONGEST_NAME).find(b"\0")
        if length < 0:
            raise InputError(f"found a name of {_LONGEST_NAME} bytes or more, or one without an end")
        self._file.seek(start)
        self.skip(length + 1)


def _binary_lenses(file: BinaryIO) -> Iterator[tuple[int, _Lens]]:
    reader = _Binary(file)
    (count,) = reader.take("Q")
    check_count(count)
    for _ in range(count):
        key, model, width, height = reader.take("iiQQ")
        if not 0 <= model < len(_MODELS):
            raise InputError(f"found the camera model number {model}, expected 0 to {len(_MODELS) - 1}")
        name, parameters, _ = _MODELS[model]
        yield key, _lens(name, width, height, reader.take("d" * parameters))


def _binary_images(file: BinaryIO) -> Iterator[tuple[int, Float64]]:
    reader = _Binary(file)
    (count,) = reader.take("Q")
    check_count(count, "images")
    for _ in range(count):
        _, *pose, key = reader.take("idddddddi")
        reader.skip_text()
        (points,) = reader.take("Q")
        reader.skip(_BYTES_OF_A_POINT * points)
        yield key, _pose(tuple(pose[:4]), tuple(pose[4:]))


def _lines(file: BinaryIO) -> Iterator[bytes]:
    while line := file.readline(_LONGEST_LINE):
        if len(line) == _LONGEST_LINE:
            raise InputError(f"found a line of {_LONGEST_LINE >> 20} MiB, expected shorter ones")
        yield line


def _numbers(words: list[str]) -> tuple[float, ...]:
    try:
        return tuple(float(word) for word in words)
    except ValueError:
        raise InputError(f"found '{' '.join(words)[:60]}', expected numbers") from None


def _words(line: bytes, least: int, expected: str) -> list[str]:
    words = line.decode("utf-8", "replace").split()
    if len(words) < least:
        raise InputError(f"found '{' '.join(words)[:60]}', expected {expected}")
    return words


def _text_lenses(file: BinaryIO) -> Iterator[tuple[int, _Lens]]:
    for line in _lines(file):
        if line.strip() and not line.startswith(b"#"):
            key, model, *rest = _words(line, 5, "a number, a camera model, width, height and parameters")
            width, height, *parameters = _numbers(rest)
            yield whole("camera", _numbers([key])[0]), _lens(model, width, height, tuple(parameters))


def _text_images(file: BinaryIO) -> Iterator[tuple[int, Float64]]:
    lines = _lines(file)
    for line in lines:
        if line.strip() and not line.startswith(b"#"):
            words = _words(line, 9, "a number, a quaternion, a translation and a camera's number")
            values = _numbers(words[1:9])
            # the image's points, perhaps an empty line
            next(lines, None)
            yield whole("camera", values[7]), _pose(values[:4], values[4:7])


def _cameras(images: Iterator[tuple[int, Float64]], lenses: Mapping[int, _Lens]) -> Iterator[ViewCamera]:
    for index, (key, pose) in enumerate(images):
        check_count(index + 1, "images")
        with told_of(f"image {index}"):
            if key not in lenses:
                raise InputError(f"found the camera number {key}, expected one of the file of cameras")
            yield ViewCamera(*lenses[key], pose)


def colmap_ending(folder: Path) -> str | None:
    """`.bin` or `.txt` where `folder` holds both files of a model, else None."""
    for ending in (".bin", ".txt"):
        if all(os.path.isfile(folder / f"{name}{ending}") for name in ("cameras", "images")):
            return ending
    return None


def cameras_of_colmap(folder: Path, ending: str) -> tuple[ViewCamera, ...]:
    """Cameras of the images in `folder`, of the files that end so; InputError names the wrong file."""
    is_binary = ending == ".bin"
    read_lenses: Callable[[BinaryIO], Iterator[tuple[int, _Lens]]]
    read_lenses = _binary_lenses if is_binary else _text_lenses
    read_images = _binary_images if is_binary else _text_images
    path = folder / f"cameras{ending}"
    with told_of(path), path.open("rb") as file:
        lenses = dict(read_lenses(file))
    path = folder / f"images{ending}"
    with told_of(path), path.open("rb") as file:
        cameras = tuple(_cameras(read_images(file), lenses))
        check_count(len(cameras), "images")
    return cameras

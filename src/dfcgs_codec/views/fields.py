"""Values of JSON records, checked one by one; messages say what was found and what was expected."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from dfcgs_codec.arguments import real, refusal
from dfcgs_codec.array_types import Float64
from dfcgs_codec.errors import InputError
from dfcgs_codec.views.camera import LARGEST

Record = Mapping[str, Any]

#: cameras of a file, at most, and bytes of a JSON file: that many with half a kilobyte each
MAX_CAMERAS = 1 << 17
MAX_JSON_BYTES = 1 << 26


@contextmanager
def told_of(what: object) -> Iterator[None]:
    """Errors in the block are those of `what`: a file, or a camera in it. Not to be read is one of them."""
    try:
        yield
    except InputError as error:
        raise InputError(f"{what}: {error}") from None
    except OSError as error:
        raise InputError(f"{what}: cannot be read ({error.strerror})") from None


def json_of(path: Path) -> Any:
    """What the JSON file at `path` holds; InputError for what is none, or too large to be cameras."""
    with path.open("rb") as file:
        data = file.read(MAX_JSON_BYTES + 1)
    if len(data) > MAX_JSON_BYTES:
        raise InputError(f"found more than {MAX_JSON_BYTES >> 20} MiB, expected the poses of cameras")
    try:
        return json.loads(data)
    except json.JSONDecodeError as error:
        raise InputError(f"found JSON that is broken in line {error.lineno} ({error.msg})") from None
    except (ValueError, RecursionError):
        raise InputError("found a file that is no JSON text, expected the poses of cameras") from None


def check_count(count: int, what: str = "cameras") -> None:
    """InputError for no cameras, and for more than anybody has."""
    if not 0 < count <= MAX_CAMERAS:
        raise InputError(f"found {count} {what}, expected 1 to {MAX_CAMERAS}")


def record_of(value: object, names: Sequence[str]) -> Record:
    """`value` as a record that has all `names`."""
    if not isinstance(value, Mapping):
        raise InputError(f"found a {type(value).__name__}, expected an object with {', '.join(names)}")
    missing = [name for name in names if name not in value]
    if missing:
        raise InputError(f"found no {', '.join(missing)}, expected an object with {', '.join(names)}")
    return value


def finite(name: str, value: object) -> float:
    """`value` as a float that is neither NaN nor infinite nor absurd."""
    number = real(name, value)
    if not abs(number) < LARGEST:
        raise refusal(name, value, f"a finite number below {LARGEST:g}")
    return number


def matrix_of(name: str, value: object, rows: tuple[int, ...], columns: int) -> Float64:
    """`value`, lists in a list, as a matrix of finite numbers with one of the numbers of `rows`."""
    shapes = " or ".join(f"{count} x {columns}" for count in rows)
    is_matrix = isinstance(value, list) and all(isinstance(row, list) for row in value)
    if not is_matrix or len(value) not in rows or any(len(row) != columns for row in value):  # type: ignore
        raise refusal(name, value, f"{shapes} numbers")
    return np.array([[finite(name, number) for number in row] for row in value])  # type: ignore


def vector_of(name: str, value: object, length: int) -> Float64:
    """`value`, a list, as a vector of finite numbers."""
    if not isinstance(value, list) or len(value) != length:
        raise refusal(name, value, f"{length} numbers")
    return np.array([finite(name, number) for number in value])


def pose_matrix(rotation: Float64, translation: Float64) -> Float64:
    """The matrix (4, 4) of a rotation (3, 3) and a translation (3,)."""
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, translation
    return pose


def world_to_camera(rotation: Float64, position: Float64) -> Float64:
    """The pose (4, 4) of a camera at `position` (3,) whose axes are the columns of `rotation` (3, 3)."""
    return pose_matrix(rotation.T, -rotation.T @ position)

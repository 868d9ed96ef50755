"""Read a stored fitted sequence (`training.fitting` makes them); needs numpy and the standard library only.

The file is a zip archive of xz streams; N Gaussians, K higher SH coefficients per channel, all numbers
little-endian:

    about       JSON: {"version": 1, "num_gaussians": N, "sh_degree": ..., "source": how it was made}
    first       frame 0: N rows of 14 + 3 K float32 (positions, rotations, scales, opacities, sh_dc, sh_rest
                channel first), as byte planes: (4, columns, N) bytes
    step_0001   frame 1 minus frame 0: N bits, which Gaussians move (first one in the highest bit of the first
                byte), then for those n the float16 steps of 3 position and 4 rotation values as byte planes:
                (2, 7, n) bytes
    step_0002   ...

A frame is the one before plus its step, in float32: one rounded addition per value, equal on every machine.
What does not move is not touched. Scales, opacities and SH are those of frame 0 throughout.
"""

from __future__ import annotations

import json
import lzma
import zipfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from dfcgs_codec.array_types import AnyArray, Float16, Float32, Int64
from dfcgs_codec.errors import InputError
from dfcgs_codec.gaussians import SH_REST_COEFFICIENTS, GaussianCloud

VERSION = 1
ABOUT, FIRST = "about", "first"
#: position and rotation values of one Gaussian's step
STEP_VALUES = 7


def step_name(index: int) -> str:
    """The member that leads from frame `index` - 1 to frame `index`."""
    return f"step_{index:04d}"


def fitted_sequence(path: str | Path) -> Iterator[GaussianCloud]:
    """The frames of a stored sequence; raises InputError for a file that is not one or is damaged."""
    try:
        with zipfile.ZipFile(path) as archive:
            about = _about(archive)
            cloud = _first(_member(archive, FIRST), about)
            yield cloud
            names = set(archive.namelist())
            for index in range(1, len(names) - 1):
                rows, steps = _step(_member(archive, step_name(index)), cloud.num_gaussians)
                cloud = stepped(cloud, rows, steps)
                yield cloud
    except (OSError, EOFError, KeyError, ValueError, zipfile.BadZipFile, lzma.LZMAError) as error:
        raise InputError(f"{path}: not a stored fitted sequence, or damaged: {error}") from error


def read_about(path: str | Path) -> dict[str, Any]:
    """The file's description: version, num_gaussians, sh_degree and source."""
    with zipfile.ZipFile(path) as archive:
        return _about(archive)


def stepped(cloud: GaussianCloud, rows: Int64, steps: Float16) -> GaussianCloud:
    """The next frame: Gaussians `rows` (n,) moved by `steps` (n, 7) position and rotation values."""
    positions, rotations = cloud.positions.copy(), cloud.rotations.copy()
    positions[rows] += steps[:, :3].astype(np.float32)
    rotations[rows] += steps[:, 3:].astype(np.float32)
    return replace(cloud, positions=positions, rotations=rotations)


def split_columns(table: Float32) -> tuple[Float32, ...]:
    """(N, 14 + 3 K) -> the arrays of a GaussianCloud, in its order."""
    *arrays, rest = np.split(table, [3, 7, 10, 11, 14], axis=1)
    arrays[3] = arrays[3][:, 0]
    return *(np.ascontiguousarray(a) for a in arrays), np.ascontiguousarray(rest.reshape(len(table), 3, -1))


def _member(archive: zipfile.ZipFile, name: str) -> bytes:
    return lzma.decompress(archive.read(name), lzma.FORMAT_XZ)


def _about(archive: zipfile.ZipFile) -> dict[str, Any]:
    about: dict[str, Any] = json.loads(_member(archive, ABOUT))
    if about["version"] != VERSION:
        raise ValueError(f"found version {about['version']}, expected {VERSION}")
    return about


def _first(data: bytes, about: dict[str, Any]) -> GaussianCloud:
    columns = 14 + 3 * SH_REST_COEFFICIENTS[about["sh_degree"]]
    return GaussianCloud(*split_columns(_from_planes(data, "<f4", (columns, about["num_gaussians"]))))


def _step(data: bytes, num_gaussians: int) -> tuple[Int64, Float16]:
    size = -(-num_gaussians // 8)
    bits = np.unpackbits(np.frombuffer(data[:size], np.uint8), count=num_gaussians)
    rows = np.flatnonzero(bits)
    return rows, _from_planes(data[size:], "<f2", (STEP_VALUES, len(rows)))


def _from_planes(data: bytes, dtype: str, shape: tuple[int, int]) -> AnyArray:
    """Byte planes of (columns, rows) values -> (rows, columns), in the machine's byte order."""
    width = np.dtype(dtype).itemsize
    planes = np.frombuffer(data, np.uint8).reshape(width, *shape)
    values = np.ascontiguousarray(planes.transpose(1, 2, 0)).view(dtype)[:, :, 0]
    return np.ascontiguousarray(values.T.astype(np.dtype(dtype).newbyteorder("=")))

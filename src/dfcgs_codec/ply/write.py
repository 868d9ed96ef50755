"""GaussianCloud -> PLY: binary little-endian, in the INRIA property order."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from dfcgs_codec.array_types import AnyArray
from dfcgs_codec.gaussians import GaussianCloud
from dfcgs_codec.ply.schema import NORMALS, POSITIONS, ROTATIONS, SCALES, SH_DC, rest_names

_TYPE_NAMES = {"<f4": "float", "<f8": "double"}


def write_ply(path: Path, cloud: GaussianCloud, comments: Sequence[bytes] = ()) -> None:
    """Write `cloud` to `path`; float64 arrays as double, all others as float.

    `comments` are lines of bytes without the word 'comment'; a line end within one becomes a space.
    """
    groups = _groups(cloud)
    types = [(name, kind) for names, values in groups for name, kind in _types(names, values)]
    with path.open("wb") as file:
        file.write(_header(cloud.num_gaussians, types, comments))
        file.write(_table(groups, types, cloud.num_gaussians).data)


def _groups(cloud: GaussianCloud) -> list[tuple[tuple[str, ...], AnyArray]]:
    n = cloud.num_gaussians
    return [
        (POSITIONS, cloud.positions),
        (NORMALS, np.zeros((n, len(NORMALS)), np.float32)),
        (SH_DC, cloud.sh_dc),
        (rest_names(cloud.sh_degree), cloud.sh_rest.reshape(n, 3 * cloud.sh_rest.shape[2])),
        (("opacity",), cloud.opacities[:, None]),
        (SCALES, cloud.scales),
        (ROTATIONS, cloud.rotations),
    ]


def _types(names: Iterable[str], values: AnyArray) -> list[tuple[str, str]]:
    return [(name, "<f8" if values.dtype == np.float64 else "<f4") for name in names]


def _header(count: int, types: list[tuple[str, str]], comments: Sequence[bytes]) -> bytes:
    lines = [b"ply", b"format binary_little_endian 1.0"]
    lines += [b"comment " + b" ".join(comment.splitlines()) for comment in comments]
    lines.append(b"element vertex %d" % count)
    lines += [f"property {_TYPE_NAMES[kind]} {name}".encode() for name, kind in types]
    return b"\n".join([*lines, b"end_header", b""])


def _table(
    groups: list[tuple[tuple[str, ...], AnyArray]], types: list[tuple[str, str]], count: int
) -> AnyArray:
    if all(kind == "<f4" for _, kind in types):
        table = np.empty((count, len(types)), "<f4")
        first = 0
        for names, values in groups:
            table[:, first : first + len(names)] = values
            first += len(names)
        return table
    rows = np.empty(count, types)
    for names, values in groups:
        for index, name in enumerate(names):
            rows[name] = values[:, index]
    return rows

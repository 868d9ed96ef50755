"""Write a fitted sequence; the format is described in `lab.scenes.fitted`."""

from __future__ import annotations

import json
import lzma
import os
import shutil
import zipfile
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from dfcgs_codec.array_types import Float16, Float32, Floats, Int64
from dfcgs_codec.gaussians import GaussianCloud
from lab.scenes.fitted import ABOUT, FIRST, VERSION, read_about, step_name

#: members carry this time, so that equal sequences are equal files
_TIME = (1980, 1, 1, 0, 0, 0)
#: bytes of byte planes have no context worth the name: no literal context, no alignment
_FILTERS = [{"id": lzma.FILTER_LZMA2, "preset": 9 | lzma.PRESET_EXTREME, "lc": 0, "lp": 0, "pb": 0}]
#: low bits of a float16 step that are rounded away: nine significant bits stay, a tenth of the file goes
_DROPPED_BITS = 2


def create(path: Path, first: GaussianCloud, source: dict[str, Any]) -> None:
    """Write a sequence of one frame; `source` says how it is made."""
    about = {
        "version": VERSION,
        "num_gaussians": first.num_gaussians,
        "sh_degree": first.sh_degree,
        "source": source,
    }
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = _partial(path)
    with zipfile.ZipFile(partial, "w") as archive:
        _add(archive, ABOUT, json.dumps(about, indent=1).encode())
        _add(archive, FIRST, _planes(_table(first)))
    os.replace(partial, path)


def shortened(cloud: GaussianCloud) -> GaussianCloud:
    """The cloud with 16 significant bits in each value: a quarter of the file goes, and nothing that shows.

    Far finer than any step of a codec, and relative to each value: no grid that a codec could find.
    """
    names = [field.name for field in fields(cloud)]
    return GaussianCloud(**{name: _shortened(getattr(cloud, name)) for name in names})


def _shortened(values: Float32) -> Float32:
    bits = np.ascontiguousarray(values).view(np.uint32)
    return ((bits + np.uint32(0x80)) & np.uint32(0xFFFFFF00)).view(np.float32)


def append_step(path: Path, index: int, rows: Int64, steps: Float16) -> None:
    """Add what leads to frame `index`; an interruption leaves the file as it was."""
    moves = np.zeros(read_about(path)["num_gaussians"], np.bool_)
    moves[rows] = True
    partial = _partial(path)
    shutil.copyfile(path, partial)
    with zipfile.ZipFile(partial, "a") as archive:
        _add(archive, step_name(index), np.packbits(moves).tobytes() + _planes(steps))
    os.replace(partial, path)


def step_between(before: GaussianCloud, after: GaussianCloud) -> tuple[Int64, Float16]:
    """The Gaussians (n,) that move between two frames, and their steps (n, 7) as they are stored."""
    pairs = ((before.positions, after.positions), (before.rotations, after.rotations))
    steps = _rounded(np.concatenate([b - a for a, b in pairs], axis=1).astype(np.float16))
    rows = np.flatnonzero(steps.any(axis=1))
    return rows, steps[rows]


def _rounded(values: Float16) -> Float16:
    """The nearest values whose last bits are zero; a carry into the exponent is the next power of two."""
    half = np.uint16(1 << (_DROPPED_BITS - 1))
    kept = np.uint16(0xFFFF << _DROPPED_BITS & 0xFFFF)
    return ((values.view(np.uint16) + half) & kept).view(np.float16)


def _partial(path: Path) -> Path:
    return path.with_name(path.name + ".tmp")


def _add(archive: zipfile.ZipFile, name: str, data: bytes) -> None:
    packed = lzma.compress(data, lzma.FORMAT_XZ, filters=_FILTERS)
    archive.writestr(zipfile.ZipInfo(name, _TIME), packed)


def _table(cloud: GaussianCloud) -> Float32:
    n = cloud.num_gaussians
    rest = cloud.sh_rest.reshape(n, -1)
    columns = (cloud.positions, cloud.rotations, cloud.scales, cloud.opacities[:, None], cloud.sh_dc, rest)
    return np.concatenate(columns, axis=1)


def _planes(table: Floats) -> bytes:
    """(rows, columns) -> the bytes of (columns, rows) values: all first ones, all second ones, ..."""
    little = np.ascontiguousarray(table.T).astype(table.dtype.newbyteorder("<"))
    planes = little.view(np.uint8).reshape(*little.shape, table.dtype.itemsize)
    return np.ascontiguousarray(planes.transpose(2, 0, 1)).tobytes()

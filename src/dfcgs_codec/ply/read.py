"""PLY files -> GaussianCloud."""

from __future__ import annotations

import os
import stat
from dataclasses import replace
from pathlib import Path
from typing import BinaryIO

import numpy as np

from dfcgs_codec.errors import InputError
from dfcgs_codec.gaussians import GaussianCloud
from dfcgs_codec.ply.body import Columns, ends_early, exact_bytes, least_bytes, read_columns
from dfcgs_codec.ply.header import Header
from dfcgs_codec.ply.policy import InputPolicy, PlyHeader
from dfcgs_codec.ply.repair import bake_filter, check_values
from dfcgs_codec.ply.schema import FLAT_LOG_SCALE, NORMALS, SH_DC, Layout, frame_layout

#: a colour of SH degree 0 is 0.5 + SH_C0 f_dc
SH_C0 = 0.28209479177387814
_TRAILING = "bytes after the last row"


def open_frame(path: Path) -> BinaryIO:
    """The file, open; InputError, in place of a wait or an OSError, for what is no readable file."""
    try:
        mode = os.stat(path).st_mode
        if stat.S_ISREG(mode):
            return path.open("rb")
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from None
    what = "a folder" if stat.S_ISDIR(mode) else "a pipe or device"
    raise InputError(f"{path}: {what}, expected a PLY file")


def file_size(file: BinaryIO) -> int:
    """Of an open file or of bytes in memory."""
    here = file.tell()
    size = file.seek(0, os.SEEK_END)
    file.seek(here)
    return size


def peek_ply(file: BinaryIO, header: Header, path: Path, policy: InputPolicy) -> tuple[Layout, PlyHeader]:
    """What header and size of a plain PLY tell; the file is, and stays, at the start of the body."""
    layout = frame_layout(header, policy, path)
    extra = _extra_bytes(file, header, policy, path)
    if extra:
        layout = replace(layout, remarks=(*layout.remarks, f"left out: {extra} {_TRAILING}"))
    dropped = (*layout.dropped, _TRAILING) if extra else layout.dropped
    count = header.vertex.count
    return layout, PlyHeader(count, layout.sh_degree, header.comments, dropped, layout.flat, layout.remarks)


def _extra_bytes(file: BinaryIO, header: Header, policy: InputPolicy, path: Path) -> int:
    """How many bytes there are after the body; InputError for too few, and for too many if not allowed."""
    body = file_size(file) - header.body_start
    if body < least_bytes(header):
        raise ends_early(path, header.vertex.count, least_bytes(header) - body)
    expected = exact_bytes(header)
    extra = 0 if expected is None else body - expected
    if 0 < extra <= 2:
        here = file.tell()
        file.seek(-extra, os.SEEK_END)
        extra = len(file.read(extra).strip(b"\r\n"))
        file.seek(here)
    if extra and not policy.drop_extra:
        raise InputError(
            f"{path}: {extra} bytes more than the header announces: damaged in transfer, or the count of "
            f"{header.vertex.count} Gaussians is wrong; copy or export the frame again, or: "
            "--drop-extra leaves them out"
        )
    return extra


def load_ply(
    file: BinaryIO, header: Header, path: Path, policy: InputPolicy
) -> tuple[GaussianCloud, list[str]]:
    """The frame in a plain PLY that is open at the start of the body, and notes; see `read_ply`."""
    layout, _ = peek_ply(file, header, path, policy)
    columns, extra = read_columns(file, header, layout, path, trailing=policy.drop_extra)
    notes = [f"{path.name}: left out: {extra} lines after the last row"] * bool(extra)
    _check_normals(columns, layout, policy, path, notes)
    _complete(columns, layout)
    return finished(columns, layout.columns, path, policy, notes), notes


def _check_normals(
    columns: Columns, layout: Layout, policy: InputPolicy, path: Path, notes: list[str]
) -> None:
    if "normals" not in layout.columns:
        return
    used = [bool((column != 0).any()) for column in columns.pop("normals").T]
    if not any(used):
        return
    names = ", ".join(name for name, found in zip(NORMALS, used, strict=True) if found)
    if not policy.drop_extra:
        raise InputError(
            f"{path}: properties that the codec does not keep: {names}; --drop-extra encodes without them"
        )
    notes.append(f"{path.name}: left out: {names}")


def _complete(columns: Columns, layout: Layout) -> None:
    """What the file says in another way: colours, flat axes, filters."""
    if layout.rgb:
        columns["sh_dc"] = ((columns["sh_dc"].astype(np.float64) / 255 - 0.5) / SH_C0).astype(np.float32)
    if layout.flat:
        scales = columns["scales"]
        third = np.fmin(scales.min(axis=1, keepdims=True), scales.dtype.type(FLAT_LOG_SCALE))
        columns["scales"] = np.concatenate([scales, third], axis=1)
    if "filter" in columns:
        widths = columns.pop("filter")
        columns["scales"], columns["opacities"] = bake_filter(columns["scales"], columns["opacities"], widths)


def finished(
    columns: Columns, names: dict[str, tuple[str, ...]], path: Path, policy: InputPolicy, notes: list[str]
) -> GaussianCloud:
    """The cloud of these arrays (N, properties), checked and repaired as `policy` says; adds to `notes`."""
    names = names | {"scales": ("scale_0", "scale_1", "scale_2"), "sh_dc": SH_DC}
    if policy.repair:
        notes += check_values(columns, names, path.name, repair=True)
    elif not policy.keep_bits:
        check_values(columns, names, str(path), repair=False)
    count, num_rest = columns["sh_rest"].shape
    return GaussianCloud(
        positions=columns["positions"],
        rotations=columns["rotations"],
        scales=columns["scales"],
        opacities=columns["opacities"][:, 0],
        sh_dc=columns["sh_dc"],
        sh_rest=columns["sh_rest"].reshape(count, 3, num_rest // 3),
    )

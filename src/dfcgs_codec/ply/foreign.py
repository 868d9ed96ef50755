"""Frames in other formats, with a maintained reader (the extra `formats`): compressed PLY, .splat, .spz.

How many Gaussians there are is read here from header and size, before anything is allocated for them, and
compared with what the reader returns. The reader runs in a process of its own: it is native code that gets
strangers' bytes, and it prints to standard output.
"""

from __future__ import annotations

import io
import struct
import subprocess
import sys
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np

from dfcgs_codec.errors import InputError
from dfcgs_codec.gaussians import SH_REST_COEFFICIENTS, GaussianCloud
from dfcgs_codec.ply import compressed
from dfcgs_codec.ply.body import Columns, read_columns
from dfcgs_codec.ply.formats import READER, advice, reader_installed
from dfcgs_codec.ply.header import Header, read_header, readable
from dfcgs_codec.ply.policy import InputPolicy, PlyHeader, shortened
from dfcgs_codec.ply.read import file_size, finished
from dfcgs_codec.ply.repair import INVISIBLE_LOGIT, OPAQUE_LOGIT
from dfcgs_codec.ply.schema import frame_layout, standard_columns

COMPRESSED, SPLAT, SPZ = "compressed.ply", "splat", "spz"
_WHAT = {COMPRESSED: "a compressed PLY (packed_position)", SPLAT: "a .splat file", SPZ: "an SPZ file"}
_PLAIN = {COMPRESSED: "an uncompressed PLY", SPLAT: "PLY", SPZ: "PLY"}
_SPLAT_BYTES = 32
#: magic, version, Gaussians, SH degree, bits of fractions, flags, reserved
_SPZ_HEAD = struct.Struct("<4sIIBBBB")
_SPZ_ANTIALIASED = 1
_SPZ_EXTENDED = 2
#: bytes to a Gaussian without higher SH coefficients, of the versions that are a gzip of columns
_SPZ_ROW_BYTES = {2: 19, 3: 20}
_MOST_EXTENSION_BYTES = 1 << 16
_GZIP = 31
#: no compressor of real Gaussians comes near this many in a byte
_MOST_PER_BYTE = 1024
#: SPZ has y up and z towards the viewer, PLYs have y down and z forward: half a turn about x.
#: signs of the higher SH coefficients under that turn, degree 1 to 3
_SH_SIGNS = (-1, -1, 1, -1, 1, 1, -1, 1, -1, 1, -1, -1, 1, -1, 1)
_CHILD = f"""
import os, sys
out = os.dup(1)
os.dup2(2, 1)
import {READER}
result = {READER}.GaussForge().convert(sys.stdin.buffer.read(), sys.argv[1], "ply")
if "error" in result:
    sys.exit(str(result["error"]))
with os.fdopen(out, "wb") as file:
    file.write(result["data"])
"""


@dataclass(frozen=True)
class Foreign:
    """A frame in another format: which, and what its header says."""

    kind: str
    header: PlyHeader


def peek_compressed(file: BinaryIO, header: Header, path: Path, policy: InputPolicy) -> Foreign:
    """A compressed PLY that is open at the start of its body."""
    degree = compressed.sh_degree(header, file_size(file), path)
    extra = compressed.other_elements(header)
    if extra and not policy.drop_extra:
        raise InputError(
            f"{path}: elements that the codec does not keep: {shortened(extra)}; "
            "--drop-extra encodes without them"
        )
    remarks = (f"left out: {shortened(extra)}",) * bool(extra) + ("read from a compressed PLY",)
    found = PlyHeader(header.vertex.count, degree, header.comments, tuple(extra), remarks=remarks)
    return _readable(Foreign(COMPRESSED, found), path)


def peek_splat(file: BinaryIO, path: Path) -> Foreign:
    """A `.splat` file: nothing but rows of 32 bytes."""
    count, rest = divmod(file_size(file), _SPLAT_BYTES)
    if rest:
        raise InputError(f"{path}: {_WHAT[SPLAT]} ends within a Gaussian; copy or export the frame again")
    return _readable(Foreign(SPLAT, PlyHeader(count, 0, remarks=("read from a .splat file",))), path)


def peek_spz(file: BinaryIO, path: Path) -> Foreign:
    """An SPZ file, version 2 to 4."""
    size = file_size(file)
    head = file.read(512)
    if head.startswith(b"\x1f\x8b"):
        head = _unzipped(head, _SPZ_HEAD.size)
    if len(head) < _SPZ_HEAD.size or not head.startswith(b"NGSP"):
        raise InputError(f"{path}: not an SPZ file, though it is called one; export the frame again")
    _, version, count, degree, _, flags, _ = _SPZ_HEAD.unpack_from(head)
    if version not in (*_SPZ_ROW_BYTES, 4) or degree > 3:
        raise InputError(
            f"{path}: SPZ version {version} with SH degree {degree}; "
            "versions 2 to 4 and degrees 0 to 3 are read"
        )
    if count > _MOST_PER_BYTE * size:
        raise InputError(
            f"{path}: truncated or damaged: {count} Gaussians in {size} bytes; copy or export the frame again"
        )
    comments = (b"SplatRenderMode: mip",) if flags & _SPZ_ANTIALIASED else ()
    remark = "read from an SPZ file, turned about x (SPZ has y up, PLYs have y down)"
    return _readable(Foreign(SPZ, PlyHeader(count, degree, comments, remarks=(remark,))), path)


def _unzipped(data: bytes, most: int) -> bytes:
    try:
        return zlib.decompressobj(_GZIP).decompress(data, most)
    except zlib.error:
        return b""


def _readable(foreign: Foreign, path: Path) -> Foreign:
    if not reader_installed():
        suffix = ".compressed.ply" if foreign.kind == COMPRESSED else f".{foreign.kind}"
        raise InputError(f"{path}: {_WHAT[foreign.kind]}, no plain PLY; {advice(path, suffix)}")
    return foreign


def load_foreign(
    file: BinaryIO, foreign: Foreign, path: Path, policy: InputPolicy
) -> tuple[GaussianCloud, list[str]]:
    """The frame, and notes about what was repaired; see `read_ply`."""
    data = compressed.canonical(file, path) if foreign.kind == COMPRESSED else _whole(file, path)
    columns, names = _columns(_converted(data, foreign, path), foreign, path)
    if foreign.kind == SPZ:
        _turn(columns)
    # alpha in 8 bits is 0 or 1 where its logit is infinite
    np.clip(columns["opacities"], INVISIBLE_LOGIT, OPAQUE_LOGIT, out=columns["opacities"])
    notes: list[str] = []
    try:
        return finished(columns, names, path, policy, notes), notes
    except InputError as error:
        said = (
            str(error)
            .removeprefix(f"{path}: ")
            .replace("; --", f"; export it as {_PLAIN[foreign.kind]}, or: --")
        )
        raise InputError(f"{path}: {_WHAT[foreign.kind]}: {said}") from None


def _whole(file: BinaryIO, path: Path) -> bytes:
    """The bytes of a .splat or SPZ file; InputError if it unpacks to more or less than its header says."""
    file.seek(0)
    data = file.read()
    if not data.startswith(b"\x1f\x8b"):
        return data
    _, version, count, degree, _, flags, _ = _SPZ_HEAD.unpack(_unzipped(data, _SPZ_HEAD.size))
    needed = _SPZ_HEAD.size + count * (_SPZ_ROW_BYTES[version] + 3 * SH_REST_COEFFICIENTS[degree])
    allowed = needed + (_MOST_EXTENSION_BYTES if flags & _SPZ_EXTENDED else 0)
    found = len(_unzipped(data, allowed + 1))
    if not needed <= found <= allowed:
        raise InputError(
            f"{path}: {_WHAT[SPZ]}, damaged or truncated (unpacks to {'more than ' * (found > allowed)}"
            f"{min(found, allowed)} bytes, expected {needed}); copy it again, or export it as PLY"
        )
    return data


def _converted(data: bytes, foreign: Foreign, path: Path) -> bytes:
    if not foreign.header.num_gaussians:
        return b""
    command = [sys.executable, "-P", "-c", _CHILD, foreign.kind]
    done = subprocess.run(command, input=data, capture_output=True, check=False)
    if done.returncode or not done.stdout:
        said = done.stderr.strip().splitlines()[-1:] or [b"the reader failed"]
        raise InputError(
            f"{path}: {_WHAT[foreign.kind]}, damaged or truncated ({readable(said[0])}); "
            f"copy it again, or export it as {_PLAIN[foreign.kind]}"
        )
    return done.stdout


def _columns(ply: bytes, foreign: Foreign, path: Path) -> tuple[Columns, dict[str, tuple[str, ...]]]:
    """The arrays in the PLY that the reader made; InputError if they are not what the header announced."""
    expected = foreign.header
    names = standard_columns(expected.sh_degree)
    if not expected.num_gaussians:
        return {key: np.empty((0, len(wanted)), np.float32) for key, wanted in names.items()}, names
    stream = io.BytesIO(ply)
    header = read_header(stream, path)
    layout = frame_layout(header, InputPolicy(drop_extra=True), path)
    if header.vertex.count != expected.num_gaussians or layout.sh_degree != expected.sh_degree:
        raise InputError(
            f"{path}: {_WHAT[foreign.kind]} of {expected.num_gaussians} Gaussians and "
            f"SH degree {expected.sh_degree}, of which the reader finds {header.vertex.count} and "
            f"{layout.sh_degree}; export it as PLY"
        )
    columns, _ = read_columns(stream, header, layout, path, trailing=True)
    columns.pop("normals", None)
    return columns, names


def _turn(columns: Columns) -> None:
    columns["positions"][:, 1:] *= -1
    columns["rotations"][:, 2:] *= -1
    num_rest = columns["sh_rest"].shape[1] // 3
    columns["sh_rest"] *= np.tile(np.array(_SH_SIGNS[:num_rest], np.float32), 3)

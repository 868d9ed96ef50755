"""Compressed PLYs (PlayCanvas): which they are, and one spelling for the reader.

Elements: chunk (bounds of 256 Gaussians each), vertex (four packed words) and, from SH degree 1, sh (bytes).
Files of 2023 and 2024 have no bounds of colours; theirs are 0 and 1. The reader knows the later kind alone,
and takes rows for what it expects without a look at their names: so names and types are compared here.
"""

from __future__ import annotations

from pathlib import Path
from typing import BinaryIO

import numpy as np

from dfcgs_codec.errors import InputError
from dfcgs_codec.gaussians import SH_REST_COEFFICIENTS
from dfcgs_codec.ply.body import ends_early, least_bytes
from dfcgs_codec.ply.header import Element, Header, read_header

_CHUNK = 256
_GEOMETRY = tuple(
    f"{end}_{kind}{axis}" for kind in ("", "scale_") for end in ("min", "max") for axis in ("x", "y", "z")
)
_COLOURS = ("min_r", "min_g", "min_b", "max_r", "max_g", "max_b")
_WORDS = ("packed_position", "packed_rotation", "packed_scale", "packed_color")
_REFUSED = "a compressed PLY (packed_position) {what}; export it as an uncompressed PLY"


def is_compressed_ply(header: Header) -> bool:
    """Whether a PLY holds packed integers in place of Gaussians."""
    return any(p.name == "packed_position" for p in header.vertex.properties)


def other_elements(header: Header) -> list[str]:
    """Elements with rows that are no part of a frame."""
    return [f"element {e.name}" for e in header.elements[_num_elements(header) :] if e.count]


def sh_degree(header: Header, size: int, path: Path) -> int:
    """Of a file of `size` bytes; InputError unless the header is that of a whole compressed PLY."""
    problem = _problem(header)
    if problem:
        raise InputError(f"{path}: {_REFUSED.format(what=problem)}")
    missing = least_bytes(header) - (size - header.body_start)
    if missing > 0:
        raise ends_early(path, header.vertex.count, missing)
    return SH_REST_COEFFICIENTS.index(_num_rest(header) // 3)


def canonical(file: BinaryIO, path: Path) -> bytes:
    """The open file in the later spelling, without comments and other elements."""
    file.seek(0)
    header = read_header(file, path)
    chunk, vertex = header.elements[:2]
    bounds = np.zeros((chunk.count, len(_GEOMETRY) + len(_COLOURS)), "<f4")
    bounds[:, len(_GEOMETRY) + 3 :] = 1
    rest = _num_rest(header)
    size = chunk.count * chunk.row_bytes + vertex.count * (vertex.row_bytes + rest)
    body = file.read(size)
    if len(body) < size:
        raise ends_early(path, vertex.count, size - len(body))
    found = np.frombuffer(body, "<f4", chunk.count * len(chunk.properties))
    bounds[:, : len(chunk.properties)] = found.reshape(chunk.count, len(chunk.properties))
    return _header(chunk.count, vertex.count, rest) + bounds.tobytes() + body[chunk.count * chunk.row_bytes :]


def _num_elements(header: Header) -> int:
    return 3 if len(header.elements) > 2 and header.elements[2].name == "sh" else 2


def _num_rest(header: Header) -> int:
    return len(header.elements[2].properties) if _num_elements(header) == 3 else 0


def _problem(header: Header) -> str | None:
    names = [e.name for e in header.elements[: _num_elements(header)]]
    if names[:2] != ["chunk", "vertex"] or header.byte_order != "<":
        return "with other elements than chunk, vertex and sh, in this order, little-endian"
    chunk, vertex = header.elements[:2]
    if not (_is(chunk, _GEOMETRY, "f4") or _is(chunk, (*_GEOMETRY, *_COLOURS), "f4")):
        return "with other bounds in element chunk"
    rest = _num_rest(header)
    sh_right = not rest or (
        _is(header.elements[2], tuple(f"f_rest_{i}" for i in range(rest)), "u1")
        and header.elements[2].count == vertex.count
    )
    if not _is(vertex, _WORDS, "u4") or not sh_right or rest not in [3 * k for k in SH_REST_COEFFICIENTS]:
        return "with other words or SH coefficients than are known"
    if chunk.count != -(-vertex.count // _CHUNK):
        return f"of {vertex.count} Gaussians in {chunk.count} chunks, expected one for {_CHUNK} each"
    return None


def _is(element: Element, names: tuple[str, ...], kind: str) -> bool:
    found = tuple((p.name, p.kind, p.length_kind) for p in element.properties)
    return found == tuple((name, kind, "") for name in names)


def _header(num_chunks: int, count: int, rest: int) -> bytes:
    lines = ["ply", "format binary_little_endian 1.0", f"element chunk {num_chunks}"]
    lines += [f"property float {name}" for name in (*_GEOMETRY, *_COLOURS)] + [f"element vertex {count}"]
    lines += [f"property uint {name}" for name in _WORDS]
    if rest:
        lines += [f"element sh {count}", *(f"property uchar f_rest_{i}" for i in range(rest))]
    return "\n".join([*lines, "end_header", ""]).encode()

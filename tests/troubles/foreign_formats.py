"""Writers of other splat formats, made from their public descriptions and from nothing else here.

Each takes columns named as in a 3DGS PLY (positions, log-scales, logits, SH) and returns a file's bytes. They
are the second opinion on the reader that the codec uses: writing and reading with one library proves little.
"""

from __future__ import annotations

import gzip
import struct
from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from dfcgs_codec.array_types import Float64, UInt8, UInt32

Columns = Mapping[str, npt.NDArray]
SH_C0 = 0.28209479177387814
_CHUNK = 256


def _stack(columns: Columns, *names: str) -> Float64:
    return np.stack([np.asarray(columns[name], np.float64) for name in names], axis=1)


def _bytes(values: npt.NDArray) -> UInt8:
    return np.clip(np.round(values), 0, 255).astype(np.uint8)


def _colours(columns: Columns) -> Float64:
    return 0.5 + SH_C0 * _stack(columns, "f_dc_0", "f_dc_1", "f_dc_2")


def _alphas(columns: Columns) -> Float64:
    return 1 / (1 + np.exp(-np.asarray(columns["opacity"], np.float64)))


def _quaternions(columns: Columns) -> Float64:
    """w, x, y, z of unit length."""
    q = _stack(columns, "rot_0", "rot_1", "rot_2", "rot_3")
    return q / np.linalg.norm(q, axis=1, keepdims=True)


def splat(columns: Columns) -> bytes:
    """`.splat`: 32 bytes each: float32 position, float32 scale, RGBA and w, x, y, z in 8 bits."""
    table = np.zeros(len(columns["x"]), [("p", "<f4", 3), ("s", "<f4", 3), ("c", "u1", 4), ("q", "u1", 4)])
    table["p"] = _stack(columns, "x", "y", "z")
    table["s"] = np.exp(_stack(columns, "scale_0", "scale_1", "scale_2"))
    table["c"] = _bytes(255 * np.concatenate([_colours(columns), _alphas(columns)[:, None]], axis=1))
    table["q"] = _bytes(128 * _quaternions(columns) + 128)
    return table.tobytes()


def _sh(columns: Columns) -> Float64:
    """(N, K, 3): coefficient, then channel."""
    count = sum(name.startswith("f_rest_") for name in columns)
    rest = [columns[f"f_rest_{i}"] for i in range(count)]
    n = len(columns["x"])
    values = np.stack(rest, axis=1) if count else np.zeros((n, 0))
    return values.astype(np.float64).reshape(n, 3, count // 3).transpose(0, 2, 1)


def _smallest_three_spz(q: Float64) -> bytes:
    """x, y, z, w; index of the largest in 2 bits, the others as sign and 9 bits of magnitude."""
    out = np.zeros(len(q), "<u4")
    for row, value in enumerate(q):
        largest = int(np.abs(value).argmax())
        value = value * np.sign(value[largest])
        word = largest
        for i in range(4):
            if i != largest:
                magnitude = int(511 * abs(value[i]) / np.sqrt(0.5) + 0.5)
                word = word << 10 | (value[i] < 0) << 9 | magnitude
        out[row] = word
    return out.tobytes()


def spz(columns: Columns, version: int = 2, *, fraction_bits: int = 12, flags: int = 0) -> bytes:
    """`.spz` version 2 (first three components of the rotation) or 3 (smallest three): a gzip of columns."""
    n = len(columns["x"])
    sh = _sh(columns)
    degree = (0, 3, 8, 15).index(sh.shape[1])
    fixed = np.round(_stack(columns, "x", "y", "z") * 2**fraction_bits).astype("<i4")
    positions = fixed.view(np.uint8).reshape(n, 3, 4)[:, :, :3]
    q = _quaternions(columns)[:, [1, 2, 3, 0]]
    if version == 2:
        rotations = _bytes(127.5 * q[:, :3] * np.sign(q[:, 3:]) + 127.5).tobytes()
    else:
        rotations = _smallest_three_spz(q)
    body = struct.pack("<4sIIBBBB", b"NGSP", version, n, degree, fraction_bits, flags, 0)
    body += positions.tobytes() + _bytes(255 * _alphas(columns)).tobytes()
    dc = _stack(columns, "f_dc_0", "f_dc_1", "f_dc_2")
    body += _bytes(255 * (0.15 * dc + 0.5)).tobytes()
    body += _bytes(16 * (_stack(columns, "scale_0", "scale_1", "scale_2") + 10)).tobytes()
    return gzip.compress(body + rotations + _bytes(128 * sh + 128).tobytes())


def _packed(values: Float64, bits: tuple[int, ...]) -> UInt32:
    """Values from 0 to 1 as one word, the first in the highest bits."""
    word = np.zeros(len(values), np.uint64)
    for column, width in zip(values.T, bits, strict=True):
        top = 2**width - 1
        word = word << np.uint64(width) | np.clip(np.floor(column * top + 0.5), 0, top).astype(np.uint64)
    return word.astype(np.uint32)


def _within_chunks(values: Float64) -> tuple[npt.NDArray, npt.NDArray, npt.NDArray]:
    """Values scaled to 0..1 within each chunk of 256, and each chunk's least and most."""
    if not len(values):
        return values, values, values
    starts = np.arange(0, len(values), _CHUNK)
    low, high = np.minimum.reduceat(values, starts), np.maximum.reduceat(values, starts)
    chunk = np.arange(len(values)) // _CHUNK
    return (values - low[chunk]) / np.maximum(high - low, 1e-30)[chunk], low, high


def compressed_ply(columns: Columns, *, colour_bounds: bool = True) -> bytes:
    """PlayCanvas' compressed PLY: chunks of 256 with their bounds, four words each, SH in 8 bits.

    Without `colour_bounds` as until 2024: colours are from 0 to 1.
    """
    n = len(columns["x"])
    positions, *position_bounds = _within_chunks(_stack(columns, "x", "y", "z"))
    scales, *scale_bounds = _within_chunks(_stack(columns, "scale_0", "scale_1", "scale_2"))
    colours, *bounds_of_colours = _within_chunks(_colours(columns))
    if not colour_bounds:
        colours, bounds_of_colours = _colours(columns), []
    q = _quaternions(columns)
    largest = np.abs(q).argmax(axis=1)
    q = q * np.sign(np.take_along_axis(q, largest[:, None], axis=1))
    others = q[np.arange(4) != largest[:, None]].reshape(-1, 3)
    rotation = _packed(others * np.sqrt(0.5) + 0.5, (10, 10, 10)) | largest.astype(np.uint32) << np.uint32(30)
    colour = _packed(np.concatenate([colours, _alphas(columns)[:, None]], axis=1), (8, 8, 8, 8))
    words = [_packed(positions, (11, 10, 11)), rotation, _packed(scales, (11, 10, 11)), colour]
    sh = _sh(columns)
    sh = sh.transpose(0, 2, 1).reshape(n, 3 * sh.shape[1])
    bounds = np.concatenate([*position_bounds, *scale_bounds, *bounds_of_colours], axis=1)
    header = ["ply", "format binary_little_endian 1.0", f"element chunk {len(bounds)}"]
    for kind, axes in (("", "xyz"), ("scale_", "xyz"), ("", "rgb"))[: 3 if colour_bounds else 2]:
        header += [f"property float {end}_{kind}{axis}" for end in ("min", "max") for axis in axes]
    header += [f"element vertex {n}"]
    header += [f"property uint packed_{name}" for name in ("position", "rotation", "scale", "color")]
    if sh.shape[1]:
        header += [f"element sh {n}", *(f"property uchar f_rest_{i}" for i in range(sh.shape[1]))]
    body = bounds.astype("<f4").tobytes() + np.stack(words, axis=1).astype("<u4").tobytes()
    coded = np.clip(np.trunc((sh / 8 + 0.5) * 256), 0, 255).astype(np.uint8)
    return "\n".join([*header, "end_header", ""]).encode() + body + coded.tobytes()

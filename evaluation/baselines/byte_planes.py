"""Integers as byte planes for a general-purpose compressor: zigzag, column by column, low bytes first."""

from __future__ import annotations

import numpy as np

from dfcgs_codec.array_types import Int64


def pack(values: Int64) -> bytes:
    """Byte planes of integers (N, C); all columns are as wide as the largest value needs, at least a byte."""
    zigzag = ((values << 1) ^ (values >> 63)).astype(np.uint64)
    width = max(1, -(-int(zigzag.max(initial=0)).bit_length() // 8))
    planes = [
        (zigzag[:, c] >> np.uint64(8 * b) & np.uint64(0xFF)).astype(np.uint8).tobytes()
        for c in range(values.shape[1])
        for b in range(width)
    ]
    return b"".join(planes)


def unpack(data: bytes, count: int, columns: int) -> Int64:
    """Integers (`count`, `columns`) of `pack`; the width follows from the length."""
    planes = np.frombuffer(data, np.uint8).reshape(columns, -1, count)
    zigzag = np.zeros((columns, count), np.uint64)
    for b in range(planes.shape[1]):
        zigzag |= planes[:, b].astype(np.uint64) << np.uint64(8 * b)
    values = (zigzag >> np.uint64(1)).astype(np.int64) ^ -(zigzag & np.uint64(1)).astype(np.int64)
    return np.ascontiguousarray(values.T)

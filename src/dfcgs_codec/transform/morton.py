"""Morton keys and the canonical order of an I-frame (spec section 9.1)."""

from __future__ import annotations

import numpy as np

from dfcgs_codec.array_types import Int64

_SPREAD_STEPS = (
    (32, 0x001F00000000FFFF),
    (16, 0x001F0000FF0000FF),
    (8, 0x100F00F00F00F00F),
    (4, 0x10C30C30C30C30C3),
    (2, 0x1249249249249249),
)
_COMPACT_STEPS = (
    (2, 0x10C30C30C30C30C3),
    (4, 0x100F00F00F00F00F),
    (8, 0x001F0000FF0000FF),
    (16, 0x001F00000000FFFF),
    (32, 0x00000000001FFFFF),
)


def morton_keys(cells: Int64) -> Int64:
    """63-bit keys of `cells` (N, 3), 0 <= cell < 2**21; bit triples x, y, z from the top."""
    key = np.zeros(len(cells), np.int64)
    for axis in range(3):
        spread = cells[:, axis].copy()
        for shift, mask in _SPREAD_STEPS:
            spread = (spread | spread << shift) & mask
        key |= spread << (2 - axis)
    return key


def morton_cells(keys: Int64) -> Int64:
    """Cells (N, 3) of 63-bit `keys`; inverse of `morton_keys`."""
    cells = np.empty((len(keys), 3), np.int64)
    for axis in range(3):
        compact = keys >> (2 - axis) & 0x1249249249249249
        for shift, mask in _COMPACT_STEPS:
            compact = (compact | compact >> shift) & mask
        cells[:, axis] = compact
    return cells


def canonical_order(keys: Int64, positions: Int64) -> Int64:
    """Indices that sort by key, ties by x, y, z of `positions` (N, 3), then by index."""
    order = np.argsort(keys, kind="stable")
    ordered = keys[order]
    ties = np.flatnonzero(ordered[1:] == ordered[:-1])
    if not len(ties):
        return order
    tied = np.zeros(len(keys), bool)
    tied[ties] = tied[ties + 1] = True
    rows = order[tied]
    # np.lexsort is stable and sorts by its last key first
    x, y, z = positions[rows].T
    order[tied] = rows[np.lexsort((rows, z, y, x, keys[rows]))]
    return order

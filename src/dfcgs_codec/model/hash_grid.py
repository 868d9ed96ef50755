"""Features of places on a multi-resolution hash grid, read by trilinear interpolation (spec annex B.4).

Equation of the paper: context = MLP(union over l of Interp(mu, G^l)); here the interpolation.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dfcgs_codec.array_types import Int8, Int64
from dfcgs_codec.model.layers import LayerError
from dfcgs_codec.transform.normalisation import NORMAL_BITS

NUM_LEVELS = 6
#: rows of each level's table
TABLE_SIZE = 4096
NUM_FEATURES = 4
#: log2 of the cells along each axis of the coarsest level; each further one has twice as many
BASE_LOG2 = 2
#: weights of a corner along an axis sum to 2**8
_WEIGHT_BITS = 8
#: features have 6 fraction bits in the table and 12 when read
_OUTPUT_SHIFT = 3 * _WEIGHT_BITS - 6
_PRIMES = (1, 2654435761, 805459861)


def _corner_rows(corners: Int64, level_log2: int) -> Int64:
    """Table rows of corner coordinates (3, N): dense where the level fits the table, hashed elsewhere."""
    side = (1 << level_log2) + 1
    x, y, z = corners
    if side**3 <= TABLE_SIZE:
        dense: Int64 = x + side * (y + side * z)
        return dense
    hashed: Int64 = (x * _PRIMES[0]) ^ (y * _PRIMES[1]) ^ (z * _PRIMES[2])
    return hashed & (TABLE_SIZE - 1)


@dataclass(frozen=True)
class HashGrid:
    """The `table` int8 (levels, rows, features)."""

    table: Int8

    def __post_init__(self) -> None:
        if self.table.shape != (NUM_LEVELS, TABLE_SIZE, NUM_FEATURES) or self.table.dtype != np.int8:
            raise LayerError("the hash grid has another shape or type than the format's")

    def read(self, normal: Int64) -> Int64:
        """Features (N, 24), 12 fraction bits, at normalised positions (N, 3)."""
        one = 1 << NORMAL_BITS
        places = (np.clip(normal, -one, one - 1) + one).T
        found = [self._level(places, level) for level in range(NUM_LEVELS)]
        return np.concatenate(found, axis=1)

    def _level(self, places: Int64, level: int) -> Int64:
        """Features (N, 4) of one level; `places` (3, N) in 0 .. 2**16 - 1."""
        log2 = BASE_LOG2 + level
        cells = places >> (NORMAL_BITS + 1 - log2)
        within = (places >> (NORMAL_BITS + 1 - log2 - _WEIGHT_BITS)) & ((1 << _WEIGHT_BITS) - 1)
        beyond = (1 << _WEIGHT_BITS) - within
        table = self.table[level].astype(np.int64)
        total = np.zeros((places.shape[1], NUM_FEATURES), np.int64)
        for corner in range(1 << 3):
            offsets = [corner >> axis & 1 for axis in range(3)]
            x, y, z = (within[a] if o else beyond[a] for a, o in enumerate(offsets))
            rows = _corner_rows(cells + np.array(offsets, np.int64)[:, None], log2)
            total += table[rows] * (x * y * z)[:, None]
        return total >> _OUTPUT_SHIFT

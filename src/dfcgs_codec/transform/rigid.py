"""Rigid motion about control points, in integers held in float64 (spec section 14.4).

A product of what is held here stays below 2**53, so that sums are exact in any order.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dfcgs_codec.array_types import Float64, Int64
from dfcgs_codec.bitstream.constants import ROTATION_FRACTION_BITS
from dfcgs_codec.transform.rotation import from_stereo

MATRIX_FRACTION_BITS = 20
_MATRIX_ONE = float(1 << MATRIX_FRACTION_BITS)
#: two quaternion components of Q1.24 make Q2.48, doubled; down to Q20
_ENTRY_SHIFT = 2 * ROTATION_FRACTION_BITS - 1 - MATRIX_FRACTION_BITS


def _turn_matrices(quaternions: Int64) -> Int64:
    """Rotation matrices less identity, (9, n), Q20, of Q1.24 quaternions (n, 4)."""
    w, x, y, z = quaternions.T
    entries = (
        -(y * y + z * z),
        x * y - w * z,
        x * z + w * y,
        x * y + w * z,
        -(x * x + z * z),
        y * z - w * x,
        x * z - w * y,
        y * z + w * x,
        -(x * x + y * y),
    )
    return (np.stack(entries) + (1 << (_ENTRY_SHIFT - 1))) >> _ENTRY_SHIFT


@dataclass(frozen=True)
class RigidMotion:
    """Motion of n control points: about `pivots`, `translations` (n, 3), turns as `vectors` (n, 3), Q0.18.

    All int64; positions in grid units within +-2**29, translations within +-2**30.
    """

    pivots: Int64
    translations: Int64
    vectors: Int64

    def quaternions(self) -> Int64:
        """The turns as Q1.24 quaternions (n, 4)."""
        return from_stereo(self.vectors)

    def table(self) -> Float64:
        """(12, n): for each axis the matrix row and what is added, so that motion = row . x + added, Q20."""
        turns = _turn_matrices(self.quaternions())
        table = np.empty((12, len(self.pivots)), np.float64)
        for axis in range(3):
            row = turns[3 * axis : 3 * axis + 3]
            table[4 * axis : 4 * axis + 3] = row
            moved = (row * self.pivots.T).sum(axis=0)
            table[4 * axis + 3] = (self.translations[:, axis] << MATRIX_FRACTION_BITS) - moved
        return table


def displacements(table: Float64, ranks: Int64, positions: Float64) -> Float64:
    """Displacements (3, N), integers, of `positions` (3, N) under the motions `ranks` (N,) of a `table`."""
    rows = table.take(ranks, axis=1)
    result = np.empty_like(positions)
    for axis in range(3):
        total = rows[4 * axis + 3]
        for column in range(3):
            product = rows[4 * axis + column]
            product *= positions[column]
            total += product
        total += _MATRIX_ONE / 2
        total *= 1.0 / _MATRIX_ONE
        np.floor(total, out=result[axis])
    return result

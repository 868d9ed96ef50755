"""Quaternions as bins of three components; the fourth, a large one, follows from unit length.

Which component is left out is chosen at the I-frame (the largest) and kept while it stays above
KEPT_ABOVE, so that the bins of the others are comparable from frame to frame. The sign is chosen to make
it positive: q and -q get the same bins.
"""

from __future__ import annotations

import numpy as np

from dfcgs_codec.array_types import Float64, Int64

#: below half, the least that the largest component can be, so that a choice does not flicker
KEPT_ABOVE = 0.4
#: the components other than 0, 1, 2, 3
_OTHERS = np.array([[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]])


def largest(quaternions: Float64) -> Int64:
    """Index (N,) of the largest component of each of `quaternions` (N, 4)."""
    return np.abs(quaternions).argmax(axis=1)


def kept(quaternions: Float64, left_out: Int64) -> Int64:
    """`left_out` (N,) of the previous frame where it still serves, else the largest."""
    component = np.abs(quaternions[np.arange(len(left_out)), left_out])
    return np.where(component >= KEPT_ABOVE, left_out, largest(quaternions))


def to_bins(quaternions: Float64, left_out: Int64, step: float) -> Int64:
    """Bins (N, 3) of unit `quaternions` (N, 4) in multiples of `step`."""
    rows = np.arange(len(left_out))
    sign = np.where(quaternions[rows, left_out] < 0, -1.0, 1.0)
    three = quaternions[rows[:, None], _OTHERS[left_out]] * sign[:, None]
    return np.rint(three / step).astype(np.int64)


def from_bins(bins: Int64, left_out: Int64, step: float) -> Float64:
    """Unit quaternions (N, 4) of `bins` (N, 3)."""
    rows = np.arange(len(left_out))
    three = bins * step
    quaternions = np.empty((len(bins), 4))
    quaternions[rows[:, None], _OTHERS[left_out]] = three
    quaternions[rows, left_out] = np.sqrt(np.maximum(1.0 - (three * three).sum(axis=1), 0.0))
    # only where rounding led beyond unit length does this change anything
    return quaternions / np.sqrt((quaternions * quaternions).sum(axis=1, keepdims=True))

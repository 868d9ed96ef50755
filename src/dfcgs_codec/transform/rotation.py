"""Rotations in fixed point: stereographic vectors and unit quaternions (spec sections 8.2, 9.4).

A quaternion (w, x, y, z) with w >= 0 has the stereographic vector p = (x, y, z) / (1 + w) with
|p| <= 1. Back: w = (1 - p.p) / (1 + p.p), (x, y, z) = 2 p / (1 + p.p); rational, so integers do it
exactly, and a step of p is worth 2 to 4 radians per unit everywhere: no singularity.
"""

from __future__ import annotations

import numpy as np

from dfcgs_codec.array_types import Float32, Float64, Int64
from dfcgs_codec.bitstream.constants import ROTATION_FRACTION_BITS, STEREO_FRACTION_BITS

ONE = 1 << ROTATION_FRACTION_BITS
STEREO_ONE = 1 << STEREO_FRACTION_BITS

_EXACT = 1 << 53
#: axis flips (spec section 9.4): right-multiplying by 1, i, j, k leaves the Gaussian as it was
CELLS = np.eye(4, dtype=np.int64)


def round_divide(numerator: Int64, denominator: Int64 | int) -> Int64:
    """Quotient rounded to nearest, halves up; the denominator is positive."""
    doubled = 2 * numerator + denominator
    if isinstance(denominator, int) or not doubled.size:
        return doubled // (2 * denominator)
    if max(int(doubled.max()), -int(doubled.min())) < _EXACT:
        # twice as fast, and exact: no quotient of integers below 2**53 rounds up to an integer
        quotient = doubled / (2 * denominator)
        return np.floor(quotient, out=quotient).astype(np.int64)
    return doubled // (2 * denominator)


def _squared_length(vectors: Int64) -> Int64:
    # column by column: numpy's sum over a short last axis is several times slower
    total = vectors[:, 0] * vectors[:, 0]
    for column in range(1, vectors.shape[1]):
        total += vectors[:, column] * vectors[:, column]
    return total


def from_stereo(vectors: Int64) -> Int64:
    """Unit quaternions (N, 4), Q1.24, of stereographic `vectors` (N, 3), Q0.18, clipped to +-1."""
    p = np.clip(vectors, -STEREO_ONE, STEREO_ONE)
    squared = _squared_length(p)
    one = STEREO_ONE * STEREO_ONE
    denominator = one + squared
    quaternions = np.empty((len(p), 4), np.int64)
    quaternions[:, 0] = round_divide((one - squared) << ROTATION_FRACTION_BITS, denominator)
    scaled = p << (ROTATION_FRACTION_BITS + STEREO_FRACTION_BITS + 1)
    quaternions[:, 1:] = round_divide(scaled, denominator[:, None])
    return quaternions


def to_stereo(quaternions: Float64) -> Float64:
    """Stereographic vectors (N, 3), |p| <= 1, of unit quaternions (N, 4) of either sign; analysis only."""
    q = np.where(quaternions[:, :1] < 0, -quaternions, quaternions)
    vectors: Float64 = q[:, 1:] / (1.0 + q[:, :1])
    return vectors


#: rows of a Hamilton product: whether to subtract, component of the left factor and of the right one
_HAMILTON = (
    ((False, 0, 0), (True, 1, 1), (True, 2, 2), (True, 3, 3)),
    ((False, 0, 1), (False, 1, 0), (False, 2, 3), (True, 3, 2)),
    ((False, 0, 2), (True, 1, 3), (False, 2, 0), (False, 3, 1)),
    ((False, 0, 3), (False, 1, 2), (True, 2, 1), (False, 3, 0)),
)


def multiply(a: Int64, b: Int64) -> Int64:
    """Hamilton product of Q1.24 quaternions (N, 4), rounded to Q1.24."""
    # component by component in place: arrays that lie together are read several times faster
    left, right = np.ascontiguousarray(a.T), np.ascontiguousarray(b.T)
    count = max(left.shape[1], right.shape[1])
    product, term = np.full((4, count), ONE >> 1, np.int64), np.empty(count, np.int64)
    for total, terms in zip(product, _HAMILTON, strict=True):
        for is_negative, i, j in terms:
            np.multiply(left[i], right[j], out=term)
            (np.subtract if is_negative else np.add)(total, term, out=total)
    product >>= ROTATION_FRACTION_BITS
    return np.ascontiguousarray(product.T)


def normalise(quaternions: Int64) -> Int64:
    """Scale Q1.24 quaternions (N, 4), not zero, back to length 1."""
    squared = _squared_length(quaternions)
    # exact: the square root of an integer below 2**53 is correctly rounded
    length = np.sqrt(squared.astype(np.float64)).astype(np.int64)
    return round_divide(quaternions << ROTATION_FRACTION_BITS, np.maximum(length, 1)[:, None])


def from_float(rotations: Float32) -> Int64:
    """Unit quaternions (N, 4), Q1.24, of float quaternions of any length but zero; integers decide.

    Each row is scaled by a power of two (exact), rounded to integers and normalised.
    """
    wide = rotations.astype(np.float64)
    exponent = np.frexp(np.abs(wide).max(1))[1]
    scaled = np.rint(np.ldexp(wide, (ROTATION_FRACTION_BITS - exponent)[:, None])).astype(np.int64)
    return normalise(scaled)

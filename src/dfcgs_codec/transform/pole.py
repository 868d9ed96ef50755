"""Rotations by a pole and a turn about it: what neighbours say of them (spec section 11.5).

The *pole* of a Gaussian is the axis that differs most from the two others: axis 0 of a needle, axis 2 of a
disc. Axes are lines: q and its products with i, j and k are the same Gaussian. All in integers.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dfcgs_codec.array_types import Bool, Int64
from dfcgs_codec.bitstream.constants import ROTATION_FRACTION_BITS
from dfcgs_codec.transform.rotation import ONE, multiply, normalise, round_divide

#: fraction bits of axes and directions
AXIS_BITS = 15
AXIS_ONE = 1 << AXIS_BITS
_SHIFT = 2 * ROTATION_FRACTION_BITS - AXIS_BITS - 1


def _dot(a: Int64, b: Int64) -> Int64:
    total: Int64 = a[..., 0] * b[..., 0] + a[..., 1] * b[..., 1] + a[..., 2] * b[..., 2]
    return total


def _root(squared: Int64) -> Int64:
    # exact: the square root of an integer below 2**53 is correctly rounded
    return np.sqrt(squared.astype(np.float64)).astype(np.int64)


def axes_of_quaternions(quaternions: Int64) -> Int64:
    """The three axes (N, 3 axes, 3) in Q15 of unit quaternions (N, 4) in Q1.24: columns of their matrices."""
    w, x, y, z = (np.ascontiguousarray(column) for column in quaternions.T)
    half = 1 << (_SHIFT - 1)

    def twice(value: Int64) -> Int64:
        shifted: Int64 = (value + half) >> _SHIFT
        return shifted

    rows = [
        [AXIS_ONE - twice(y * y + z * z), twice(x * y + w * z), twice(x * z - w * y)],
        [twice(x * y - w * z), AXIS_ONE - twice(x * x + z * z), twice(y * z + w * x)],
        [twice(x * z + w * y), twice(y * z - w * x), AXIS_ONE - twice(x * x + y * y)],
    ]
    return np.stack([np.stack(row, axis=1) for row in rows], axis=1)


def _mean_line(lines: Int64, weights: Int64, nearest: Int64) -> Int64:
    """Weighted sum (rows, 3), times 256, of lines (8, rows, 3), each on the side of the nearest one."""
    first = lines[nearest, np.arange(lines.shape[1])]
    signed = np.where(_dot(lines, first[None]) < 0, -weights, weights)
    total: Int64 = (lines * signed[:, :, None]).sum(axis=0)
    return total


@dataclass(frozen=True)
class PolePrediction:
    """Where neighbours let a Gaussian's frame be expected: quaternions (rows, 4), Q1.24.

    `tilt` and `spin` (rows,): how far neighbours are from it, half the square of an angle, Q36.
    """

    frames: Int64
    tilt: Int64
    spin: Int64


def predict_poles(axes: Int64, weights: Int64, is_needle: Bool) -> PolePrediction:
    """From the `axes` (8, rows, 3 axes, 3), Q15, of neighbours, `weights` (8, rows) that sum to 256.

    `is_needle` (rows,): whose pole is axis 0.
    """
    nearest = weights.argmax(axis=0)
    poles = np.where(is_needle[None, :, None], axes[:, :, 0], axes[:, :, 2])
    total = _mean_line(poles, weights, nearest)
    length = _root(_dot(total, total))
    found = length > 0
    safe = np.maximum(length, 1)[:, None]
    axis = np.where(is_needle, 0, 2)
    own = np.zeros_like(total)
    own[np.arange(len(axis)), axis] = AXIS_ONE
    pole = np.where(found[:, None], round_divide(total << AXIS_BITS, safe), own)
    pole = np.where((_dot(pole, own) < 0)[:, None], -pole, pole)
    aligned = (np.abs(_dot(poles, pole[None])) * weights).sum(axis=0)
    tilt = np.maximum((1 << 38) - aligned, 0) >> 2
    tilted = _shortest_turn(pole, is_needle)
    spun, spin = _spin(_mean_line(axes[:, :, 1], weights, nearest) >> 8, tilted, is_needle)
    return PolePrediction(normalise(multiply(tilted, spun)), tilt, spin)


def _shortest_turn(pole: Int64, is_needle: Bool) -> Int64:
    """The shortest turn from the pole's axis to `pole` (rows, 3), on its own side."""
    x, y, z = pole.T
    zero = np.zeros_like(x)
    needle = np.stack([AXIS_ONE + x, zero, -z, y], axis=1)
    disc = np.stack([AXIS_ONE + z, -y, x, zero], axis=1)
    return normalise(np.where(is_needle[:, None], needle, disc) << (ROTATION_FRACTION_BITS - AXIS_BITS))


def _spin(middle: Int64, tilted: Int64, is_needle: Bool) -> tuple[Int64, Int64]:
    """The turn about the pole that brings axis 1 of `tilted` to the line `middle` (rows, 3), Q15."""
    axes = axes_of_quaternions(tilted)
    along = _dot(middle, axes[:, 1]) >> AXIS_BITS
    across = np.where(is_needle, _dot(middle, axes[:, 2]), -_dot(middle, axes[:, 0])) >> AXIS_BITS
    across = np.where(along < 0, -across, across)
    along = np.abs(along)
    length = _root(along * along + across * across)
    turn = np.zeros((len(along), 4), np.int64)
    turn[:, 0] = np.where(length > 0, length + along, AXIS_ONE) << (ROTATION_FRACTION_BITS - AXIS_BITS)
    place = np.where(is_needle, 1, 3)
    turn[np.arange(len(along)), place] = across << (ROTATION_FRACTION_BITS - AXIS_BITS)
    return normalise(turn), np.maximum(AXIS_ONE - length, 0) << (36 - AXIS_BITS)


def rest_frames(count: int) -> Int64:
    """Frames where no neighbours say anything."""
    frames = np.zeros((count, 4), np.int64)
    frames[:, 0] = ONE
    return frames

"""Levels of detail along the Morton order: who predicts whom (spec section 9.2).

With L levels, Gaussians at multiples of 2**L form the base. Level l (L - 1 down to 0) holds the odd
multiples of 2**l; each is predicted from the eight nearest *in order* among the multiples of
2**(l + 1), four on either side, with integer weights that fall with distance and sum to 256.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np

from dfcgs_codec.array_types import Int16, Int32, Int64, Integers
from dfcgs_codec.core import procedures

NUM_NEIGHBOURS = 8
WEIGHT_BITS = 8
MAX_LEVELS = 8
MIN_BASE = 32
#: with neighbours below this, sums of their deviations stay below 2**31
_NARROW = 1 << 21
#: coordinate differences are clipped here, so that squared distances stay exact in float64
_MAX_DIFFERENCE = 1 << 20


@dataclass(frozen=True)
class Level:
    """One level: rows `first::step` of the frame, predicted from rows `::step`.

    `weights` is (8, rows) or (8, 1) int32, summing to 256 over its first axis.
    """

    first: int
    step: int
    weights: Int32

    @property
    def rows(self) -> slice:
        """The Gaussians of the level."""
        return slice(self.first, None, self.step)

    def statistics(self, values: Int64) -> tuple[Int64, Int64]:
        """Weighted mean and mean absolute deviation of the neighbours, both times 256, int64.

        `values` (N,) must hold the coarser levels.
        """
        windows = self._windows(values)
        mean = self._mean(windows)
        rounded = (mean + 128) >> WEIGHT_BITS
        deviation, one = np.zeros_like(mean), np.empty_like(mean)
        for window, weight in zip(windows, self.weights, strict=True):
            np.subtract(window, rounded, out=one)
            np.abs(one, out=one)
            one *= weight
            deviation += one
        return mean.astype(np.int64), deviation.astype(np.int64)

    def mean(self, values: Int64) -> Int64:
        """The first of `statistics` alone."""
        return self._mean(self._windows(values)).astype(np.int64)

    def _windows(self, values: Int64) -> list[Integers]:
        """Neighbour k = 0..7 of each row; in 32 bits, which are several times faster, where that is exact."""
        coarse: Integers = values[:: self.step]
        if len(coarse) and max(int(coarse.max()), -int(coarse.min())) < _NARROW:
            coarse = coarse.astype(np.int32)
        count = len(values[self.rows])
        padded = np.pad(coarse, NUM_NEIGHBOURS // 2, mode="edge")
        return [padded[k + 1 : k + 1 + count] for k in range(NUM_NEIGHBOURS)]

    def _mean(self, windows: list[Integers]) -> Integers:
        mean: Integers = windows[0] * self.weights[0]
        one = np.empty_like(mean)
        for window, weight in zip(windows[1:], self.weights[1:], strict=True):
            mean += np.multiply(window, weight, out=one)
        return mean


@dataclass(frozen=True)
class LevelsOfDetail:
    """All levels of a frame, coarse to fine; `base` are the rows that nothing predicts."""

    base: slice
    levels: tuple[Level, ...]


def num_levels(num_gaussians: int) -> int:
    """L: as many as leave a base of at least 32 Gaussians, at most 8."""
    count = 0
    while count < MAX_LEVELS and num_gaussians >> (count + 1) >= MIN_BASE:
        count += 1
    return count


def _weights(positions: Int64, first: int, step: int) -> Int32:
    """Integer weights (8, rows) from the distances to the neighbours."""
    rows = positions[first::step]
    coarse = np.pad(positions[::step], ((4, 4), (0, 0)), mode="edge")
    inverse = np.empty((NUM_NEIGHBOURS, len(rows)), np.int64)
    for k in range(NUM_NEIGHBOURS):
        difference = np.abs(coarse[k + 1 : k + 1 + len(rows)] - rows)
        np.minimum(difference, _MAX_DIFFERENCE, out=difference)
        squared = (difference * difference).sum(1)
        # exact: the square root of an integer below 2**53 is correctly rounded
        inverse[k] = (1 << 32) // (np.sqrt(squared.astype(np.float64)).astype(np.int64) + 1)
    weights: Int64 = (inverse << WEIGHT_BITS) // inverse.sum(0)
    nearest = inverse.argmax(0)
    weights[nearest, np.arange(len(rows))] += (1 << WEIGHT_BITS) - weights.sum(0)
    return weights.astype(np.int32)


def build_levels(positions: Int64) -> LevelsOfDetail:
    """Levels for `positions` (N, 3) in canonical order, in units of the position step."""
    weights_of = partial(_weights, positions)
    if procedures.is_worth(len(positions)):
        weights_of = partial(_known_weights, procedures.distance_weights(positions))
    count = num_levels(len(positions))
    levels = tuple(
        Level(1 << level, 2 << level, weights_of(1 << level, 2 << level))
        for level in range(count - 1, -1, -1)
    )
    return LevelsOfDetail(slice(0, None, 1 << count), levels)


def _known_weights(weights: Int16, first: int, step: int) -> Int32:
    """Those of one level among `weights` (N, 8), where levels lie behind all rows that predict them."""
    count = len(weights)
    start, rows = len(range(0, count, step)), len(range(first, count, step))
    return np.ascontiguousarray(weights[start : start + rows].T, np.int32)


def order_levels(count: int) -> LevelsOfDetail:
    """Levels for `count` Gaussians whose eight neighbours in order weigh the same."""
    weights = np.full((NUM_NEIGHBOURS, 1), (1 << WEIGHT_BITS) // NUM_NEIGHBOURS, np.int32)
    levels = num_levels(count)
    return LevelsOfDetail(
        slice(0, None, 1 << levels),
        tuple(Level(1 << level, 2 << level, weights) for level in range(levels - 1, -1, -1)),
    )


class GofLevels:
    """Levels of detail for the P-frames of a GoF, from the positions of its I-frame.

    Where all Gaussians take part, neighbours weigh by their distance at the I-frame; where only some do, they
    weigh the same. The distances are looked at when they are first needed.
    """

    def __init__(self, positions: Int64) -> None:
        self._positions = positions
        self._all: LevelsOfDetail | None = None

    def take(self, rows: Int64) -> GofLevels:
        """The same for some of the Gaussians."""
        return GofLevels(self._positions[rows])

    def merge(self, positions: Int64, source: Int64) -> GofLevels:
        """With Gaussians at `positions` more: row i of the result is row source[i] of these and those."""
        return GofLevels(np.concatenate([self._positions, positions])[source])

    def of(self, count: int) -> LevelsOfDetail:
        """Levels for `count` of the Gaussians."""
        if count < len(self._positions):
            return order_levels(count)
        if self._all is None:
            self._all = build_levels(self._positions)
        return self._all


def ladder(activity: Int64, num_steps: int) -> Int64:
    """Half-octave class of integers >= 0 (below 2**53): 0 for 0, else 1 + floor(2 log2), clipped.

    The half octave begins at 181/128, so only exact operations take part.
    """
    mantissa, exponent = np.frexp(activity.astype(np.float64))
    step = 2 * exponent.astype(np.int64) - 1 + (mantissa * 256.0 >= 181.0)
    steps: Int64 = np.minimum(np.where(activity > 0, step, 0), num_steps - 1)
    return steps

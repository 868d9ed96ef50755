"""Frozen probability tables from integers alone (spec section 10).

Every table is a list of 24-bit frequencies for the symbols -K..K of a zero-mean distribution of a
given scale; the two end symbols are escapes. No libm: the two master tables come from big integers
and Decimal, whose results are the same on every machine.
"""

from __future__ import annotations

from decimal import Decimal, localcontext
from enum import IntEnum
from functools import cache

import numpy as np

from dfcgs_codec.array_types import Int64

#: frequencies of a table sum to 2**24
FREQUENCY_BITS = 24
#: distinct scales; sigma = 2**((index - 26) / 6)
NUM_BASE_SCALES = 64
SCALES_PER_OCTAVE = 6
_SCALE_ORIGIN = 26
#: scales from 64 on code the symbol's low bits raw and its high bits with one of the last six tables
NUM_SCALES = 160
#: symbols -K..K, K at most this
_MAX_MAGNITUDE = 511
_MASTER_STEPS = 1024
_CDF_BITS = 32


class Shape(IntEnum):
    """Distribution families."""

    GAUSSIAN = 0
    LAPLACE = 1
    #: half Laplace of half the scale, half Laplace of twice the scale
    HEAVY = 2


NUM_SHAPES = len(Shape)
#: where -K..K ends, in sigmas
_REACH = {Shape.GAUSSIAN: 5.5, Shape.LAPLACE: 8.0, Shape.HEAVY: 12.0}


def split_scale(scale: int) -> tuple[int, int]:
    """Base scale (0 to 63) and number of raw low bits of a scale index (0 to 159)."""
    if scale < NUM_BASE_SCALES:
        return scale, 0
    octave, step = divmod(scale - NUM_BASE_SCALES, SCALES_PER_OCTAVE)
    return NUM_BASE_SCALES - SCALES_PER_OCTAVE + step, octave + 1


@cache
def _inverse_sigmas() -> list[int]:
    """round(2**20 / sigma) for each base scale."""
    with localcontext() as context:
        context.prec = 40
        ratio = Decimal(2).ln() / SCALES_PER_OCTAVE
        return [
            int((Decimal(1 << 20) * (ratio * (_SCALE_ORIGIN - i)).exp()).to_integral_value())
            for i in range(NUM_BASE_SCALES)
        ]


@cache
def _gaussian_master() -> Int64:
    """round(2**32 * Phi(i / 1024)), i = 0..9216: trapezoids with the Euler-Maclaurin correction."""
    one = 1 << 128
    with localcontext() as context:
        context.prec = 60
        step = Decimal(1) / _MASTER_STEPS
        ratio = int((-step * step / 2).exp() * one)
        ratio_step = int((-step * step).exp() * one)
        pi = Decimal("3.14159265358979323846264338327950288419716939937510")
        density = int(one / (2 * pi).sqrt())
    values = [1 << (_CDF_BITS - 1)]
    total = 0
    for i in range(1, 9 * _MASTER_STEPS + 1):
        following = density * ratio >> 128
        ratio = ratio * ratio_step >> 128
        total += density + following
        correction = following * i // (12 * _MASTER_STEPS**3)
        values.append(((one >> 1) + (total >> 11) + correction + (1 << 95)) >> 96)
        density = following
    return np.array(values, np.int64)


@cache
def _exponential_master() -> Int64:
    """round(2**32 * (1 - exp(-i / 1024) / 2)), i = 0..24576."""
    one = 1 << 128
    with localcontext() as context:
        context.prec = 60
        ratio = int((Decimal(-1) / _MASTER_STEPS).exp() * one)
    values = []
    tail = one >> 1
    for _ in range(24 * _MASTER_STEPS + 1):
        values.append((one - tail + (1 << 95)) >> 96)
        tail = tail * ratio >> 128
    return np.array(values, np.int64)


def _interpolate(master: Int64, magnitude: Int64) -> Int64:
    """CDF at `magnitude` / 2**20 >= 0, scaled to 2**32."""
    index = np.minimum(magnitude >> 10, len(master) - 2)
    fraction = np.minimum(magnitude - (index << 10), 1024)
    value: Int64 = master[index] + (((master[index + 1] - master[index]) * fraction) >> 10)
    return value


def _cdf(shape: Shape, scale: int, double_edges: Int64) -> Int64:
    """CDF at `double_edges` / 2 for base scale `scale`, which may lie an octave outside 0..63."""
    octave = max(0, scale - NUM_BASE_SCALES + 1, -scale)
    octave = -(-octave // SCALES_PER_OCTAVE) if octave else 0
    sign = 1 if scale >= 0 else -1
    inverse = _inverse_sigmas()[scale - sign * octave * SCALES_PER_OCTAVE]
    argument = (np.abs(double_edges) * inverse) >> 1
    argument = argument >> octave if sign > 0 else argument << octave
    if shape == Shape.GAUSSIAN:
        value = _interpolate(_gaussian_master(), argument)
    else:  # Laplace: x / b = x * sqrt(2) / sigma; 1482910 = round(2**20 * sqrt(2))
        value = _interpolate(_exponential_master(), (argument * 1482910) >> 20)
    return np.where(double_edges >= 0, value, (1 << _CDF_BITS) - value)


def _magnitude(shape: Shape, scale: int) -> int:
    """K of a base table: `_REACH` sigmas, at least 2 and at most 511."""
    reach = int(_REACH[shape] * 2)
    return min(_MAX_MAGNITUDE, 2 + (reach << 19) // _inverse_sigmas()[scale])


def frequencies_from_cdf(cdf: Int64) -> Int64:
    """Frequencies >= 1 that sum to 2**24, from a rising CDF scaled to 2**32, ends included."""
    count = len(cdf) - 1
    cumulative = ((cdf * ((1 << FREQUENCY_BITS) - count)) >> _CDF_BITS) + np.arange(count + 1)
    cumulative[-1] = 1 << FREQUENCY_BITS
    frequencies: Int64 = np.diff(cumulative)
    return frequencies


@cache
def scale_table(shape: Shape, scale: int) -> Int64:
    """Frequencies of the symbols -K..K of a base scale; the ends are escapes; int64, sum 2**24."""
    k = _magnitude(shape, scale)
    edges = np.arange(-k, k + 2, dtype=np.int64) * 2 - 1
    if shape == Shape.HEAVY:
        narrow = _cdf(Shape.LAPLACE, scale - SCALES_PER_OCTAVE, edges)
        wide = _cdf(Shape.LAPLACE, scale + SCALES_PER_OCTAVE, edges)
        cdf = (narrow + wide) >> 1
    else:
        cdf = _cdf(shape, scale, edges)
    cdf[0], cdf[-1] = 0, 1 << _CDF_BITS
    return frequencies_from_cdf(cdf)


def frequencies_from_weights(weights: Int64) -> Int64:
    """Frequencies >= 1 that sum to 2**24, in proportion to `weights` (not all 0, below 2**31)."""
    cumulative = np.concatenate([np.zeros(1, np.int64), np.cumsum(weights)])
    count = len(weights)
    free = (1 << FREQUENCY_BITS) - count
    frequencies: Int64 = np.diff(cumulative * free // cumulative[-1] + np.arange(count + 1))
    return frequencies


@cache
def split_table(bias: int, count: int) -> Int64:
    """Frequencies of 0..count Gaussians in the lower half of a cell that holds `count`.

    Beta-binomial with alpha = beta = SPLIT_ALPHAS[bias] / 8: small values mean that Gaussians stay
    together. Products of integers only.
    """
    alpha = SPLIT_ALPHAS[bias]
    rising = [1]
    for i in range(count):
        rising.append(rising[-1] * (alpha + 8 * i))
    binomial = [1]
    for i in range(count):
        binomial.append(binomial[-1] * (count - i) // (i + 1))
    weights = [binomial[k] * rising[k] * rising[count - k] for k in range(count + 1)]
    total = sum(weights)
    return frequencies_from_weights(np.array([(w << 30) // total for w in weights], np.int64))


#: alpha * 8 of the split tables
SPLIT_ALPHAS = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64, 96, 128, 256, 1024)
#: cells with more Gaussians are split with scale tables
MAX_SPLIT_COUNT = 32

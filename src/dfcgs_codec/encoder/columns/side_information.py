"""How symbols are best coded: tables, weights and histograms that minimise bits.

Floats are welcome here: whatever is chosen is written to the stream as integers.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import numpy as np

from dfcgs_codec.array_types import Float64, Int64, UInt8
from dfcgs_codec.codec.columns.coder import AnyReal
from dfcgs_codec.codec.columns.side_information import (
    ABSENT_LEVEL,
    EXPECTED_SCALE_RISE,
    WEIGHT_FRACTION_BITS,
)
from dfcgs_codec.entropy.coder import scale_model, split_model
from dfcgs_codec.entropy.tables import (
    NUM_BASE_SCALES,
    NUM_SCALES,
    NUM_SHAPES,
    SCALES_PER_OCTAVE,
    SPLIT_ALPHAS,
    Shape,
)

#: histograms of residuals reach this far on either side
_REACH = 512
#: contexts whose mean magnitude is larger try tables with raw low bits
_WIDE_MEAN = 24.0
#: rows that a least-squares fit looks at
_MAX_FIT_ROWS = 24_000
#: a weight must save this many bits
_WEIGHT_COST = 10.0
#: bits per symbol that neighbours, always the first feature, must save to be worth their time
_NEIGHBOUR_COST = 0.015
_ESCAPE_LENGTH_BITS = 5


@cache
def _code_lengths() -> Float64:
    """Bits of the residuals -512..512 with every base table, escapes included; (3 * 64, 1025)."""
    symbols = np.abs(np.arange(-_REACH, _REACH + 1))
    rows = []
    for shape in Shape:
        for scale in range(NUM_BASE_SCALES):
            lengths = 24.0 - np.log2(scale_model(shape, scale).frequencies)
            k = len(lengths) // 2
            bits = lengths[np.minimum(symbols, k) + k]
            beyond = np.maximum(symbols - k, 0)
            escape = _ESCAPE_LENGTH_BITS + np.floor(np.log2(beyond + 1))
            rows.append(np.where(symbols >= k, bits + escape, bits))
    return np.array(rows)


@cache
def _side_lengths() -> tuple[Float64, Float64]:
    """Bits to signal a scale that differs by -159..159 from the expected, and a shape by -2..2."""
    scales = np.abs(np.arange(1 - NUM_SCALES, NUM_SCALES))
    # a Laplace table of sigma 1, then escapes
    return 1.0 + np.minimum(2.0 * scales, 26 + np.log2(1 + scales)), np.array([9.0, 4.5, 0.25, 4.5, 9.0])


def _beyond_reach(residuals: Int64, contexts: UInt8, num_contexts: int) -> Float64:
    """Bits by which escapes of residuals beyond the histogram exceed those at its end, by context."""
    bits = np.log2(np.maximum(np.abs(residuals) - _REACH, 1))
    return np.asarray(np.bincount(contexts, weights=bits, minlength=num_contexts), np.float64)


def _histogram(residuals: Int64, contexts: UInt8, num_contexts: int) -> Int64:
    cells = contexts.astype(np.int64) * (2 * _REACH + 1) + np.clip(residuals, -_REACH, _REACH) + _REACH
    counts = np.bincount(cells, minlength=num_contexts * (2 * _REACH + 1))
    return counts.reshape(num_contexts, -1)


def table_costs(residuals: Int64, contexts: UInt8, num_contexts: int) -> Float64:
    """Bits of each context's residuals with each table; (contexts, 3, 160), inf where not tried."""
    costs = np.full((num_contexts, NUM_SHAPES, NUM_SCALES), np.inf)
    counts = np.bincount(contexts, minlength=num_contexts)
    used = np.flatnonzero(counts)
    histogram = _histogram(residuals, contexts, num_contexts)[used].astype(np.float64)
    base = (histogram @ _code_lengths().T).reshape(len(used), NUM_SHAPES, NUM_BASE_SCALES)
    far = _beyond_reach(residuals, contexts, num_contexts)[used]
    costs[used, :, :NUM_BASE_SCALES] = base + far[:, None, None]
    sums = np.bincount(contexts, weights=np.abs(residuals), minlength=num_contexts)
    for context in np.flatnonzero(sums > _WIDE_MEAN * np.maximum(counts, 1)).tolist():
        _wide_costs(costs[context], residuals[contexts == context])
    return costs


def _wide_costs(costs: Float64, residuals: Int64) -> None:
    guess = int(np.log2(np.abs(residuals).mean() / _WIDE_MEAN))
    start = NUM_BASE_SCALES - SCALES_PER_OCTAVE
    zeros = np.zeros(len(residuals), np.uint8)
    largest = (NUM_SCALES - NUM_BASE_SCALES) // SCALES_PER_OCTAVE
    for low_bits in range(max(1, guess - 1), min(guess + 3, largest + 1)):
        histogram = _histogram(residuals >> low_bits, zeros, 1).astype(np.float64)
        bits = (histogram @ _code_lengths().T).reshape(NUM_SHAPES, NUM_BASE_SCALES)
        first = NUM_BASE_SCALES + SCALES_PER_OCTAVE * (low_bits - 1)
        far = float(_beyond_reach(residuals >> low_bits, zeros, 1)[0]) + low_bits * len(residuals)
        costs[:, first : first + SCALES_PER_OCTAVE] = bits[:, start:] + far


def fit_tables(residuals: Int64, contexts: UInt8, num_contexts: int) -> Int64:
    """Table of each context (shape * 160 + scale), -1 outside the contexts used.

    Greedy from the first context on: bits of the residuals plus bits to signal the choice.
    """
    tables = np.full(num_contexts, -1, np.int64)
    counts = np.bincount(contexts, minlength=num_contexts)
    used = np.flatnonzero(counts)
    if not len(used):
        tables[0] = Shape.LAPLACE * NUM_SCALES
        return tables
    costs = table_costs(residuals, contexts, num_contexts)
    scale_bits, shape_bits = _side_lengths()
    # the first scale has a table of its own, of sigma 16
    bits = 5.0 + 0.13 * np.abs(np.arange(1 - NUM_SCALES, NUM_SCALES))
    expected, shape = 26, int(Shape.LAPLACE)
    for context in range(int(used[0]), int(used[-1]) + 1):
        expected = min(expected, NUM_SCALES - 1)
        scale = expected
        if counts[context]:
            side = (
                shape_bits[2 - shape : 5 - shape, None]
                + bits[None, NUM_SCALES - 1 - expected :][:, :NUM_SCALES]
            )
            shape, scale = divmod(int((costs[context] + side).argmin()), NUM_SCALES)
        tables[context] = shape * NUM_SCALES + scale
        bits = scale_bits
        expected = scale + EXPECTED_SCALE_RISE
    return tables


def fit_weights(features: Sequence[AnyReal], goal: AnyReal) -> Int64:
    """Q8 weights (len(features),) of the least-squares prediction; those that do not pay are 0."""
    weights = np.zeros(len(features), np.int64)
    stride = max(1, len(goal) // _MAX_FIT_ROWS)
    matrix = np.array([f[::stride] for f in features], np.float64)
    target = goal[::stride].astype(np.float64)
    gram, cross, total = matrix @ matrix.T, matrix @ target, float(target @ target)
    costs = np.full(len(features), _WEIGHT_COST)
    costs[0] = max(_WEIGHT_COST, _NEIGHBOUR_COST * len(goal))
    power = np.diag(gram) / max(len(target), 1)
    alive = np.flatnonzero(power > 0)
    while len(alive):
        part, wanted = gram[np.ix_(alive, alive)], cross[alive]
        solution = np.linalg.solve(part + np.diag(1e-6 * power[alive] * len(target) + 1e-9), wanted)
        left = total - 2 * solution @ wanted + solution @ part @ solution
        remaining = max(float(left), 0.0) / len(target) + 1.0 / 12
        saved = 0.5 * len(goal) * np.log2(1 + solution**2 * power[alive] / remaining)
        keep = saved > costs[alive]
        if keep.all():
            scaled = np.rint(solution * (1 << WEIGHT_FRACTION_BITS))
            weights[alive] = np.clip(scaled, -1024, 1024).astype(np.int64)
            break
        alive = alive[keep]
    return weights


def fit_histogram_levels(symbols: Int64, contexts: UInt8, used: Int64, size: int) -> Int64:
    """Levels (len(used), size): quarter octaves below the most frequent symbol, 63 where absent."""
    cells = contexts.astype(np.int64) * size + symbols
    counts = np.bincount(cells, minlength=(int(used.max()) + 1) * size if len(used) else 0)
    rows = counts.reshape(-1, size)[used]
    top = np.maximum(rows.max(axis=1, keepdims=True), 1)
    with np.errstate(divide="ignore"):
        down = np.rint(4 * np.log2(top / rows))
    return np.where(rows > 0, np.minimum(down, ABSENT_LEVEL - 1), ABSENT_LEVEL).astype(np.int64)


def fit_split_bias(counts: Int64, lower: Int64) -> int:
    """Bias with the fewest bits for cells of `counts` Gaussians, `lower` of which lie in the lower half."""
    bits = np.zeros(len(SPLIT_ALPHAS))
    for count in np.unique(counts).tolist():
        histogram = np.bincount(lower[counts == count], minlength=count + 1)
        for bias in range(len(SPLIT_ALPHAS)):
            bits[bias] -= histogram @ np.log2(split_model(bias, count).frequencies)
    return int(bits.argmin())

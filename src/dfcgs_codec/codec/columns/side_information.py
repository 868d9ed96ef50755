"""How symbols are coded, itself coded: weights, tables, histograms (spec sections 11.2 and 11.3).

In every function the array or record to write is given, or None when reading; it is returned.
"""

from __future__ import annotations

import numpy as np

from dfcgs_codec.array_types import Int64
from dfcgs_codec.entropy.coder import Model, RangeCoder, categorical
from dfcgs_codec.entropy.symbols import code_count, code_residuals
from dfcgs_codec.entropy.tables import (
    NUM_BASE_SCALES,
    NUM_SCALES,
    NUM_SHAPES,
    Shape,
    frequencies_from_weights,
)
from dfcgs_codec.errors import CorruptBitstream

WEIGHT_FRACTION_BITS = 8
_MAX_WEIGHT = 1 << 12
#: histogram levels are quarter octaves below the most frequent symbol; this one means absent
ABSENT_LEVEL = 63
#: round(256 * 2**(i / 4))
_QUARTER_OCTAVES = (256, 304, 362, 431)
#: contexts are half octaves of activity, so the scale is expected to rise by three steps
EXPECTED_SCALE_RISE = 3
_FIRST_SCALE = 26
_SIDE_TABLE_FIRST = Shape.LAPLACE * NUM_SCALES + 50
_SIDE_TABLE_SCALE = Shape.LAPLACE * NUM_SCALES + 26
_SIDE_TABLE_SHAPE = Shape.LAPLACE * NUM_SCALES + 18


def _code_flat(coder: RangeCoder, values: Int64 | None, table: int, count: int) -> Int64:
    return code_residuals(coder, values, np.zeros(count, np.uint8), np.array([table], np.int64))


def code_signed(coder: RangeCoder, value: int | None, limit: int) -> int:
    """One integer of magnitude <= `limit`, zigzag, without a model."""
    zigzag = None if value is None else (value << 1 if value >= 0 else -(value << 1) - 1)
    folded = code_count(coder, zigzag, 2 * limit)
    return folded >> 1 if folded & 1 == 0 else -(folded >> 1) - 1


def _laplace_index(values: Int64) -> int:
    """Base scale whose Laplace table suits `values`; an encoder's choice."""
    scale = 26.0 + 6.0 * np.log2(np.abs(values).mean() * 1.4 + 0.04)
    return int(np.clip(scale, 0, NUM_BASE_SCALES - 1))


def code_weights(coder: RangeCoder, weights: Int64 | None, count: int) -> Int64:
    """Weights, Q8: a table index 0 to 64, then the weights with that Laplace table; 64 means all zero."""
    if not count:
        return np.zeros(0, np.int64)
    index = None
    if weights is not None:
        index = _laplace_index(weights) if weights.any() else NUM_BASE_SCALES
    index = code_count(coder, index, NUM_BASE_SCALES)
    if index == NUM_BASE_SCALES:
        return np.zeros(count, np.int64)
    coded = _code_flat(coder, weights, Shape.LAPLACE * NUM_SCALES + index, count)
    if np.abs(coded).max() > _MAX_WEIGHT:
        raise CorruptBitstream("a prediction weight is out of range")
    return coded


def code_tables(coder: RangeCoder, tables: Int64 | None, num_contexts: int) -> Int64:
    """Tables of the contexts first..last; `tables` holds -1 outside that range."""
    ends: list[int | None] = [None, None]
    if tables is not None:
        known = np.flatnonzero(tables >= 0)
        ends = [int(known[0]), int(known[-1] - known[0])]
    first = code_count(coder, ends[0], num_contexts - 1)
    count = code_count(coder, ends[1], num_contexts - 1 - first) + 1
    part = None if tables is None else tables[first : first + count]
    shapes = None if part is None else np.diff(part // NUM_SCALES, prepend=int(Shape.LAPLACE))
    shapes = np.cumsum(_code_flat(coder, shapes, _SIDE_TABLE_SHAPE, count)) + Shape.LAPLACE
    scales = None if part is None else part % NUM_SCALES
    first_scale = None if scales is None else scales[:1] - _FIRST_SCALE
    rises = None if scales is None else np.diff(scales) - EXPECTED_SCALE_RISE
    start = _code_flat(coder, first_scale, _SIDE_TABLE_FIRST, 1) + _FIRST_SCALE
    steps = _code_flat(coder, rises, _SIDE_TABLE_SCALE, count - 1) + EXPECTED_SCALE_RISE
    coded_scales = np.cumsum(np.concatenate([start, steps]))
    if not _within(shapes, NUM_SHAPES) or not _within(coded_scales, NUM_SCALES):
        raise CorruptBitstream("a table index is out of range")
    result = np.full(num_contexts, _SIDE_TABLE_SCALE, np.int64)
    result[first : first + count] = shapes * NUM_SCALES + coded_scales
    return result


def _within(values: Int64, limit: int) -> bool:
    return bool(values.min() >= 0 and values.max() < limit)


def histogram_models(
    coder: RangeCoder, levels: Int64 | None, used: Int64, num_contexts: int, size: int
) -> list[Model]:
    """Models of the contexts `used` from their coded levels (len(used), size), 0 to 63."""
    count = len(used) * size
    steps = None if levels is None else np.diff(levels.ravel(), prepend=0)
    # neighbouring symbols have similar levels
    table = None if steps is None else _laplace_index(steps)
    table = code_count(coder, table, NUM_BASE_SCALES - 1)
    steps = _code_flat(coder, steps, Shape.LAPLACE * NUM_SCALES + table, count)
    coded = np.cumsum(steps).reshape(len(used), size)
    if not _within(coded, ABSENT_LEVEL + 1):
        raise CorruptBitstream("a histogram level is out of range")
    flat_model = categorical(frequencies_from_weights(np.ones(size, np.int64)))
    models = [flat_model] * num_contexts
    for context, row in zip(used.tolist(), coded, strict=True):
        models[context] = categorical(frequencies_from_levels(row))
    return models


def frequencies_from_levels(levels: Int64) -> Int64:
    """24-bit frequencies of symbols that lie `levels` quarter octaves below the top; 63 is absent."""
    down = (ABSENT_LEVEL - 1) - levels
    quarters = np.array(_QUARTER_OCTAVES, np.int64)[down % 4]
    weights = np.where(levels >= ABSENT_LEVEL, 0, quarters << (down // 4 % 16))
    if not weights.any():
        raise CorruptBitstream("a histogram is empty")
    return frequencies_from_weights(weights)

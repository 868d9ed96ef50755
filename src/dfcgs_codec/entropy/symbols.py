"""Coding arrays of integers with the models of `coder`, written once for both directions.

In every function `values` is the array to encode, or None when decoding; the array is returned.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dfcgs_codec.array_types import Int64, Integers
from dfcgs_codec.entropy.coder import MAX_UNIFORM_BITS, Model, RangeCoder, scale_model, uniform
from dfcgs_codec.entropy.tables import NUM_SCALES, Shape, split_scale
from dfcgs_codec.errors import CorruptBitstream

#: escaped magnitudes have at most this many bits
_MAX_ESCAPE_BITS = 32
#: explicit models are of the symbols -15 to 15
EXPLICIT_REACH = 15


def code_bits(coder: RangeCoder, values: Int64 | None, bits: int, count: int) -> Int64:
    """`count` integers of `bits` equally likely bits (0 to 63), low 16 bits first."""
    result = np.zeros(count, np.int64)
    for shift in range(0, bits, MAX_UNIFORM_BITS):
        width = min(MAX_UNIFORM_BITS, bits - shift)
        part = None if values is None else values >> shift & ((1 << width) - 1)
        result |= coder.code(part, uniform(1 << width), count) << shift
    return result


class Groups:
    """Positions of the symbols of each context, found once and used for each pass over them."""

    def __init__(self, contexts: Integers, num_contexts: int) -> None:
        self.order = np.argsort(contexts.astype(np.uint16), kind="stable")
        counts = np.bincount(contexts, minlength=num_contexts)
        self.bounds = np.concatenate([np.zeros(1, np.int64), np.cumsum(counts)])
        self.used = np.flatnonzero(counts)

    def slices(self) -> list[tuple[int, slice]]:
        """(context, slice of `order`) for each context that occurs, ascending."""
        return [(int(c), slice(int(self.bounds[c]), int(self.bounds[c + 1]))) for c in self.used]


def code_with_models(coder: RangeCoder, values: Int64 | None, groups: Groups, models: list[Model]) -> Int64:
    """Symbols, each with the model of its context, context after context."""
    count = len(groups.order)
    ordered = None if values is None else values[groups.order]
    coded = np.empty(count, np.int64)
    for context, part in groups.slices():
        given = None if ordered is None else ordered[part]
        coded[part] = coder.code(given, models[context], part.stop - part.start)
    result = np.empty(count, np.int64)
    result[groups.order] = coded
    return result


def code_escapes(coder: RangeCoder, values: Int64 | None, count: int) -> Int64:
    """Integers >= 0 without a model: number of bits of value + 1, then the bits below the leading one."""
    if not count:
        return np.zeros(0, np.int64)
    lengths = None if values is None else np.frexp((values + 1).astype(np.float64))[1] - 1
    given = None if lengths is None else lengths.astype(np.int64)
    lengths = coder.code(given, uniform(_MAX_ESCAPE_BITS), count)
    result = np.zeros(count, np.int64)
    for length in np.unique(lengths).tolist():
        rows = np.flatnonzero(lengths == length)
        low = None if values is None else (values[rows] + 1) - (1 << length)
        result[rows] = code_bits(coder, low, length, len(rows)) + (1 << length) - 1
    return result


def code_escaping(
    coder: RangeCoder, values: Int64 | None, groups: Groups, models: list[Model], reach: int
) -> Int64:
    """Signed integers; the models are of -reach..reach, and the ends are escapes, coded behind all."""
    clipped = None if values is None else np.clip(values, -reach, reach) + reach
    coded = code_with_models(coder, clipped, groups, models) - reach
    rows = np.flatnonzero(np.abs(coded) == reach)
    excess = None if values is None else np.abs(values[rows]) - reach
    coded[rows] += np.sign(coded[rows]) * code_escapes(coder, excess, len(rows))
    return coded


@dataclass(frozen=True)
class _Table:
    """A model of -k..k, and how many low bits of a symbol are coded raw."""

    model: Model
    low_bits: int

    @staticmethod
    def of(table: int, explicit: Sequence[Model]) -> _Table:
        if table < 0:
            return _Table(explicit[-1 - table], 0)
        shape, scale = divmod(table, NUM_SCALES)
        base, low_bits = split_scale(scale)
        return _Table(scale_model(Shape(shape), base), low_bits)

    @property
    def k(self) -> int:
        return self.model.size // 2


def code_residuals(
    coder: RangeCoder,
    values: Int64 | None,
    contexts: Integers,
    tables: Int64,
    explicit: Sequence[Model] = (),
) -> Int64:
    """Signed integers, each with the table that `tables` names for its context.

    `tables[c]` = shape * NUM_SCALES + scale, or -1 - i for `explicit[i]`, a model of -k..k. Table symbols
    first, context after context; then the excess of escaped symbols; then the raw low bits of contexts with
    scales above 63.
    """
    groups = Groups(contexts, len(tables))
    known = {int(c): _Table.of(int(tables[c]), explicit) for c in groups.used}
    shifts, ends = np.zeros(len(tables), np.int64), np.zeros(len(tables), np.int64)
    for context, table in known.items():
        shifts[context], ends[context] = table.low_bits, table.k
    sizes = np.diff(groups.bounds)[groups.used]
    reach = np.repeat(ends[groups.used], sizes)
    ordered, given = None, None
    if values is not None:
        ordered = values[groups.order]
        given = (ordered >> np.repeat(shifts[groups.used], sizes)) + reach
        np.minimum(np.maximum(given, 0, out=given), 2 * reach, out=given)
    coded = np.empty(len(groups.order), np.int64)
    for context, part in groups.slices():
        symbols = None if given is None else given[part]
        coded[part] = coder.code(symbols, known[context].model, part.stop - part.start)
    coded -= reach
    rows = np.flatnonzero(np.abs(coded) == reach)
    _code_excess(coder, ordered, coded, rows, (groups, shifts))
    _code_low_bits(coder, ordered, coded, (groups, shifts))
    result = np.empty(len(coded), np.int64)
    result[groups.order] = coded
    return result


def _code_excess(
    coder: RangeCoder, ordered: Int64 | None, coded: Int64, rows: Int64, by_context: tuple[Groups, Int64]
) -> None:
    """Add to the escaped symbols in `coded[rows]` what lies beyond their table."""
    if not len(rows):
        return
    groups, shifts = by_context
    end = coded[rows]
    excess = None
    if ordered is not None:
        of_row = np.repeat(shifts[groups.used], np.diff(groups.bounds)[groups.used])
        excess = np.abs((ordered[rows] >> of_row[rows]) - end)
    coded[rows] = end + np.sign(end) * code_escapes(coder, excess, len(rows))


def _code_low_bits(
    coder: RangeCoder, ordered: Int64 | None, coded: Int64, by_context: tuple[Groups, Int64]
) -> None:
    groups, shifts = by_context
    for context, part in groups.slices():
        low_bits = int(shifts[context])
        if low_bits:
            low = None if ordered is None else ordered[part] & ((1 << low_bits) - 1)
            bits = code_bits(coder, low, low_bits, part.stop - part.start)
            coded[part] = (coded[part] << low_bits) | bits


def code_count(coder: RangeCoder, value: int | None, limit: int) -> int:
    """One integer 0 <= value <= limit without a model; a larger one is corrupt."""
    given = None if value is None else np.array([value], np.int64)
    result = int(code_escapes(coder, given, 1)[0])
    if result > limit:
        raise CorruptBitstream(f"a coded count is {result}, at most {limit} is possible")
    return result

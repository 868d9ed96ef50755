"""A column of integers, coded in passes: each row has its own step (spec section 11.2)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from dfcgs_codec.array_types import Int64, UInt8
from dfcgs_codec.bitstream.constants import STATE_LIMIT
from dfcgs_codec.codec.columns.coder import ColumnFacts, SymbolCoder
from dfcgs_codec.codec.columns.side_information import WEIGHT_FRACTION_BITS
from dfcgs_codec.entropy.symbols import code_residuals
from dfcgs_codec.errors import CorruptBitstream
from dfcgs_codec.transform.lod import Level, LevelsOfDetail, ladder
from dfcgs_codec.transform.rotation import round_divide
from dfcgs_codec.transform.trellis import step_values

#: half octaves of the size expected; the last context belongs to the base level
NUM_CONTEXTS = 32
BASE_CONTEXT = NUM_CONTEXTS - 1
#: sizes are in 1/32 of a symbol
SIZE_BITS = 5
_MEAN_BITS = 8

#: an encoder's choice of the symbols of a pass: from its rows, their predictions, steps and contexts
ChooseSymbols = Callable[[slice, Int64, Int64, UInt8], Int64]
#: the neighbours' mean and deviation (times 256) of the rows of a pass, or None in the base
Statistics = tuple[Int64, Int64] | None


@dataclass(frozen=True)
class ColumnGoal:
    """What an encoder wants a column to be: `values` (N,), and how it chooses symbols."""

    values: Int64
    choose: ChooseSymbols


@dataclass
class Earlier:
    """Residuals of the columns coded before, and their magnitudes; all (N,)."""

    residuals: list[Int64] = field(default_factory=list)
    magnitudes: list[Int64] = field(default_factory=list)

    def add(self, residual: Int64) -> None:
        """Remember a coded column."""
        self.residuals.append(residual)
        self.magnitudes.append(np.abs(residual))


def weighted_sum(features: list[Int64], weights: Int64) -> Int64 | int:
    """Sum of features times Q8 weights; zero weights cost nothing."""
    total: Int64 | None = None
    product: Int64 | None = None
    for feature, weight in zip(features, weights.tolist(), strict=True):
        if not weight:
            continue
        if total is None:
            total = feature * weight
            continue
        product = np.multiply(feature, weight, out=product)
        total += product
    return 0 if total is None else total


def round_weighted(total: Int64, bits: int) -> Int64:
    """`total` / 2**bits rounded to nearest, halves up."""
    return (total + (1 << (bits - 1))) >> bits


@dataclass(frozen=True)
class _Predictor:
    """Center, Q8 weights of the value and of the size: neighbours first, then (size) the step."""

    center: int
    weights: Int64
    size_weights: Int64

    @property
    def is_spatial(self) -> bool:
        """Whether neighbours matter; where they do not, one pass codes all rows."""
        return bool(self.weights[0] or self.size_weights[0])

    def predict(self, found: Statistics, residuals: list[Int64], count: int) -> Int64:
        """Prediction of `count` rows from their neighbours and earlier residuals."""
        total = np.zeros(count, np.int64) + (weighted_sum(residuals, self.weights[1:]) << _MEAN_BITS)
        if found is not None:
            total = total + (found[0] - (self.center << _MEAN_BITS)) * self.weights[0]
        return self.center + round_weighted(total, WEIGHT_FRACTION_BITS + _MEAN_BITS)

    def contexts(self, found: Statistics, magnitudes: list[Int64], steps: Int64) -> UInt8:
        """Half octave of the magnitude that a symbol is expected to have."""
        own = self.size_weights[1] * steps + weighted_sum(magnitudes, self.size_weights[2:])
        total = own << _MEAN_BITS
        if found is not None:
            total = total + found[1] * self.size_weights[0]
        size = (np.maximum(total, 0) >> (WEIGHT_FRACTION_BITS + _MEAN_BITS - SIZE_BITS)) // steps
        return ladder(size, NUM_CONTEXTS - 1).astype(np.uint8)


@dataclass(frozen=True)
class Column:
    """The column's steps (N,), levels of detail, and the columns before it.

    `in_steps`: whether values are multiples of their steps; `alternating`: whether two quantisers take turns.
    """

    steps: Int64
    lod: LevelsOfDetail
    earlier: Earlier = field(default_factory=Earlier)
    in_steps: bool = False
    alternating: bool = False

    def code(self, coder: SymbolCoder, goal: ColumnGoal | None) -> Int64:
        """The column (N,), as decoded; it is added to `earlier`."""
        predictor = self._predictor(coder, goal)
        if goal is not None:
            return self._write(coder, predictor, goal)
        tables = coder.tables(NUM_CONTEXTS, lambda: (np.zeros(0, np.int64), np.zeros(0, np.uint8)))

        def code_rows(_: slice, __: Int64, contexts: UInt8) -> Int64:
            return code_residuals(coder, None, contexts, tables)

        return self._walk(predictor, code_rows)

    def _predictor(self, coder: SymbolCoder, goal: ColumnGoal | None) -> _Predictor:
        def facts() -> ColumnFacts:
            assert goal is not None
            return ColumnFacts(goal.values, self.steps, self.lod, self.earlier.residuals)

        return _Predictor(*coder.predictor(len(self.earlier.residuals), facts))

    def _write(self, coder: SymbolCoder, predictor: _Predictor, goal: ColumnGoal) -> Int64:
        """Choose all symbols, walking the column, then code them: tables come first in the stream."""
        symbols, known = np.zeros(len(self.steps), np.int64), np.zeros(len(self.steps), np.uint8)

        def choose_rows(rows: slice, prediction: Int64, contexts: UInt8) -> Int64:
            known[rows] = contexts
            symbols[rows] = goal.choose(rows, prediction, self.steps[rows], contexts)
            return symbols[rows]

        values = self._walk(predictor, choose_rows)
        tables = coder.tables(NUM_CONTEXTS, lambda: (symbols, known))
        for rows, _ in self._passes(predictor):
            code_residuals(coder, symbols[rows], known[rows], tables)
        return values

    def _passes(self, predictor: _Predictor) -> list[tuple[slice, Level | None]]:
        """Rows of each pass, and their level; the base has none."""
        if not predictor.is_spatial:
            return [(slice(None), None)]
        return [(self.lod.base, None), *((level.rows, level) for level in self.lod.levels)]

    def _walk(self, predictor: _Predictor, code_rows: Callable[[slice, Int64, UInt8], Int64]) -> Int64:
        """The column's values, pass by pass; `code_rows` gives the symbols of a pass. Remembers residuals."""
        values = np.zeros(len(self.steps), np.int64)
        residual = np.zeros(len(self.steps), np.int64)
        residuals, magnitudes = self.earlier.residuals, self.earlier.magnitudes
        for rows, level in self._passes(predictor):
            found = None if level is None else level.statistics(values)
            steps = self.steps[rows]
            prediction = predictor.predict(found, [r[rows] for r in residuals], len(steps))
            if self.in_steps:
                prediction = round_divide(prediction, steps) * steps
            if predictor.is_spatial and level is None:
                contexts = np.full(len(steps), BASE_CONTEXT, np.uint8)
            else:
                contexts = predictor.contexts(found, [m[rows] for m in magnitudes], steps)
            symbols = code_rows(rows, prediction, contexts)
            residual[rows] = scaled_symbols(symbols, steps, alternating=self.alternating)
            values[rows] = prediction + residual[rows]
            if len(steps) and max(values[rows].max(), -values[rows].min()) > STATE_LIMIT:
                raise CorruptBitstream("a reconstructed value leaves the range of the state")
        self.earlier.add(residual)
        return values


def code_integers(coder: SymbolCoder, wanted: Int64 | None, lod: LevelsOfDetail, count: int) -> Int64:
    """A column of `count` integers that come back as they are; `wanted` (count,), None when reading."""
    column = Column(np.ones(count, np.int64), lod)
    if wanted is None:
        return column.code(coder, None)

    def choose(rows: slice, prediction: Int64, _: Int64, __: UInt8) -> Int64:
        return wanted[rows] - prediction

    return column.code(coder, ColumnGoal(wanted, choose))


def code_permutation(coder: SymbolCoder, wanted: Int64 | None, lod: LevelsOfDetail, expected: Int64) -> Int64:
    """Places in the output (N,), as differences from the `expected` ones."""
    given = None if wanted is None else wanted - expected
    places = code_integers(coder, given, lod, len(expected)) + expected
    if not np.array_equal(np.sort(places), np.arange(len(expected))):
        raise CorruptBitstream("the output order is not a permutation")
    return places


def scaled_symbols(symbols: Int64, steps: Int64, *, alternating: bool) -> Int64:
    """What the symbols of a pass (rows,) mean with steps (rows,); refused before they could leave 64 bits."""
    limit = 2 * STATE_LIMIT // steps
    if (symbols < -limit).any() or (symbols > limit).any():
        raise CorruptBitstream("a symbol is too large for its step")
    return step_values(symbols, steps, alternating=alternating)

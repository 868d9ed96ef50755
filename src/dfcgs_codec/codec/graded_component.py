"""One column of a graded I-frame: coded in passes, each Gaussian with its own step (spec section 11.6)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from dfcgs_codec.bitstream.constants import STATE_LIMIT
from dfcgs_codec.codec.component import round_weighted, weighted_sum
from dfcgs_codec.codec.side_information import WEIGHT_FRACTION_BITS
from dfcgs_codec.codec.symbols import AnyReal, Int64, SymbolCoder, UInt8
from dfcgs_codec.entropy.symbols import code_residuals
from dfcgs_codec.errors import CorruptBitstream
from dfcgs_codec.transform.lod import Level, LevelsOfDetail, ladder
from dfcgs_codec.transform.trellis import step_values

#: half octaves of activity; the last context belongs to the base level
NUM_CONTEXTS = 32
BASE_CONTEXT = NUM_CONTEXTS - 1
#: activity is in 1/32 of a symbol
ACTIVITY_BITS = 5
_MEAN_BITS = 8
#: rows that weights are fitted to
_MOST_ROWS = 24_000

#: an encoder's choice of symbols: from what is to be coded less its prediction, the steps and the contexts
Quantise = Callable[[Int64, Int64, UInt8], Int64]
#: rows of a pass, the neighbours' mean and deviation (times 256), or None in the base
Statistics = tuple[Int64, Int64] | None


@dataclass(frozen=True)
class Target:
    """What an encoder wants a column to be, (N,), and how it quantises.

    `least`: no value is decoded to less, in columns that do not alternate.
    """

    values: Int64
    quantise: Quantise
    least: int | None = None

    def symbols(self, rows: slice, prediction: Int64, steps: Int64, contexts: UInt8) -> Int64:
        """What is chosen for a pass."""
        found = self.quantise(self.values[rows] - prediction, steps, contexts)
        if self.least is None:
            return found
        raised: Int64 = np.maximum(found, -((prediction - self.least) // steps))
        return raised


@dataclass
class Earlier:
    """Residuals of the columns coded before, in grid units, and their magnitudes; all (N,).

    `in_steps`: what a writer has seen of both in the `steps` that it had last.
    """

    residuals: list[Int64] = field(default_factory=list)
    magnitudes: list[Int64] = field(default_factory=list)
    in_steps: tuple[list[AnyReal], list[AnyReal]] = field(default_factory=lambda: ([], []))
    steps: Int64 | None = None

    def add(self, residual: Int64) -> None:
        """Remember a coded column."""
        self.residuals.append(residual)
        self.magnitudes.append(np.abs(residual))

    def scaled(self, steps: Int64, part: slice) -> tuple[list[AnyReal], list[AnyReal]]:
        """Residuals and magnitudes of the rows `part`, in `steps` (N,); known ones are not scaled twice."""
        if self.steps is not steps:
            self.in_steps, self.steps = ([], []), steps
        for residual in self.residuals[len(self.in_steps[0]) :]:
            found = residual[part] / steps[part]
            self.in_steps[0].append(found)
            self.in_steps[1].append(np.abs(found))
        return self.in_steps


@dataclass(frozen=True)
class _Predictor:
    """Center, Q8 weights of the value and of the activity: neighbours first, then (activity) the step."""

    center: int
    weights: Int64
    activity_weights: Int64

    @property
    def is_spatial(self) -> bool:
        """Whether neighbours matter; where they do not, one pass codes all Gaussians."""
        return bool(self.weights[0] or self.activity_weights[0])

    def predict(self, found: Statistics, residuals: list[Int64], count: int) -> Int64:
        """Predictions (count,) in grid units."""
        total = np.zeros(count, np.int64) + (weighted_sum(residuals, self.weights[1:]) << _MEAN_BITS)
        if found is not None:
            total = total + (found[0] - (self.center << _MEAN_BITS)) * self.weights[0]
        return self.center + round_weighted(total, WEIGHT_FRACTION_BITS + _MEAN_BITS)

    def contexts(self, found: Statistics, magnitudes: list[Int64], steps: Int64) -> UInt8:
        """Half octave of the magnitude that a symbol is expected to have."""
        own = self.activity_weights[1] * steps + weighted_sum(magnitudes, self.activity_weights[2:])
        total = own << _MEAN_BITS
        if found is not None:
            total = total + found[1] * self.activity_weights[0]
        activity = (np.maximum(total, 0) >> (WEIGHT_FRACTION_BITS + _MEAN_BITS - ACTIVITY_BITS)) // steps
        return ladder(activity, NUM_CONTEXTS - 1).astype(np.uint8)


@dataclass(frozen=True)
class GradedColumn:
    """The column's steps (N,), levels of detail, and the columns before it.

    `alternating`: whether two quantisers take turns in it.
    """

    steps: Int64
    lod: LevelsOfDetail
    earlier: Earlier
    alternating: bool = False

    def code(self, coder: SymbolCoder, target: Target | None) -> Int64:
        """The column (N,), as decoded; it is added to `earlier`."""
        predictor = self._predictor(coder, target)
        if target is not None:
            return self._write(coder, predictor, target)
        tables = coder.tables(NUM_CONTEXTS, lambda: (np.zeros(0, np.int64), np.zeros(0, np.uint8)))

        def code_rows(_: slice, __: Int64, contexts: UInt8) -> Int64:
            return code_residuals(coder, None, contexts, tables)

        return self._walk(predictor, code_rows)

    def _write(self, coder: SymbolCoder, predictor: _Predictor, target: Target) -> Int64:
        """Quantise the column, walking it, then code what was found: tables come first in the stream."""
        symbols, known = np.zeros(len(self.steps), np.int64), np.zeros(len(self.steps), np.uint8)

        def quantise_rows(rows: slice, prediction: Int64, contexts: UInt8) -> Int64:
            known[rows] = contexts
            symbols[rows] = target.symbols(rows, prediction, self.steps[rows], contexts)
            return symbols[rows]

        values = self._walk(predictor, quantise_rows)
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

    def _predictor(self, coder: SymbolCoder, target: Target | None) -> _Predictor:
        known = np.zeros(0, np.int64) if target is None else target.values
        evidence = _Evidence(known, self)
        center = coder.center(lambda: known)
        count = len(self.earlier.residuals)
        weights = coder.weights(1 + count, lambda: evidence.values(center))
        activity = coder.weights(2 + count, lambda: evidence.magnitudes(center, weights))
        return _Predictor(center, weights, activity)


class _Evidence:
    """What a writer looks at to choose weights: all in steps, neighbours as they are in the input."""

    def __init__(self, target: Int64, column: GradedColumn) -> None:
        self._target, self._column = target, column
        # a fit looks at no more rows than that anyway
        self._part = slice(None, None, max(1, len(target) // _MOST_ROWS))
        self._steps = column.steps[self._part]
        self._found: tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]] | None = None

    def _neighbours(self, center: int) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
        if self._found is None:
            mean = np.full(len(self._target), float(center))
            deviation = np.zeros(len(self._target))
            for level in self._column.lod.levels:
                found = level.statistics(self._target)
                mean[level.rows], deviation[level.rows] = found[0] / 256, found[1] / 256
            self._found = mean[self._part], deviation[self._part]
        return self._found

    def values(self, center: int) -> tuple[list[AnyReal], npt.NDArray[np.float64]]:
        """Features and goal of the value's weights."""
        steps, part = self._steps, self._part
        features: list[AnyReal] = [(self._neighbours(center)[0] - center) / steps]
        features += self._column.earlier.scaled(self._column.steps, part)[0]
        return features, (self._target[part] - center) / steps

    def magnitudes(self, center: int, weights: Int64) -> tuple[list[AnyReal], npt.NDArray[np.float64]]:
        """Features and goal of the activity's weights."""
        features, goal = self.values(center)
        for feature, weight in zip(features, weights.tolist(), strict=True):
            if weight:
                goal = goal - feature * (weight / 256)
        own: list[AnyReal] = [self._neighbours(center)[1] / self._steps, np.ones(len(goal))]
        return own + self._column.earlier.scaled(self._column.steps, self._part)[1], np.abs(goal)


def scaled_symbols(symbols: Int64, steps: Int64, *, alternating: bool) -> Int64:
    """What the symbols of a pass (rows,) mean with steps (rows,); refused before they could leave 64 bits."""
    limit = 2 * STATE_LIMIT // steps
    if (symbols < -limit).any() or (symbols > limit).any():
        raise CorruptBitstream("a symbol is too large for its step")
    return step_values(symbols, steps, alternating=alternating)

"""One integer component of all Gaussians, coded in passes (spec section 11.2)."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from dfcgs_codec.codec.column import round_weighted, weighted_sum
from dfcgs_codec.codec.side_information import WEIGHT_FRACTION_BITS
from dfcgs_codec.codec.symbols import Int64, SymbolCoder, UInt8
from dfcgs_codec.entropy.symbols import code_residuals
from dfcgs_codec.transform.lod import LevelsOfDetail, ladder

#: half octaves of activity; the last context belongs to the base level
NUM_ACTIVITY_CONTEXTS = 32
_BASE_CONTEXT = NUM_ACTIVITY_CONTEXTS - 1
#: activity is kept in 1/32 of a symbol
_ACTIVITY_FRACTION_BITS = 5
_DEVIATION_BITS = 8


@dataclass
class EarlierPasses:
    """What was coded before a component, for it to learn from; all int64 (N,).

    `residuals` of earlier components predict this one's value, their `magnitudes` and the `hints` its
    residual's size.
    """

    num_gaussians: int
    residuals: list[Int64] = field(default_factory=list)
    magnitudes: list[Int64] = field(default_factory=list)
    hints: list[Int64] = field(default_factory=list)

    def add(self, residual: Int64) -> None:
        """Remember a coded component."""
        self.residuals.append(residual)
        self.magnitudes.append(np.abs(residual))


@dataclass(frozen=True)
class _Predictor:
    """How a component is predicted: its center, and Q8 weights of value and of activity.

    `weights`: neighbours' mean, then earlier residuals. `activity_weights`: neighbours' deviation, one,
    then earlier magnitudes and hints.
    """

    center: int
    weights: Int64
    activity_weights: Int64

    @property
    def is_spatial(self) -> bool:
        """Whether neighbours matter; where they do not, one pass codes all Gaussians."""
        return bool(self.weights[0] or self.activity_weights[0])

    def predict(self, mean: Int64, residuals: list[Int64]) -> Int64:
        """Prediction from the neighbours' mean (times 256) and earlier residuals."""
        total = (mean - (self.center << _DEVIATION_BITS)) * self.weights[0]
        total = total + (weighted_sum(residuals, self.weights[1:]) << _DEVIATION_BITS)
        return self.center + round_weighted(total, WEIGHT_FRACTION_BITS + _DEVIATION_BITS)

    def contexts(self, deviation: Int64, sources: list[Int64]) -> UInt8:
        """Context of each residual: half octave of its expected magnitude."""
        own = self.activity_weights[1] + weighted_sum(sources, self.activity_weights[2:])
        total = deviation * self.activity_weights[0] + (own << _DEVIATION_BITS)
        activity = total >> (WEIGHT_FRACTION_BITS + _DEVIATION_BITS - _ACTIVITY_FRACTION_BITS)
        return ladder(np.maximum(activity, 0), NUM_ACTIVITY_CONTEXTS - 1).astype(np.uint8)


def _whole_frame(target: Int64, lod: LevelsOfDetail, center: int) -> tuple[Int64, Int64]:
    """Neighbours' mean and deviation of every Gaussian, as both sides will find them; evidence only."""
    mean = np.full(len(target), center << _DEVIATION_BITS, np.int64)
    deviation = np.zeros(len(target), np.int64)
    for level in lod.levels:
        mean[level.rows], deviation[level.rows] = level.statistics(target)
    return mean, deviation


class _Evidence:
    """What a writer looks at to choose how to code a component; a reader never asks."""

    def __init__(self, target: Int64, lod: LevelsOfDetail, earlier: EarlierPasses) -> None:
        self._target, self._lod, self._earlier = target, lod, earlier
        self._statistics: tuple[Int64, Int64] | None = None

    def _neighbours(self, center: int) -> tuple[Int64, Int64]:
        if self._statistics is None:
            self._statistics = _whole_frame(self._target, self._lod, center)
        return self._statistics

    def _residual(self, predictor: _Predictor) -> Int64:
        mean, _ = self._neighbours(predictor.center)
        return self._target - predictor.predict(mean, self._earlier.residuals)

    def values(self, center: int) -> tuple[list[Int64], Int64]:
        """Features and goal of the value's weights."""
        mean, _ = self._neighbours(center)
        return [round_weighted(mean, 8) - center, *self._earlier.residuals], self._target - center

    def magnitudes(self, predictor: _Predictor) -> tuple[list[Int64], Int64]:
        """Features and goal of the activity's weights; bits as in `_Predictor.contexts`."""
        _, deviation = self._neighbours(predictor.center)
        # its weight is a magnitude in 1/256 of a symbol
        constant = np.ones(len(deviation), np.int64)
        sources = [*self._earlier.magnitudes, *self._earlier.hints]
        features = [round_weighted(deviation, 8), constant, *sources]
        return features, np.abs(self._residual(predictor))

    def residuals(self, predictor: _Predictor) -> tuple[Int64, UInt8]:
        """Residuals and contexts of the whole frame."""
        _, deviation = self._neighbours(predictor.center)
        contexts = predictor.contexts(deviation, self._earlier.magnitudes + self._earlier.hints)
        if predictor.is_spatial:
            contexts[self._lod.base] = _BASE_CONTEXT
        return self._residual(predictor), contexts


def _code_predictor(
    coder: SymbolCoder, evidence: _Evidence, target: Int64 | None, earlier: EarlierPasses
) -> _Predictor:
    center = coder.center(lambda: np.zeros(0, np.int64) if target is None else target)
    count = len(earlier.residuals)
    weights = coder.weights(1 + count, lambda: evidence.values(center))
    plain = _Predictor(center, weights, np.zeros(0, np.int64))
    num_sources = len(earlier.magnitudes) + len(earlier.hints)
    activity = coder.weights(2 + num_sources, lambda: evidence.magnitudes(plain))
    return _Predictor(center, weights, activity)


def code_component(
    coder: SymbolCoder, target: Int64 | None, lod: LevelsOfDetail, earlier: EarlierPasses
) -> Int64:
    """Code `target` (N,) int64 (None when reading), base first, then level by level; returns it.

    Adds the component's residual to `earlier`.
    """
    known = np.zeros(0, np.int64) if target is None else target
    evidence = _Evidence(known, lod, earlier)
    predictor = _code_predictor(coder, evidence, target, earlier)
    tables = coder.tables(NUM_ACTIVITY_CONTEXTS, lambda: evidence.residuals(predictor))
    sources = earlier.magnitudes + earlier.hints
    values = np.zeros(earlier.num_gaussians, np.int64)
    residual = np.zeros(earlier.num_gaussians, np.int64)

    def code_rows(rows: slice, mean: Int64, contexts: UInt8) -> None:
        prediction = predictor.predict(mean, [r[rows] for r in earlier.residuals])
        given = None if target is None else target[rows] - prediction
        residual[rows] = code_residuals(coder, given, contexts, tables)
        values[rows] = prediction + residual[rows]

    first = lod.base if predictor.is_spatial else slice(None)
    count = len(values[first])
    contexts = predictor.contexts(np.zeros(count, np.int64), [s[first] for s in sources])
    if predictor.is_spatial:
        contexts = np.full(count, _BASE_CONTEXT, np.uint8)
    code_rows(first, np.full(count, predictor.center << _DEVIATION_BITS, np.int64), contexts)
    for level in lod.levels if predictor.is_spatial else ():
        mean, deviation = level.statistics(values)
        code_rows(level.rows, mean, predictor.contexts(deviation, [s[level.rows] for s in sources]))
    earlier.add(residual)
    return values

"""A column of symbols with the frozen prior: predicted, classed by a network, coded in passes (spec 17.3)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dfcgs_codec.array_types import Float32, Int64, UInt8
from dfcgs_codec.codec.columns.coder import AnyReal, SymbolCoder
from dfcgs_codec.codec.columns.magnitudes import MEMORY_BITS, PRESENT, log_of, row_sums
from dfcgs_codec.codec.columns.side_information import WEIGHT_FRACTION_BITS
from dfcgs_codec.model.context_model import NUM_COLUMN_INPUTS, Part
from dfcgs_codec.transform.lod import Level, LevelsOfDetail

#: of predictions and of the statistics of neighbours
_FRACTION_BITS = 16
MEAN_BITS = 8
#: fractions of a prediction count as a quarter from one, as a half from three of these
_EIGHTH = 1 << (_FRACTION_BITS - 3)
#: levels of detail, the finest ones, that symbols look at their neighbours on
MAX_LEVELS = 5
#: the input that says what column it is
LAST_INPUT = NUM_COLUMN_INPUTS - 1


def rows_of_passes(lod: LevelsOfDetail) -> list[tuple[slice, Level | None]]:
    """Rows of each pass, and their level; the base comes first and has none."""
    levels = lod.levels[-MAX_LEVELS:]
    base = slice(0, None, levels[0].step) if levels else lod.base
    return [(base, None), *((level.rows, level) for level in levels)]


def others_of(before: Int64, earlier: Int64) -> UInt8:
    """Inputs (rows, 10) of a column but for what its passes know: its symbols `before` (rows,) and those of
    the `earlier` columns (rows, c)."""
    others = np.zeros((len(before), NUM_COLUMN_INPUTS), np.uint8)
    others[:, 3] = log_of(np.abs(before))
    for place in range(min(2, earlier.shape[1])):
        others[:, 4 + place] = log_of(np.abs(earlier[:, -1 - place]))
    if earlier.shape[1]:
        others[:, 6] = log_of(row_sums(np.abs(earlier)))
    return others


@dataclass(frozen=True)
class Component:
    """One column of S rows: what it is predicted from (in 16ths of symbols), its inputs and kinds."""

    part: Part
    prepared: Float32
    features: list[Int64]
    others: UInt8
    kinds: Int64

    def code(
        self, coder: SymbolCoder, target: Int64 | None, lod: LevelsOfDetail, weights: Int64
    ) -> tuple[Int64, Int64]:
        """The column (S,), and its residual; `weights`, Q8, of the neighbours' mean and of the features."""
        own = np.zeros(len(self.kinds), np.int64)
        for feature, weight in zip(self.features, weights[1:].tolist(), strict=True):
            if weight:
                own += feature * weight
        own <<= _FRACTION_BITS - WEIGHT_FRACTION_BITS - MEMORY_BITS
        values, residual = np.zeros_like(own), np.zeros_like(own)
        for span, level in rows_of_passes(lod):
            others = self.others[span].copy()
            expected = own[span]
            if level is None:
                others[:, 2] = PRESENT
            else:
                mean, deviation = level.statistics(values)
                expected = expected + mean * weights[0]
                others[:, 0] = log_of(deviation)
                others[:, 1] = log_of(np.abs(mean))
            prediction = (expected + (1 << (_FRACTION_BITS - 1))) >> _FRACTION_BITS
            fraction = expected - (prediction << _FRACTION_BITS)
            kinds = np.where(prediction == 0, self.kinds[span], 0)
            others[:, 7] = log_of(np.abs(expected) >> (_FRACTION_BITS - MEAN_BITS))
            others[:, 8] = (kinds > 0) * PRESENT
            size = np.abs(fraction)
            fractions = (size >= _EIGHTH).astype(np.int64) + (size >= 3 * _EIGHTH)
            sign = np.where((fraction < 0) & (fractions > 0), -1, 1)
            given = None if target is None else (target[span] - prediction) * sign
            coded = self.part.code(coder, given, (self.prepared[span], others), (kinds, fractions))
            residual[span] = coded * sign
            values[span] = prediction + residual[span]
        return values, residual

    def evidence(self, target: Int64 | None, lod: LevelsOfDetail) -> tuple[list[AnyReal], Int64]:
        """What the weights are fitted to."""
        assert target is not None
        mean = np.zeros(len(target))
        for level in lod.levels[-MAX_LEVELS:]:
            mean[level.rows] = level.mean(target) / (1 << MEAN_BITS)
        scaled: list[AnyReal] = [f / (1 << MEMORY_BITS) for f in self.features]
        return [mean, *scaled], target

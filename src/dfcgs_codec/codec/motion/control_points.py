"""The symbols of control points with the frozen prior (spec section 14.3)."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from dfcgs_codec.array_types import Int64, UInt8
from dfcgs_codec.bitstream.motion_header import MotionHeader
from dfcgs_codec.codec.columns.coder import SymbolCoder
from dfcgs_codec.codec.columns.magnitudes import MEMORY_BITS, PRESENT, log_of, row_sums
from dfcgs_codec.codec.columns.prior_column import LAST_INPUT, Component, others_of
from dfcgs_codec.codec.motion.field import MotionField, level_starts
from dfcgs_codec.codec.residual.inputs import EFFORT_SHIFT
from dfcgs_codec.model.context_model import INPUT_LIMIT, NUM_CONTROL_COMMON, ContextModel
from dfcgs_codec.transform.lod import order_levels

#: translation and turn
NUM_COLUMNS = 6
_NUM_TRANSLATIONS = 3


@dataclass(frozen=True)
class ControlPrior:
    """The frozen model, and what is known of n control points.

    `inputs` (n, 4) of the network; `expected` (n, 6): what symbols would be if habits went on, in 16ths.
    """

    model: ContextModel
    inputs: UInt8
    expected: Int64

    @staticmethod
    def of(model: ContextModel, field: MotionField, header: MotionHeader, before: Int64) -> ControlPrior:
        """Before the symbols of a frame whose motion begins with `header`; `before` (n, 6): the last ones."""
        expected = np.zeros((field.num_points, NUM_COLUMNS), np.int64)
        history = field.history
        expected[:, :_NUM_TRANSLATIONS] = (history.translations << MEMORY_BITS) // header.translation_step
        if header.is_rigid:
            expected[:, _NUM_TRANSLATIONS:] = (history.vectors << MEMORY_BITS) // header.turn_step
        inputs = _inputs(field, row_sums(np.abs(before)), row_sums(np.abs(expected)))
        return ControlPrior(model, inputs, expected)

    def code(
        self, coder: SymbolCoder, target: Int64 | None, rows: Int64, before: Int64, num_columns: int
    ) -> Int64:
        """Symbols (k, num_columns) of control points `rows`; `before` (k, columns): their last symbols."""
        part, lod, count = self.model.control, order_levels(len(rows)), len(rows)
        prepared = part.prepare(self.inputs[rows])
        result = np.zeros((count, num_columns), np.int64)
        features: list[Int64] = []
        for column in range(num_columns):
            others = others_of(before[:, column], result[:, :column])
            others[:, LAST_INPUT] = (column >= _NUM_TRANSLATIONS) * PRESENT
            known = [*features, before[:, column] << MEMORY_BITS, self.expected[rows, column]]
            component = Component(part, prepared, known, others, np.zeros(count, np.int64))
            table = self.model.control_weights[column]
            weights = np.concatenate([table[: column + 1], table[NUM_COLUMNS:]])
            given = None if target is None else target[:, column]
            result[:, column], residual = component.code(coder, given, lod, weights)
            features.append(residual << MEMORY_BITS)
        return result


def _inputs(field: MotionField, before: Int64, habits: Int64) -> UInt8:
    """(n, 4): last symbols, habits, effort of the leader and how much worse others do."""
    inputs = np.zeros((field.num_points, NUM_CONTROL_COMMON), np.uint8)
    inputs[:, 0] = log_of(before)
    inputs[:, 1] = log_of(habits)
    # the first level has no parents
    levels = pairwise(level_starts(field.num_points)[1:])
    for binding, (start, end) in zip(field.parents, levels, strict=True):
        efforts = binding.efforts >> EFFORT_SHIFT
        chosen = efforts[binding.choice, np.arange(end - start)]
        inputs[start:end, 2] = np.minimum(chosen, INPUT_LIMIT)
        inputs[start:end, 3] = np.minimum(efforts.max(axis=0) - efforts.min(axis=0), INPUT_LIMIT)
    return inputs

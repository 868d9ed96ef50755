"""The symbol walk of a P-frame's residual, one stream per attribute (spec section 12).

Blocks of Gaussians in GoF order carry a density class (none, few, some, all significant) and a magnitude
class; Gaussians of partly significant blocks carry a flag; significant ones carry symbols. The networks and
tables of the frozen prior turn what was decoded before into the models that all of this is coded with.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from dfcgs_codec.array_types import Bool, Int64, UInt8
from dfcgs_codec.bitstream.constants import Attribute
from dfcgs_codec.codec.columns.coder import SymbolCoder
from dfcgs_codec.codec.columns.magnitudes import MEMORY_BITS, PRESENT, row_sums
from dfcgs_codec.codec.columns.prior_column import LAST_INPUT, MEAN_BITS, Component, others_of, rows_of_passes
from dfcgs_codec.codec.residual.classes import (
    BLOCK_LOG2,
    DENSE,
    NUM_DENSITIES,
    NUM_MAGNITUDES,
    AttributeActivity,
    InterSymbols,
    num_blocks,
    num_inter_columns,
)
from dfcgs_codec.codec.residual.inputs import BEFORE, SMALL, AttributeInputs, common_inputs
from dfcgs_codec.entropy.symbols import Groups, code_residuals, code_with_models
from dfcgs_codec.model.context_model import (
    NUM_FLAG_INPUTS,
    NUM_KINDS,
    ContextModel,
    Part,
)
from dfcgs_codec.transform.lod import GofLevels, LevelsOfDetail


@dataclass(frozen=True)
class Prior:
    """The frozen model, and what it is told of all N Gaussians of a frame.

    `gaussians` (N, 5): see `gaussian_inputs`; `coarseness`: by attribute with visibility steps, (N,).
    """

    model: ContextModel
    gaussians: UInt8
    coarseness: dict[Attribute, Int64]


@dataclass(frozen=True)
class PriorContext:
    """What the walk of one attribute knows: its history, that of others, levels of detail.

    `beside` (blocks,): density classes of the attribute coded before it, or modes of motion.
    """

    attribute: Attribute
    prior: Prior
    before: AttributeActivity
    beside: Int64
    history: InterSymbols
    levels: GofLevels

    def inputs(self, rows: Int64, density: Int64, magnitude: Int64) -> UInt8:
        """Those that all symbols of the Gaussians `rows` have in common; classes are those of all blocks."""
        before, block = self.before, rows >> BLOCK_LOG2
        zero = np.zeros(len(rows), np.int64)
        coarseness = self.prior.coarseness.get(self.attribute)
        others = {a: x for a, x in self.history.activity.items() if a in BEFORE and a != self.attribute}
        known = AttributeInputs(
            self.attribute,
            None if coarseness is None else coarseness[rows],
            _sizes(before.symbols[rows]),
            zero if before.running is None else before.running[rows],
            zero if before.memory is None else _sizes(before.memory[rows]),
            before.density[block],
            density[block],
            magnitude[block],
            {a: _sizes(x.symbols[rows]) for a, x in others.items()},
        )
        return common_inputs(self.prior.gaussians[rows], known)


def _sizes(symbols: Int64) -> Int64:
    return row_sums(np.abs(symbols))


def code_inter_attribute(
    coder: SymbolCoder, target: AttributeActivity | None, context: PriorContext
) -> AttributeActivity:
    """The stream of one attribute; returns symbols (N, C) and classes."""
    before = context.before
    density = _code_density(coder, None if target is None else target.density, context)
    given = None if target is None else target.magnitude
    magnitude = _code_magnitude(coder, given, density, context)
    count = len(before.symbols)
    rows = np.flatnonzero((density > 0)[np.arange(count) >> BLOCK_LOG2])
    inputs = context.inputs(rows, density, magnitude)
    flags = None if target is None else target.significant()
    flagged = density[rows >> BLOCK_LOG2] != DENSE
    kept = _code_flags(coder, flags, context, (rows, inputs, flagged))
    symbols = np.zeros(before.symbols.shape, np.int64)
    chosen = rows[kept]
    if len(chosen):
        memory = None if before.memory is None else before.memory[chosen]
        columns = _Columns(context.prior.model.columns, inputs[kept], flagged[kept])
        given = None if target is None else target.symbols[chosen]
        lod = context.levels.of(len(chosen))
        symbols[chosen] = columns.code(coder, given, lod, (before.symbols[chosen], memory))
    return AttributeActivity(symbols, density, magnitude)


def _code_density(coder: SymbolCoder, density: Int64 | None, context: PriorContext) -> Int64:
    """Density classes; contexts: the same block in the previous frame and in the attribute before."""
    contexts = context.before.density * NUM_DENSITIES + context.beside
    groups = Groups(contexts, NUM_DENSITIES**2)
    return code_with_models(coder, density, groups, context.prior.model.densities)


def _code_magnitude(
    coder: SymbolCoder, magnitude: Int64 | None, density: Int64, context: PriorContext
) -> Int64:
    """Magnitude classes of blocks that have one, as difference from the previous frame's."""
    rows = np.flatnonzero(density > 0)
    result = np.zeros(len(density), np.int64)
    prediction = context.before.magnitude[rows]
    contexts = density[rows] + NUM_DENSITIES * (prediction > 0)
    given = None if magnitude is None else magnitude[rows] - prediction
    coded = code_residuals(coder, given, contexts, context.prior.model.magnitudes)
    result[rows] = np.clip(coded + prediction, 0, NUM_MAGNITUDES - 1)
    return result


def _code_flags(
    coder: SymbolCoder, flags: Bool | None, context: PriorContext, known: tuple[Int64, UInt8, Bool]
) -> Bool:
    """Whether each of `rows` has symbols; `known`: these rows, their inputs, and whether they have a flag."""
    rows, inputs, flagged = known
    count = len(context.before.symbols)
    # 256 for significant Gaussians, in all blocks
    state = np.zeros(count, np.int64)
    state[rows[~flagged]] = 1 << MEAN_BITS
    if not flagged.any():
        return np.ones(len(rows), np.bool_)
    part = context.prior.model.flags
    prepared = part.prepare(inputs)
    place = np.full(count, -1, np.int64)
    place[rows[flagged]] = np.flatnonzero(flagged)
    for span, level in rows_of_passes(context.levels.of(count)):
        there = place[span] >= 0
        found = place[span][there]
        others = np.zeros((len(found), NUM_FLAG_INPUTS), np.uint8)
        if level is None:
            others[:, 1] = PRESENT
        else:
            others[:, 0] = level.mean(state)[there] >> (MEAN_BITS + 1)
        given = None if flags is None else flags[rows[found]].astype(np.int64)
        coded = part.code(coder, given, (prepared[found], others))
        state[rows[found]] = coded << MEAN_BITS
    return state[rows] > 0


@dataclass(frozen=True)
class _Columns:
    """Symbols of the significant Gaussians; `inputs` (S, common), `flagged` (S,): those that have a flag."""

    part: Part
    inputs: UInt8
    flagged: Bool

    def code(
        self,
        coder: SymbolCoder,
        target: Int64 | None,
        lod: LevelsOfDetail,
        past: tuple[Int64, Int64 | None],
    ) -> Int64:
        """Symbols (S, C); `past`: those before, and the memory."""
        before, memory = past
        count, num_columns = before.shape
        prepared = self.part.prepare(self.inputs)
        result = np.zeros((count, num_columns), np.int64)
        residuals: list[Int64] = []
        for column in range(num_columns):
            left = num_columns - column
            features = [r << MEMORY_BITS for r in [*residuals, before[:, column]]]
            features.append(np.zeros(count, np.int64) if memory is None else memory[:, column])
            others = others_of(before[:, column], result[:, :column])
            others[:, LAST_INPUT] = min(left, NUM_KINDS) * SMALL
            kinds = self._kinds(result[:, :column], left)
            component = Component(self.part, prepared, features, others, kinds)
            given = None if target is None else target[:, column]
            weights = coder.weights(1 + len(features), partial(component.evidence, given, lod))
            result[:, column], residual = component.code(coder, given, lod, weights)
            residuals.append(residual)
        return result

    def _kinds(self, earlier: Int64, left: int) -> Int64:
        """Kind of each symbol: 1 to 3 where one must be other than zero that none of the earlier ones is."""
        open_still = self.flagged.copy()
        for column in range(earlier.shape[1]):
            open_still &= earlier[:, column] == 0
        return open_still * np.int64(NUM_KINDS - min(left, NUM_KINDS - 1))


@dataclass(frozen=True)
class InterShape:
    """What headers, reference and motion say that the walk needs; `modes` (blocks,): of motion, if any."""

    attributes: list[Attribute]
    num_gaussians: int
    levels: GofLevels
    prior: Prior
    modes: Int64 | None = None


def code_inter(
    next_coder: Callable[[], SymbolCoder],
    symbols: InterSymbols | None,
    history: InterSymbols,
    shape: InterShape,
) -> InterSymbols:
    """All streams of a P-frame; `history` is what the previous frame carried; returns the symbols."""
    coded: dict[Attribute, AttributeActivity] = {}
    beside = np.zeros(num_blocks(shape.num_gaussians), np.int64) if shape.modes is None else shape.modes
    for attribute in shape.attributes:
        before = history.activity.get(attribute)
        if before is None:
            before = AttributeActivity.none(shape.num_gaussians, num_inter_columns(attribute))
        target = None if symbols is None else symbols.activity[attribute]
        context = PriorContext(attribute, shape.prior, before, beside, history, shape.levels)
        coded[attribute] = code_inter_attribute(next_coder(), target, context).remembering(before)
        beside = coded[attribute].density
    return InterSymbols(coded)

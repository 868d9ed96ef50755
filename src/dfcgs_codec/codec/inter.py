"""The symbol walk of a P-frame's residual, one stream per attribute (spec section 12).

Blocks of Gaussians in canonical order carry a density class (none, few, some, all significant) and a
magnitude class; Gaussians of partly significant blocks carry a flag; significant ones carry symbols.
Contexts are these classes and what the previous frame and earlier components did.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from dfcgs_codec.bitstream.constants import Attribute
from dfcgs_codec.codec.activity import (
    DENSE,
    NUM_DENSITIES,
    NUM_MAGNITUDES,
    AttributeActivity,
    InterSymbols,
    num_blocks,
    num_inter_columns,
    row_sums,
)
from dfcgs_codec.codec.component import EarlierPasses, code_component
from dfcgs_codec.codec.inter_prior import Prior, PriorContext, code_with_prior
from dfcgs_codec.codec.symbols import Int64, SymbolCoder
from dfcgs_codec.entropy.symbols import Groups, code_residuals, code_with_models
from dfcgs_codec.transform.lod import GofLevels, LevelsOfDetail

Bool = npt.NDArray[np.bool_]

#: middle of each magnitude class, in quarters of a symbol: round(2**((class - 0.5) / 2))
_CLASS_MIDDLES = np.array(
    (0, 1, 2, 2, 3, 5, 7, 10, 13, 19, 27, 38, 54, 76, 108, 152, 215, 304, 431, 609, 861, 1218, 1722, 2435),
    np.int64,
)


def _code_density(coder: SymbolCoder, density: Int64 | None, before: Int64, beside: Int64) -> Int64:
    """Density classes; contexts: the same block in the previous frame and in the attribute before."""
    contexts = (before * NUM_DENSITIES + beside).astype(np.uint8)
    known = np.zeros(0, np.int64) if density is None else density
    groups = Groups(contexts, NUM_DENSITIES**2)
    models = coder.histograms(groups.used, NUM_DENSITIES**2, NUM_DENSITIES, lambda: (known, contexts))
    return code_with_models(coder, density, groups, models)


def _code_magnitude(coder: SymbolCoder, magnitude: Int64 | None, density: Int64, before: Int64) -> Int64:
    """Magnitude classes of blocks that have one, as difference from the previous frame's."""
    rows = np.flatnonzero(density > 0)
    result = np.zeros(len(density), np.int64)
    if not len(rows):
        return result
    prediction = before[rows]
    # no class in the previous frame is a context of its own, and so is each density
    contexts = (density[rows] + NUM_DENSITIES * (prediction > 0)).astype(np.uint8)
    given = None if magnitude is None else magnitude[rows] - prediction
    known = np.zeros(0, np.int64) if given is None else given
    tables = coder.tables(2 * NUM_DENSITIES, lambda: (known, contexts))
    coded = code_residuals(coder, given, contexts, tables) + prediction
    result[rows] = np.clip(coded, 0, NUM_MAGNITUDES - 1)
    return result


def _code_flags(
    coder: SymbolCoder, flags: Int64 | None, density: Int64, elsewhere: tuple[Bool, Bool]
) -> Int64:
    """Rows (sorted indices) of significant Gaussians.

    `density` (N,) of each Gaussian's block; `elsewhere`: whether it was significant in the previous frame,
    and in the attribute coded before this one, both (N,).
    """
    before, beside = elsewhere
    result = density == DENSE
    rows = np.flatnonzero((density > 0) & ~result)
    if len(rows):
        contexts = (density[rows] * 4 + before[rows] * 2 + beside[rows]).astype(np.uint8)
        given = None if flags is None else flags[rows]
        known = np.zeros(0, np.int64) if given is None else given
        groups = Groups(contexts, NUM_DENSITIES * 4)
        models = coder.histograms(groups.used, NUM_DENSITIES * 4, 2, lambda: (known, contexts))
        result[rows] = code_with_models(coder, given, groups, models) > 0
    return np.flatnonzero(result)


def _code_columns(
    coder: SymbolCoder, target: Int64 | None, lod: LevelsOfDetail, context: tuple[Int64, Int64]
) -> Int64:
    """Symbols (S, C) of the significant Gaussians.

    `context` is their blocks' magnitude class (S,) and their symbols in the previous frame (S, C).
    """
    magnitude, before = context
    count, num_columns = before.shape
    hints = [_CLASS_MIDDLES[magnitude], row_sums(np.abs(before))]
    earlier = EarlierPasses(count, hints=hints)
    result = np.empty((count, num_columns), np.int64)
    for column in range(num_columns):
        features = [*earlier.residuals, before[:, column]]
        passes = EarlierPasses(count, features, list(earlier.magnitudes), hints)
        given = None if target is None else target[:, column]
        result[:, column] = code_component(coder, given, lod, passes)
        earlier.add(passes.residuals[-1])
    return result


@dataclass(frozen=True)
class InterShape:
    """What headers, reference and motion say that the walk needs; `prior`: where the sequence has a model."""

    attributes: list[Attribute]
    num_gaussians: int
    block_log2: int
    levels: GofLevels
    moved: AttributeActivity | None = None
    prior: Prior | None = None


def code_inter_attribute(
    coder: SymbolCoder,
    target: AttributeActivity | None,
    before: AttributeActivity,
    beside: AttributeActivity,
    shape: InterShape,
) -> AttributeActivity:
    """The stream of one attribute; `before`: this attribute in the previous frame; `beside`: the
    attribute coded before it in this frame. Returns symbols (N, C) and classes."""
    density = _code_density(coder, None if target is None else target.density, before.density, beside.density)
    magnitude = _code_magnitude(
        coder, None if target is None else target.magnitude, density, before.magnitude
    )
    count = len(before.symbols)
    block = np.arange(count) >> shape.block_log2
    flags = None if target is None else target.significant().astype(np.int64)
    rows = _code_flags(coder, flags, density[block], (before.significant(), beside.significant()))
    symbols = np.zeros(before.symbols.shape, np.int64)
    given = None if target is None else target.symbols[rows]
    lod = shape.levels.of(len(rows))
    symbols[rows] = _code_columns(coder, given, lod, (magnitude[block[rows]], before.symbols[rows]))
    return AttributeActivity(symbols, density, magnitude)


def code_inter(
    next_coder: Callable[[], SymbolCoder],
    symbols: InterSymbols | None,
    history: InterSymbols,
    shape: InterShape,
) -> InterSymbols:
    """All streams of a P-frame; `history` is what the previous frame carried; returns the symbols."""
    blocks = num_blocks(shape.num_gaussians, shape.block_log2)
    coded: dict[Attribute, AttributeActivity] = {}
    beside = shape.moved or AttributeActivity.none(shape.num_gaussians, 1, blocks)
    for attribute in shape.attributes:
        columns = num_inter_columns(attribute)
        before = history.activity.get(attribute)
        if before is None or len(before.density) != blocks:
            before = AttributeActivity.none(shape.num_gaussians, columns, blocks)
        target = None if symbols is None else symbols.activity[attribute]
        if shape.prior is None:
            beside = code_inter_attribute(next_coder(), target, before, beside, shape)
        else:
            context = PriorContext(
                attribute, shape.prior, before, beside, history, dict(coded), shape.levels, shape.block_log2
            )
            beside = _code_either(next_coder(), target, context, shape).remembering(before)
        coded[attribute] = beside
    return InterSymbols(coded)


def _code_either(
    coder: SymbolCoder, target: AttributeActivity | None, context: PriorContext, shape: InterShape
) -> AttributeActivity:
    """The stream of one attribute, with the prior or without, as the stream says."""

    def walk(chosen: SymbolCoder, with_prior: bool) -> AttributeActivity:
        if with_prior:
            return code_with_prior(chosen, target, context)
        return code_inter_attribute(chosen, target, context.before, context.beside, shape)

    return coder.either(walk)

"""The symbol walk of P-frames with zero motion, one stream per attribute (spec section 12).

Blocks of Gaussians in canonical order carry a density class (none, few, some, all significant) and a
magnitude class; Gaussians of partly significant blocks carry a flag; significant ones carry symbols.
Contexts are these classes and what the previous frame and earlier components did.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from dfcgs_codec.bitstream.constants import STATE_COLUMNS, Attribute
from dfcgs_codec.codec.component import EarlierPasses, code_component
from dfcgs_codec.codec.symbols import Int64, SymbolCoder
from dfcgs_codec.entropy.symbols import Groups, code_residuals, code_with_models
from dfcgs_codec.transform.lod import GofLevels, LevelsOfDetail, ladder

Bool = npt.NDArray[np.bool_]

NUM_DENSITIES = 4
DENSE = NUM_DENSITIES - 1
#: magnitude classes are half octaves of the mean magnitude, in quarters of a symbol
NUM_MAGNITUDES = 24
#: with more significant Gaussians than this, all are coded, and their nearest neighbours help
_ALL_DENSE_SHARE = 0.85
#: middle of each magnitude class, in quarters of a symbol: round(2**((class - 0.5) / 2))
_CLASS_MIDDLES = np.array(
    (0, 1, 2, 2, 3, 5, 7, 10, 13, 19, 27, 38, 54, 76, 108, 152, 215, 304, 431, 609, 861, 1218, 1722, 2435),
    np.int64,
)


def row_sums(values: Int64) -> Int64:
    """Sum of each row of `values` (N, C)."""
    total = values[:, 0].copy()
    for column in range(1, values.shape[1]):
        total += values[:, column]
    return total


def nonzero_rows(values: Int64) -> Bool:
    """Whether each row of `values` (N, C) holds anything but zeros."""
    # column by column: numpy's any() over a short last axis is ten times slower
    found: Bool = values[:, 0] != 0
    for column in range(1, values.shape[1]):
        found |= values[:, column] != 0
    return found


@dataclass
class AttributeActivity:
    """What an attribute did in the previous frame; zeros after an I-frame and where it was absent.

    `symbols` int64 (N, C); `density` and `magnitude` int64 (blocks,).
    """

    symbols: Int64
    density: Int64
    magnitude: Int64

    @staticmethod
    def none(num_gaussians: int, num_columns: int, num_blocks: int) -> AttributeActivity:
        """Nothing happened."""
        zero = np.zeros(num_blocks, np.int64)
        return AttributeActivity(np.zeros((num_gaussians, num_columns), np.int64), zero, zero)

    def merged(self, num_births: int, source: Int64, num_blocks: int) -> AttributeActivity:
        """The same after Gaussians went and came, blocks forgotten.

        Row i of the result is row source[i] of these and of births, which have no symbols.
        """
        births = np.zeros((num_births, self.symbols.shape[1]), np.int64)
        zero = np.zeros(num_blocks, np.int64)
        return AttributeActivity(np.concatenate([self.symbols, births])[source], zero, zero)

    def significant(self) -> Bool:
        """Whether each Gaussian has a symbol other than zero."""
        return nonzero_rows(self.symbols)


@dataclass(frozen=True)
class InterSymbols:
    """What a P-frame carries: for each attribute present its symbols and block classes."""

    activity: dict[Attribute, AttributeActivity] = field(default_factory=dict)

    def merged(self, num_births: int, source: Int64, block_log2: int) -> InterSymbols:
        """See AttributeActivity.merged."""
        blocks = num_blocks(len(source), block_log2)
        return InterSymbols({a: x.merged(num_births, source, blocks) for a, x in self.activity.items()})


def num_inter_columns(attribute: Attribute) -> int:
    """Columns of an attribute's symbols in a P-frame; a turn has three."""
    return 3 if attribute == Attribute.ROTATION else STATE_COLUMNS[attribute]


def num_blocks(num_gaussians: int, block_log2: int) -> int:
    """Blocks of 2**block_log2 Gaussians, the last one perhaps shorter."""
    return -(-num_gaussians >> block_log2)


def classify_blocks(symbols: Int64, block_log2: int) -> tuple[Int64, Int64]:
    """Density and magnitude class of each block of `symbols` (N, C); an encoder's choice."""
    starts = np.arange(0, len(symbols), 1 << block_log2)
    magnitude = row_sums(np.abs(symbols))
    significant = np.add.reduceat((magnitude > 0).astype(np.int64), starts)
    size = np.diff(np.append(starts, len(symbols)))
    density = np.where(significant * 4 < size, 1, 2)
    density = np.where(significant == size, DENSE, density)
    density[significant == 0] = 0
    if significant.sum() > _ALL_DENSE_SHARE * len(symbols):
        density[:] = DENSE
    total = np.add.reduceat(magnitude, starts) * 4
    mean = total // np.maximum(significant * symbols.shape[1], 1)
    return density, ladder(mean, NUM_MAGNITUDES)


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
    """What headers, reference and motion say that the walk needs."""

    attributes: list[Attribute]
    num_gaussians: int
    block_log2: int
    levels: GofLevels
    moved: AttributeActivity | None = None


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
        beside = code_inter_attribute(next_coder(), target, before, beside, shape)
        coded[attribute] = beside
    return InterSymbols(coded)

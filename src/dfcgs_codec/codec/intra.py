"""The symbol walk of coded I-frames, one stream per attribute (spec section 11)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from dfcgs_codec.bitstream.constants import STATE_COLUMNS, Attribute
from dfcgs_codec.bitstream.frame_headers import SortGrid
from dfcgs_codec.codec.component import EarlierPasses, code_component
from dfcgs_codec.codec.histogram_component import code_with_histogram
from dfcgs_codec.codec.position_tree import code_positions
from dfcgs_codec.codec.symbols import Int64, SymbolCoder
from dfcgs_codec.entropy.symbols import Groups, code_with_models
from dfcgs_codec.errors import CorruptBitstream
from dfcgs_codec.transform.lod import LevelsOfDetail, build_levels

_NUM_CELLS = 4


@dataclass
class IntraSymbols:
    """What a coded I-frame carries, all int64, rows in canonical order.

    `planes`: POSITION (N, 3) indices; SCALE, SH_DC (N, 3); OPACITY (N, 1); SH_1 (N, 9) and so on: multiples
    of their step; ROTATION (N, 4): axis flip 0 to 3, then the stereographic vector in steps.
    `permutation` (N,): place of each Gaussian in the output, or None.
    """

    planes: dict[Attribute, Int64] = field(default_factory=dict)
    permutation: Int64 | None = None


@dataclass(frozen=True)
class Passes:
    """What the components of one attribute are coded with; `guide` (N,) steers the first histogram."""

    attribute: Attribute
    guide: Int64 | None
    earlier: EarlierPasses


#: attributes whose components may be coded by histogram
_HISTOGRAM_ATTRIBUTES = (Attribute.SCALE, Attribute.ROTATION, Attribute.OPACITY)


def _code_column(
    coder: SymbolCoder,
    target: Int64 | None,
    guide: Int64 | None,
    coding: tuple[LevelsOfDetail, EarlierPasses],
) -> Int64:
    """One component (N,), by histogram or predicted, whichever its writer chose."""
    lod, earlier = coding

    def evidence() -> tuple[Int64, Int64 | None, Callable[[SymbolCoder], object]]:
        assert target is not None
        scratch = replace(earlier, residuals=list(earlier.residuals), magnitudes=list(earlier.magnitudes))
        return target, guide, lambda other: code_component(other, target, lod, scratch)

    layout = coder.layout(evidence)
    if layout is None:
        return code_component(coder, target, lod, earlier)
    return code_with_histogram(coder, target, guide, (layout, earlier.num_gaussians))


def _code_columns(coder: SymbolCoder, target: Int64 | None, lod: LevelsOfDetail, passes: Passes) -> Int64:
    """Columns (N, C) of `passes.attribute`, each after and with the help of the columns before it."""
    columns: list[Int64] = []
    num_columns = 3 if passes.attribute == Attribute.ROTATION else STATE_COLUMNS[passes.attribute]
    for c in range(num_columns):
        given = None if target is None else target[:, c]
        if passes.attribute in _HISTOGRAM_ATTRIBUTES:
            guide = columns[-1] if columns else passes.guide
            columns.append(_code_column(coder, given, guide, (lod, passes.earlier)))
        else:
            columns.append(code_component(coder, given, lod, passes.earlier))
    return np.stack(columns, axis=1)


def _code_cells(coder: SymbolCoder, cells: Int64 | None, count: int) -> Int64:
    """Axis flips 0 to 3 with one histogram."""
    contexts = np.zeros(count, np.uint8)
    known = np.zeros(0, np.int64) if cells is None else cells
    used = np.zeros(1, np.int64)
    models = coder.histograms(used, 1, _NUM_CELLS, lambda: (known, contexts))
    return code_with_models(coder, cells, Groups(contexts, 1), models)


def code_attribute(coder: SymbolCoder, target: Int64 | None, lod: LevelsOfDetail, passes: Passes) -> Int64:
    """The stream of one attribute other than POSITION; `target` and result are (N, C)."""
    if passes.attribute != Attribute.ROTATION:
        return _code_columns(coder, target, lod, passes)
    cells = _code_cells(coder, None if target is None else target[:, 0], passes.earlier.num_gaussians)
    vectors = _code_columns(coder, None if target is None else target[:, 1:], lod, passes)
    return np.concatenate([cells[:, None], vectors], axis=1)


def _passes_before(attribute: Attribute, coded: dict[Attribute, Int64], color: EarlierPasses) -> Passes:
    """What an attribute may learn from: colour from all colour before it, and from size."""
    if attribute >= Attribute.SH_DC:
        return Passes(attribute, None, color)
    guide = coded[Attribute.SCALE][:, 0] if attribute == Attribute.OPACITY else None
    return Passes(attribute, guide, EarlierPasses(color.num_gaussians))


def code_permutation(coder: SymbolCoder, target: Int64 | None, lod: LevelsOfDetail, count: int) -> Int64:
    """Places in the output order: a component like any other, for neighbours lie near in order too."""
    permutation = code_component(coder, target, lod, EarlierPasses(count))
    if not np.array_equal(np.sort(permutation), np.arange(count)):
        raise CorruptBitstream("the output order is not a permutation")
    return permutation


@dataclass(frozen=True)
class IntraShape:
    """What the header says that the walk needs."""

    num_gaussians: int
    attributes: list[Attribute]
    has_permutation: bool
    sort_grid: SortGrid


def code_intra(
    next_coder: Callable[[], SymbolCoder], symbols: IntraSymbols | None, shape: IntraShape
) -> IntraSymbols:
    """All streams of a coded I-frame; `next_coder` opens each one in turn; returns the symbols."""
    n = shape.num_gaussians
    result = IntraSymbols()

    def given(attribute: Attribute) -> Int64 | None:
        return None if symbols is None else symbols.planes[attribute]

    positions = code_positions(next_coder(), given(Attribute.POSITION), shape.sort_grid, n)
    result.planes[Attribute.POSITION] = positions
    lod = build_levels(positions)
    if shape.has_permutation:
        known = None if symbols is None else symbols.permutation
        result.permutation = code_permutation(next_coder(), known, lod, n)
    color = EarlierPasses(n)
    for attribute in shape.attributes[1:]:
        passes = _passes_before(attribute, result.planes, color)
        result.planes[attribute] = code_attribute(next_coder(), given(attribute), lod, passes)
        if attribute == Attribute.SCALE:
            color.hints.append(result.planes[attribute].sum(axis=1))
    return result

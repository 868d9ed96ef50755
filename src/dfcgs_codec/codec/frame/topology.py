"""The symbol walk of a frame's topology: who goes, who comes, in which order (spec section 15)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from dfcgs_codec.array_types import Int64
from dfcgs_codec.bitstream.sequence_header import UnitExponents
from dfcgs_codec.bitstream.topology_header import TopologyHeader
from dfcgs_codec.codec.columns.coder import SymbolCoder
from dfcgs_codec.codec.columns.column import code_permutation
from dfcgs_codec.codec.intra.walk import IntraGoal, IntraShape, code_intra
from dfcgs_codec.codec.state.planes import FrameState
from dfcgs_codec.entropy.symbols import Groups, code_with_models
from dfcgs_codec.errors import CorruptBitstream
from dfcgs_codec.transform.lod import order_levels


@dataclass(frozen=True)
class TopologySymbols:
    """What a TOPOLOGY chunk carries before the permutation, which `code_places` codes.

    `kept` int64: rows of the reference frame that survive, ascending; `births`: like an I-frame, or None.
    """

    kept: Int64
    births: IntraGoal | None


def _code_removals(coder: SymbolCoder, kept: Int64 | None, num_gaussians: int, num_removals: int) -> Int64:
    """Rows that survive; one flag for each Gaussian."""
    contexts = np.zeros(num_gaussians, np.uint8)
    removed = np.ones(num_gaussians, np.int64)
    if kept is not None:
        removed[kept] = 0
    given = None if kept is None else removed
    models = coder.histograms(np.zeros(1, np.int64), 1, 2, lambda: (removed, contexts))
    flags = code_with_models(coder, given, Groups(contexts, 1), models)
    survivors = np.flatnonzero(flags == 0)
    if len(survivors) != num_gaussians - num_removals:
        raise CorruptBitstream("removals are not as many as their number says")
    return survivors


def code_topology(
    next_coder: Callable[[], SymbolCoder],
    symbols: TopologySymbols | None,
    header: TopologyHeader,
    before: tuple[int, UnitExponents],
) -> tuple[Int64, FrameState | None]:
    """Removals, then births; `before`: Gaussians of the reference frame, units; who survives, who is born."""
    num_gaussians, units = before
    kept = np.arange(num_gaussians)
    if header.num_removals:
        known = None if symbols is None else symbols.kept
        kept = _code_removals(next_coder(), known, num_gaussians, header.num_removals)
    if header.sort_grid is None or header.steps is None:
        return kept, None
    shape = IntraShape(header.num_births, False, header.sort_grid, header.steps, units)
    return kept, code_intra(next_coder, None if symbols is None else symbols.births, shape)


def code_places(coder: SymbolCoder, places: Int64 | None, expected: Int64) -> Int64:
    """Place in the output of each Gaussian, as difference from the `expected` ones; both (N,)."""
    return code_permutation(coder, places, order_levels(len(expected)), expected)


def insertion(keys: Int64, births: Int64) -> Int64:
    """Which row of survivors and births stands where: by key, survivors' keys never falling.

    `keys` of survivors (S,), of `births` (B,); returns rows (S + B,) of the former followed by the latter.
    """
    rising = np.maximum.accumulate(keys)
    return np.argsort(np.concatenate([rising, births]), kind="stable").astype(np.int64)

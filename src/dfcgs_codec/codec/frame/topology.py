"""The topology of a frame: who goes, who comes, in which order (spec section 15)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from dfcgs_codec.array_types import Int64
from dfcgs_codec.bitstream.constants import ChunkType
from dfcgs_codec.bitstream.topology_header import TopologyHeader
from dfcgs_codec.codec.columns.coder import SymbolCoder
from dfcgs_codec.codec.columns.column import code_permutation
from dfcgs_codec.codec.frame.chunks import FrameCoder
from dfcgs_codec.codec.frame.gof_state import GofState
from dfcgs_codec.codec.intra.walk import IntraGoal, IntraShape, code_intra
from dfcgs_codec.codec.state.planes import FrameState
from dfcgs_codec.entropy.symbols import Groups, code_with_models
from dfcgs_codec.errors import CorruptBitstream
from dfcgs_codec.transform.lod import order_levels


@dataclass(frozen=True)
class TopologyGoal:
    """What an encoder wants of a TOPOLOGY chunk.

    `header` without places; `kept` int64: rows of the reference frame that survive, ascending; `births`: like
    an I-frame. `inputs` int64: where survivors, then births, are to stand in the output; None: as they come.
    """

    header: TopologyHeader
    kept: Int64
    births: IntraGoal | None = None
    inputs: Int64 | None = None


@dataclass(frozen=True)
class Topology:
    """Rows that are `kept`, `births`, their rows among survivors (see FrameState.merge), output order."""

    kept: Int64
    births: FrameState | None
    source: Int64 | None
    places: Int64 | None

    def complete(self, survivors: GofState) -> GofState:
        """The survivors after their frame, with births, all in their places."""
        state = survivors
        if self.births is not None and self.source is not None:
            state = state.with_births(self.births, self.source)
        return state if self.places is None else state.in_places(self.places)


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
    frame: FrameCoder, goal: TopologyGoal | None, before: GofState
) -> tuple[Topology, GofState]:
    """The TOPOLOGY chunk; what it says, and the survivors of `before`."""
    count = before.frame.num_gaussians
    read = partial(TopologyHeader.read, num_gaussians=count)
    chunk = frame.chunk(ChunkType.TOPOLOGY, read, None if goal is None else goal.header)
    header, kept = chunk.header, np.arange(count)
    if header.num_removals:
        known = None if goal is None else goal.kept
        kept = _code_removals(chunk.next(), known, count, header.num_removals)
    survivors = before.survivors(kept)
    births, source, places = None, None, None
    if header.sort_grid is not None and header.steps is not None:
        units = frame.sequence.unit_exponents
        shape = IntraShape(header.num_births, False, header.sort_grid, header.steps, units)
        births = code_intra(chunk.next, None if goal is None else goal.births, shape)
        source = survivors.places_of_births(births)
    expected = survivors.expected_places(source)
    if goal is not None and goal.inputs is not None:
        places = goal.inputs if source is None else goal.inputs[source]
        chunk.header = header = replace(header, has_permutation=not np.array_equal(places, expected))
    if header.has_permutation:
        places = code_permutation(chunk.next(), places, order_levels(len(expected)), expected)
    chunk.close()
    return Topology(kept, births, source, places if header.has_permutation else None), survivors

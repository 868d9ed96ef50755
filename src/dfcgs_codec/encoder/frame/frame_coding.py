"""One frame to chunks: symbols through the shared walk, state through the shared reconstruction."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from dfcgs_codec.array_types import Int64
from dfcgs_codec.bitstream.constants import STATE_COLUMNS, Attribute, ChunkType, IntraKind, Tool
from dfcgs_codec.bitstream.container import write_chunk
from dfcgs_codec.bitstream.frame_headers import (
    InterHeader,
    IntraHeader,
    SortGrid,
    coded_attributes,
)
from dfcgs_codec.bitstream.io import ByteWriter
from dfcgs_codec.bitstream.sequence_header import UnitExponents
from dfcgs_codec.bitstream.topology_header import TopologyHeader
from dfcgs_codec.codec.frame.gof_state import GofSetup, GofState
from dfcgs_codec.codec.frame.reconstruct import reconstruct_inter
from dfcgs_codec.codec.frame.topology import TopologySymbols, code_places, code_topology
from dfcgs_codec.codec.intra.verbatim import VerbatimSymbols, code_verbatim
from dfcgs_codec.codec.intra.walk import IntraShape, code_intra
from dfcgs_codec.codec.motion.walk import code_motion
from dfcgs_codec.codec.residual.classes import InterSymbols
from dfcgs_codec.codec.residual.walk import InterShape, code_inter
from dfcgs_codec.codec.state.planes import FrameState, Plane, empty_state, verbatim_columns
from dfcgs_codec.encoder.columns.streams import Streams
from dfcgs_codec.encoder.intra.intra_plan import IntraTarget
from dfcgs_codec.encoder.motion.motion_choice import MotionTrial


@dataclass(frozen=True)
class CodedFrame:
    """A frame's chunks, and what a decoder will hold after it.

    `source`: which row of survivors, then births, stands where; None where there are no births.
    """

    data: bytes
    kind: str
    state: GofState
    source: Int64 | None = None


@dataclass(frozen=True)
class ResidualCoding:
    """Steps of a P-frame's residual in grid units, and the weights at which Gaussians have just these.

    Attributes without a `visibility` have these everywhere.
    """

    steps: dict[Attribute, int]
    visibility: dict[Attribute, int] = field(default_factory=dict)

    def of(self, attributes: list[Attribute]) -> ResidualCoding:
        """That of some of the attributes."""
        steps = {attribute: self.steps[attribute] for attribute in attributes}
        levels = {attribute: self.visibility[attribute] for attribute in attributes if self.visibility}
        return replace(self, steps=steps, visibility=levels)


@dataclass(frozen=True)
class CodedTopology:
    """Header and streams of a TOPOLOGY chunk without places, and the Gaussians that come."""

    header: TopologyHeader
    streams: list[bytes]
    born: FrameState | None


@dataclass(frozen=True)
class TopologyChange:
    """Who goes and comes in a frame, of `num_before` Gaussians; `births`: how births are coded, if any come.

    `inputs`: index in the input of survivors, then births, where the output is to come in that order;
    `memo`: what `coded` found.
    """

    kept: Int64
    num_before: int
    births: IntraTask | None
    inputs: Int64 | None = None
    memo: list[CodedTopology] = field(default_factory=list, init=False, compare=False, repr=False)

    @property
    def num_births(self) -> int:
        """How many come."""
        return 0 if self.births is None else self.births.count

    def coded(self, units: UnitExponents) -> CodedTopology:
        """Coded once for all motions that are tried: they change nothing here."""
        if not self.memo:
            births, streams = self.births, Streams()
            grid, steps = (None, None) if births is None else (births.grid, births.target.steps)
            num_removals = self.num_before - len(self.kept)
            header = TopologyHeader(num_removals, False, self.num_births, grid, steps)
            symbols = TopologySymbols(self.kept, None if births is None else births.target)
            _, born = code_topology(streams.next, symbols, header, (self.num_before, units))
            self.memo.append(CodedTopology(header, streams.finish(), born))
        return self.memo[0]


def _intra_chunk(frame_index: int, header: IntraHeader, streams: list[bytes]) -> bytes:
    writer = ByteWriter()
    header.write(writer)
    for stream in streams:
        writer.raw(stream)
    return write_chunk(ChunkType.INTRA_FRAME, frame_index, writer.getvalue())


@dataclass(frozen=True)
class IntraTask:
    """An I-frame, or births, to be coded: what is wanted, and the sort grid."""

    target: IntraTarget
    grid: SortGrid

    @property
    def count(self) -> int:
        """N."""
        return len(self.target.positions)


def code_intra_frame(frame_index: int, task: IntraTask, setup: GofSetup) -> CodedFrame:
    """A `coded` I-frame."""
    target, streams = task.target, Streams()
    permuted = target.permutation is not None
    shape = IntraShape(task.count, permuted, task.grid, target.steps, setup.units)
    state = code_intra(streams.next, target, shape)
    coded = streams.finish()
    lengths, kind = tuple(map(len, coded)), IntraKind.CODED
    header = IntraHeader(
        state.hash(), kind, task.count, permuted, setup.control, task.grid, target.steps, lengths
    )
    chunk = _intra_chunk(frame_index, header, coded)
    return CodedFrame(chunk, "I", GofState.of_intra(state, setup, target.steps))


def code_empty_frame(frame_index: int, attributes: list[Attribute], setup: GofSetup) -> CodedFrame:
    """An I-frame without Gaussians."""
    state = empty_state(attributes)
    chunk = _intra_chunk(frame_index, IntraHeader.empty(state.hash()), [])
    return CodedFrame(chunk, "I", GofState.of_intra(state, setup, None))


def code_repetition(frame_index: int, before: GofState) -> CodedFrame:
    """A P-frame that is as the frame that left `before`."""
    writer = ByteWriter()
    InterHeader(before.frame.hash(), frozenset(), {}).write(writer)
    return CodedFrame(write_chunk(ChunkType.INTER_FRAME, frame_index, writer.getvalue()), "skip", before)


def code_verbatim_frame(
    frame_index: int, state: FrameState, permutation: Int64 | None, setup: GofSetup
) -> CodedFrame:
    """A `ply` I-frame; `state` is that of its float values, in canonical order."""
    assert state.verbatim is not None
    count = state.num_gaussians
    permuted = permutation is not None
    streams = Streams()
    widths = [STATE_COLUMNS[a] for a in coded_attributes(state.verbatim.sh_degree)]
    symbols = VerbatimSymbols(verbatim_columns(state.verbatim), permutation)
    code_verbatim(streams.next, symbols, widths, (count, permuted))
    order = None if permutation is None else Plane(permutation[:, None])
    ordered = FrameState(state.planes, order, state.verbatim)
    coded = streams.finish()
    lengths = tuple(map(len, coded))
    header = IntraHeader(ordered.hash(), IntraKind.PLY, count, permuted, setup.control, None, None, lengths)
    chunk = _intra_chunk(frame_index, header, coded)
    return CodedFrame(chunk, "I", GofState.of_intra(ordered, setup, None))


def _chunk_of_streams(kind: ChunkType, frame_index: int, head: ByteWriter, streams: list[bytes]) -> bytes:
    """A chunk whose streams fill the rest of its payload."""
    for stream in streams:
        head.uvarint(len(stream))
    for stream in streams:
        head.raw(stream)
    return write_chunk(kind, frame_index, head.getvalue())


def _motion_chunk(frame_index: int, before: GofState, trial: MotionTrial) -> bytes:
    writer = ByteWriter()
    trial.header.write(writer)
    motion, streams = before.motion(), Streams()
    shape = motion.shape(trial.header, before.model)
    code_motion(streams.next, trial.symbols, motion.symbols, shape)
    return _chunk_of_streams(ChunkType.MOTION, frame_index, writer, streams.finish())


def _residual_chunk(
    frame_index: int, symbols: InterSymbols, state: GofState, shape: InterShape
) -> tuple[bytes, InterSymbols]:
    """The chunk, and what is remembered of its symbols."""
    streams = Streams()
    coded = code_inter(streams.next, symbols, state.history, shape)
    return _chunk_of_streams(ChunkType.RESIDUAL, frame_index, ByteWriter(), streams.finish()), coded


def _topology(
    frame_index: int, change: TopologyChange, state: GofState
) -> tuple[bytes, GofState, Int64 | None]:
    """The chunk, and `state`, the survivors' after the frame, with births and all in their places."""
    coded = change.coded(state.visibility.units)
    header, born, source, places = coded.header, coded.born, None, None
    streams = Streams()
    if born is not None:
        source = state.places_of_births(born)
        state = state.with_births(born, source)
    if change.inputs is not None:
        places = change.inputs if source is None else change.inputs[source]
    if places is not None and not np.array_equal(places, state.expected_places()):
        header = replace(header, has_permutation=True)
        state = state.in_places(code_places(streams.next(), places, state.expected_places()))
    writer = ByteWriter()
    header.write(writer)
    chunk = _chunk_of_streams(ChunkType.TOPOLOGY, frame_index, writer, coded.streams + streams.finish())
    return chunk, state, source


def code_inter_frame(
    frame_index: int,
    symbols: InterSymbols,
    before: GofState,
    coding: ResidualCoding,
    trial: MotionTrial | None = None,
    change: TopologyChange | None = None,
) -> CodedFrame:
    """A P-frame after the frame that left `before`.

    With a `change`, `before`, `symbols` and `trial` are those of the survivors.
    """
    used = coding.of(sorted(symbols.activity))
    chunks: list[bytes] = []
    modes, carried, source = None, None, None
    predicted = before.frame
    if trial is not None:
        chunks.append(_motion_chunk(frame_index, before, trial))
        predicted, modes = trial.carried.state, trial.symbols.modes
        carried = (trial.carried, trial.symbols)
    if used.steps:
        prior = before.prior(used.visibility, None if trial is None else trial.symbols)
        count = predicted.num_gaussians
        shape = InterShape(list(used.steps), count, before.levels, prior, modes)
        chunk, symbols = _residual_chunk(frame_index, symbols, before, shape)
        chunks.append(chunk)
    coarser = before.visibility.all_multipliers(used.visibility)
    frame = reconstruct_inter(symbols, used.steps, predicted, coarser)
    state = before.after(frame.on_grid() if chunks or change else frame, symbols, carried)
    if change is not None:
        chunk, state, source = _topology(frame_index, change, state)
        chunks.insert(0, chunk)
    present = {
        Tool.MOTION: trial is not None,
        Tool.TOPOLOGY: change is not None,
        Tool.VISIBILITY: bool(used.visibility),
    }
    tools = frozenset(tool for tool, is_used in present.items() if is_used)
    writer = ByteWriter()
    InterHeader(state.frame.hash(), tools, used.steps, used.visibility).write(writer)
    data = write_chunk(ChunkType.INTER_FRAME, frame_index, writer.getvalue()) + b"".join(chunks)
    return CodedFrame(data, "P" if chunks else "skip", state, source)

"""The walk of a frame: its chunks in their order, and what they make of the state (spec sections 5, 6 and 9).

Written once, for reading and writing: over a `FrameCoder`, which opens the chunks in its direction.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

from dfcgs_codec.bitstream.constants import STATE_COLUMNS, ChunkType, IntraKind, Tool
from dfcgs_codec.bitstream.escapes import Escapes
from dfcgs_codec.bitstream.frame_headers import (
    InterHeader,
    IntraHeader,
    NoFields,
    coded_attributes,
)
from dfcgs_codec.bitstream.motion_header import MotionHeader
from dfcgs_codec.codec.frame.chunks import ChunkCoder, FrameCoder
from dfcgs_codec.codec.frame.gof_state import GofState
from dfcgs_codec.codec.frame.reconstruct import reconstruct_inter
from dfcgs_codec.codec.frame.topology import Topology, TopologyGoal, code_topology
from dfcgs_codec.codec.intra.verbatim import VerbatimSymbols, code_verbatim, state_of_columns
from dfcgs_codec.codec.intra.walk import IntraGoal, IntraShape, code_intra
from dfcgs_codec.codec.motion.compensation import Carried
from dfcgs_codec.codec.motion.walk import MotionSymbols, code_motion
from dfcgs_codec.codec.residual.classes import InterSymbols
from dfcgs_codec.codec.residual.walk import InterShape, code_inter
from dfcgs_codec.codec.state.planes import FrameState, empty_state
from dfcgs_codec.errors import CorruptBitstream


@dataclass(frozen=True)
class IntraFrameGoal:
    """What an encoder wants of an I-frame: the header, but for the hash; what is `coded`, or `verbatim`."""

    header: IntraHeader
    coded: IntraGoal | None = None
    verbatim: VerbatimSymbols | None = None


@dataclass(frozen=True)
class MotionGoal:
    """A frame's motion as it is to be coded, and what it makes of the reference."""

    header: MotionHeader
    symbols: MotionSymbols
    carried: Carried


@dataclass(frozen=True)
class InterFrameGoal:
    """What an encoder wants of a P-frame: the header, but for the hash; symbols, motion, topology.

    With a `topology`, symbols and motion are those of the survivors.
    """

    header: InterHeader
    symbols: InterSymbols
    motion: MotionGoal | None = None
    topology: TopologyGoal | None = None


def code_intra_frame(frame: FrameCoder, goal: IntraFrameGoal | None) -> GofState:
    """The INTRA_FRAME chunk; the state after it."""
    sequence = frame.sequence
    chunk = frame.chunk(ChunkType.INTRA_FRAME, IntraHeader.read, None if goal is None else goal.header)
    header = chunk.header
    if not header.num_gaussians:
        state = empty_state(coded_attributes(sequence.sh_degree))
    elif header.kind == IntraKind.PLY:
        state = _verbatim(frame, chunk, None if goal is None else goal.verbatim)
    else:
        assert header.sort_grid is not None
        assert header.steps is not None
        count, units = header.num_gaussians, sequence.unit_exponents
        shape = IntraShape(count, header.has_permutation, header.sort_grid, header.steps, units)
        state = code_intra(chunk.next, None if goal is None else goal.coded, shape)
    chunk.close()
    return GofState.of_intra(state, header.control, header.steps, sequence.unit_exponents, frame.model)


def _verbatim(frame: FrameCoder, chunk: ChunkCoder[IntraHeader], given: VerbatimSymbols | None) -> FrameState:
    header, sequence = chunk.header, frame.sequence
    widths = [STATE_COLUMNS[a] for a in coded_attributes(sequence.sh_degree)]
    found = code_verbatim(chunk.next, given, widths, (header.num_gaussians, header.has_permutation))
    return state_of_columns(found, sequence.unit_exponents)


def code_inter_frame(
    frame: FrameCoder, goal: InterFrameGoal | None, before: GofState
) -> tuple[GofState, Topology | None]:
    """All chunks of a P-frame of profile MAIN, but for escapes; the state after it, and who went and came."""
    header = code_inter_header(frame, None if goal is None else goal.header, before)
    state, topology, carried = before, None, None
    if Tool.TOPOLOGY in header.tools:
        topology, state = code_topology(frame, None if goal is None else goal.topology, before)
    if Tool.MOTION in header.tools:
        carried = _motion(frame, None if goal is None else goal.motion, state)
    symbols = InterSymbols()
    if header.steps:
        known = None if goal is None else goal.symbols
        symbols = _residual(frame, known, header, (state, None if carried is None else carried[1]))
    predicted = state.frame if carried is None else carried[0].state
    coarser = state.visibility.all_multipliers(header.visibility)
    decoded = reconstruct_inter(symbols, header.steps, predicted, coarser)
    state = state.after(decoded.on_grid() if header.changes else decoded, symbols, carried)
    return state if topology is None else topology.complete(state), topology


def code_inter_header(frame: FrameCoder, given: InterHeader | None, before: GofState) -> InterHeader:
    """The INTER_FRAME chunk; only a frame with Gaussians can change."""
    chunk = frame.chunk(ChunkType.INTER_FRAME, InterHeader.read, given)
    chunk.close()
    if chunk.header.changes and not before.frame.num_gaussians:
        raise CorruptBitstream("a P-frame that changes a frame without Gaussians")
    return chunk.header


def _motion(frame: FrameCoder, goal: MotionGoal | None, state: GofState) -> tuple[Carried, MotionSymbols]:
    motion = state.motion()
    chunk = frame.chunk(ChunkType.MOTION, MotionHeader.read, None if goal is None else goal.header)
    shape, known = motion.shape(chunk.header, state.model), None if goal is None else goal.symbols
    symbols = code_motion(chunk.next, known, motion.symbols, shape)
    chunk.close()
    return motion.carry(chunk.header, symbols, state.frame) if goal is None else goal.carried, symbols


def _residual(
    frame: FrameCoder,
    known: InterSymbols | None,
    header: InterHeader,
    reference: tuple[GofState, MotionSymbols | None],
) -> InterSymbols:
    """Symbols of the attributes that have steps; `reference`: the state, and its motion."""
    state, moved = reference
    attributes = sorted(header.steps)
    residual = NoFields([attribute.name for attribute in attributes])
    chunk = frame.chunk(ChunkType.RESIDUAL, lambda *_: residual, residual)
    prior, modes = state.prior(header.visibility, moved), None if moved is None else moved.modes
    shape = InterShape(attributes, state.frame.num_gaussians, state.levels, prior, modes)
    symbols = code_inter(chunk.next, known, state.history, shape)
    chunk.close()
    return symbols


def code_escapes(frame: FrameCoder, given: Escapes | None, state: GofState) -> GofState:
    """The ESCAPES chunk, behind all others; with its values."""
    read = partial(Escapes.read, num_gaussians=state.frame.num_gaussians)
    chunk = frame.chunk(ChunkType.ESCAPES, read, given)
    chunk.close()
    return replace(state, frame=replace(state.frame, escapes=chunk.header))

"""One frame to chunks: symbols through the shared walk, state through the shared reconstruction."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from dfcgs_codec.bitstream.constants import STATE_COLUMNS, Attribute, ChunkType, IntraKind, Tool
from dfcgs_codec.bitstream.container import write_chunk
from dfcgs_codec.bitstream.frame_headers import (
    ControlHeader,
    InterHeader,
    IntraHeader,
    SortGrid,
    coded_attributes,
)
from dfcgs_codec.bitstream.io import ByteWriter
from dfcgs_codec.codec.compensation import ControlSource, GofMotion
from dfcgs_codec.codec.dpb import FrameState, Plane, verbatim_columns
from dfcgs_codec.codec.inter import InterShape, InterSymbols, code_inter
from dfcgs_codec.codec.intra import IntraShape, IntraSymbols, code_intra
from dfcgs_codec.codec.motion import code_motion
from dfcgs_codec.codec.reconstruct import gof_levels, reconstruct_inter, reconstruct_intra
from dfcgs_codec.codec.verbatim import VerbatimSymbols, code_verbatim
from dfcgs_codec.encoder.motion_choice import MotionTrial
from dfcgs_codec.encoder.streams import Streams
from dfcgs_codec.transform.lod import GofLevels

Int64 = npt.NDArray[np.int64]


@dataclass(frozen=True)
class CodedFrame:
    """A frame's chunks, the state that a decoder will have, and the symbols for the next frame."""

    data: bytes
    kind: str
    state: FrameState
    levels: GofLevels
    control: ControlSource
    history: InterSymbols = field(default_factory=InterSymbols)
    moved: GofMotion | None = None

    def motion(self) -> GofMotion:
        """The motion of the GoF so far."""
        return self.moved or self.control.motion()


def _source(state: FrameState, control: ControlHeader) -> ControlSource:
    return ControlSource(state.planes[Attribute.POSITION], control)


def _intra_chunk(frame_index: int, header: IntraHeader, streams: list[bytes]) -> bytes:
    writer = ByteWriter()
    header.write(writer)
    for stream in streams:
        writer.raw(stream)
    return write_chunk(ChunkType.INTRA_FRAME, frame_index, writer.getvalue())


def code_intra_frame(
    frame_index: int,
    symbols: IntraSymbols,
    grid: SortGrid,
    steps: dict[Attribute, int],
    control: ControlHeader,
) -> CodedFrame:
    """A `coded` I-frame."""
    attributes = sorted(symbols.planes)
    count = len(symbols.planes[Attribute.POSITION])
    permuted = symbols.permutation is not None
    streams = Streams()
    code_intra(streams.next, symbols, IntraShape(count, attributes, permuted, grid))
    used = {attribute: steps[attribute] for attribute in attributes}
    state = reconstruct_intra(symbols, used)
    coded = streams.finish()
    lengths = tuple(map(len, coded))
    header = IntraHeader(state.hash(), IntraKind.CODED, count, permuted, control, grid, used, lengths)
    chunk = _intra_chunk(frame_index, header, coded)
    return CodedFrame(chunk, "I", state, gof_levels(state, used), _source(state, control))


def code_verbatim_frame(
    frame_index: int, state: FrameState, permutation: Int64 | None, control: ControlHeader
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
    header = IntraHeader(ordered.hash(), IntraKind.PLY, count, permuted, control, None, {}, lengths)
    chunk = _intra_chunk(frame_index, header, coded)
    return CodedFrame(chunk, "I", ordered, gof_levels(ordered, {}), _source(ordered, control))


def _chunk_of_streams(kind: ChunkType, frame_index: int, head: ByteWriter, streams: list[bytes]) -> bytes:
    """A chunk whose streams fill the rest of its payload."""
    for stream in streams:
        head.uvarint(len(stream))
    for stream in streams:
        head.raw(stream)
    return write_chunk(kind, frame_index, head.getvalue())


def _motion_chunk(frame_index: int, motion: GofMotion, trial: MotionTrial, block_log2: int) -> bytes:
    writer = ByteWriter()
    trial.header.write(writer)
    streams = Streams()
    shape = motion.shape(trial.header, block_log2)
    code_motion(streams.next, trial.symbols, motion.history(block_log2), shape)
    return _chunk_of_streams(ChunkType.MOTION, frame_index, writer, streams.finish())


def code_inter_frame(
    frame_index: int,
    symbols: InterSymbols,
    before: CodedFrame,
    coding: tuple[dict[Attribute, int], int],
    trial: MotionTrial | None = None,
) -> CodedFrame:
    """A P-frame after the frame `before`, moved by `trial`; `coding` is (steps, block_log2)."""
    steps, block_log2 = coding
    used = {attribute: steps[attribute] for attribute in sorted(symbols.activity)}
    predicted = before.state if trial is None else trial.carried.state
    state = reconstruct_inter(symbols, used, predicted)
    tools = frozenset([Tool.MOTION] if trial else [])
    writer = ByteWriter()
    InterHeader(state.hash(), tools, block_log2, used).write(writer)
    data = write_chunk(ChunkType.INTER_FRAME, frame_index, writer.getvalue())
    moved, activity = before.moved, None
    if trial is not None:
        motion = before.motion()
        data += _motion_chunk(frame_index, motion, trial, block_log2)
        moved = motion.after(trial.carried, trial.symbols, (before.state, state))
        activity = trial.symbols.activity()
    if used:
        streams = Streams()
        shape = InterShape(list(used), state.num_gaussians, block_log2, before.levels, activity)
        code_inter(streams.next, symbols, before.history, shape)
        data += _chunk_of_streams(ChunkType.RESIDUAL, frame_index, ByteWriter(), streams.finish())
    kind = "P" if used or tools else "skip"
    return CodedFrame(data, kind, state, before.levels, before.control, symbols, moved)

"""One frame to chunks: symbols through the shared walk, state through the shared reconstruction."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from dfcgs_codec.bitstream.constants import STATE_COLUMNS, Attribute, ChunkType, IntraKind
from dfcgs_codec.bitstream.container import write_chunk
from dfcgs_codec.bitstream.frame_headers import InterHeader, IntraHeader, SortGrid, coded_attributes
from dfcgs_codec.bitstream.io import ByteWriter
from dfcgs_codec.codec.dpb import FrameState, Plane, verbatim_columns
from dfcgs_codec.codec.inter import InterShape, InterSymbols, code_inter
from dfcgs_codec.codec.intra import IntraShape, IntraSymbols, code_intra
from dfcgs_codec.codec.reconstruct import gof_levels, reconstruct_inter, reconstruct_intra
from dfcgs_codec.codec.verbatim import VerbatimSymbols, code_verbatim
from dfcgs_codec.encoder.symbol_writer import SymbolWriter
from dfcgs_codec.transform.lod import GofLevels

Int64 = npt.NDArray[np.int64]


@dataclass(frozen=True)
class CodedFrame:
    """A frame's chunks, the state that a decoder will have, and the symbols for the next frame."""

    data: bytes
    kind: str
    state: FrameState
    levels: GofLevels
    history: InterSymbols = field(default_factory=InterSymbols)


class _Streams:
    """Collects the streams of a payload."""

    def __init__(self) -> None:
        self._writers: list[SymbolWriter] = []

    def next(self) -> SymbolWriter:
        """A writer for the next stream."""
        self._writers.append(SymbolWriter())
        return self._writers[-1]

    def finish(self) -> list[bytes]:
        """All streams."""
        return [writer.getvalue() for writer in self._writers]


def _intra_chunk(frame_index: int, header: IntraHeader, streams: list[bytes]) -> bytes:
    writer = ByteWriter()
    header.write(writer)
    for stream in streams:
        writer.raw(stream)
    return write_chunk(ChunkType.INTRA_FRAME, frame_index, writer.getvalue())


def code_intra_frame(
    frame_index: int, symbols: IntraSymbols, grid: SortGrid, steps: dict[Attribute, int]
) -> CodedFrame:
    """A `coded` I-frame."""
    attributes = sorted(symbols.planes)
    count = len(symbols.planes[Attribute.POSITION])
    permuted = symbols.permutation is not None
    streams = _Streams()
    code_intra(streams.next, symbols, IntraShape(count, attributes, permuted, grid))
    used = {attribute: steps[attribute] for attribute in attributes}
    state = reconstruct_intra(symbols, used)
    coded = streams.finish()
    lengths = tuple(map(len, coded))
    header = IntraHeader(state.hash(), IntraKind.CODED, count, permuted, grid, used, lengths)
    chunk = _intra_chunk(frame_index, header, coded)
    return CodedFrame(chunk, "I", state, gof_levels(state, used))


def code_verbatim_frame(frame_index: int, state: FrameState, permutation: Int64 | None) -> CodedFrame:
    """A `ply` I-frame; `state` is that of its float values, in canonical order."""
    assert state.verbatim is not None
    count = state.num_gaussians
    permuted = permutation is not None
    streams = _Streams()
    widths = [STATE_COLUMNS[a] for a in coded_attributes(state.verbatim.sh_degree)]
    symbols = VerbatimSymbols(verbatim_columns(state.verbatim), permutation)
    code_verbatim(streams.next, symbols, widths, (count, permuted))
    order = None if permutation is None else Plane(permutation[:, None])
    ordered = FrameState(state.planes, order, state.verbatim)
    coded = streams.finish()
    lengths = tuple(map(len, coded))
    header = IntraHeader(ordered.hash(), IntraKind.PLY, count, permuted, None, {}, lengths)
    chunk = _intra_chunk(frame_index, header, coded)
    return CodedFrame(chunk, "I", ordered, gof_levels(ordered, {}))


def code_inter_frame(
    frame_index: int, symbols: InterSymbols, before: CodedFrame, coding: tuple[dict[Attribute, int], int]
) -> CodedFrame:
    """A P-frame after the frame `before`; `coding` is (steps, block_log2)."""
    steps, block_log2 = coding
    used = {attribute: steps[attribute] for attribute in sorted(symbols.activity)}
    state = reconstruct_inter(symbols, used, before.state)
    writer = ByteWriter()
    InterHeader(state.hash(), block_log2, used).write(writer)
    data = write_chunk(ChunkType.INTER_FRAME, frame_index, writer.getvalue())
    if not used:
        return CodedFrame(data, "skip", state, before.levels)
    streams = _Streams()
    shape = InterShape(list(used), state.num_gaussians, block_log2, before.levels)
    code_inter(streams.next, symbols, before.history, shape)
    residual = ByteWriter()
    coded = streams.finish()
    for stream in coded:
        residual.uvarint(len(stream))
    for stream in coded:
        residual.raw(stream)
    data += write_chunk(ChunkType.RESIDUAL, frame_index, residual.getvalue())
    return CodedFrame(data, "P", state, before.levels, symbols)

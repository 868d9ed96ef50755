"""Decoding the frames of a GoF, one after the other (spec sections 5, 6 and 9.3)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from dfcgs_codec.bitstream.constants import STATE_COLUMNS, Attribute, ChunkType, IntraKind, Tool
from dfcgs_codec.bitstream.container import ChunkHead, ContainerReader
from dfcgs_codec.bitstream.frame_headers import InterHeader, IntraHeader, coded_attributes
from dfcgs_codec.bitstream.io import ByteReader
from dfcgs_codec.bitstream.motion_header import MotionHeader
from dfcgs_codec.bitstream.sequence_header import SequenceHeader
from dfcgs_codec.codec.compensation import Carried, ControlSource, GofMotion
from dfcgs_codec.codec.dpb import FrameState, Plane
from dfcgs_codec.codec.inter import InterShape, InterSymbols, code_inter
from dfcgs_codec.codec.intra import IntraShape, code_intra
from dfcgs_codec.codec.motion import NUM_MOTION_STREAMS, MotionSymbols, code_motion
from dfcgs_codec.codec.reconstruct import gof_levels, reconstruct_inter, reconstruct_intra
from dfcgs_codec.codec.symbol_reader import SymbolReader
from dfcgs_codec.codec.verbatim import cloud_of_columns, code_verbatim, state_of
from dfcgs_codec.errors import CorruptBitstream, VerificationError
from dfcgs_codec.transform.lod import GofLevels


class _Streams:
    """Opens the streams of a payload one after the other and checks that each was used up."""

    def __init__(self, reader: ByteReader, lengths: tuple[int, ...]) -> None:
        self._reader = reader
        self._lengths = iter(lengths)
        self._open: SymbolReader | None = None
        if sum(lengths) != reader.remaining:
            raise CorruptBitstream("stream lengths do not fill the payload", offset=reader.offset)

    def next(self) -> SymbolReader:
        """The next stream's coder."""
        self.close()
        offset = self._reader.offset
        self._open = SymbolReader(self._reader.raw(next(self._lengths)), offset)
        return self._open

    def close(self) -> None:
        """Check the open stream."""
        if self._open is not None:
            self._open.finish()


def decode_intra(reader: ByteReader, header: IntraHeader, sequence: SequenceHeader) -> FrameState:
    """State of an I-frame; `reader` stands behind the header."""
    attributes = coded_attributes(sequence.sh_degree)
    streams = _Streams(reader, header.lengths)
    if header.kind == IntraKind.PLY:
        widths = [STATE_COLUMNS[a] for a in attributes]
        shape = (header.num_gaussians, header.has_permutation)
        verbatim = code_verbatim(streams.next, None, widths, shape)
        streams.close()
        state = state_of(cloud_of_columns(verbatim.columns), sequence.unit_exponents)
        order = None if verbatim.permutation is None else Plane(verbatim.permutation[:, None])
        return FrameState(state.planes, order, state.verbatim)
    assert header.sort_grid is not None
    symbols = code_intra(
        streams.next,
        None,
        IntraShape(header.num_gaussians, attributes, header.has_permutation, header.sort_grid),
    )
    streams.close()
    return reconstruct_intra(symbols, header.steps)


@dataclass(frozen=True)
class _Moved:
    """A P-frame's motion, decoded and applied."""

    motion: GofMotion
    symbols: MotionSymbols
    carried: Carried


class GofDecoder:
    """Decodes the frames of one GoF in turn; holds the reference and the previous frame's symbols."""

    def __init__(self, container: ContainerReader, check: bool) -> None:
        self._container = container
        self._sequence = container.sequence
        self._check = check
        self._reference: FrameState | None = None
        self._levels: GofLevels | None = None
        self._control: ControlSource | None = None
        self._motion: GofMotion | None = None
        self._history = InterSymbols()

    def intra(self, head: ChunkHead) -> FrameState:
        """Decode an INTRA_FRAME chunk."""
        reader = self._container.payload(head)
        header = IntraHeader.read(reader, self._sequence)
        self._history = InterSymbols()
        state = decode_intra(reader, header, self._sequence)
        self._levels = gof_levels(state, header.steps)
        self._control = ControlSource(state.planes[Attribute.POSITION], header.control)
        self._motion = None
        return self._keep(state, header.frame_hash, head)

    def inter(self, head: ChunkHead, next_chunk: Callable[[], ChunkHead]) -> FrameState:
        """Decode an INTER_FRAME chunk and the chunks that belong to it."""
        if self._reference is None or self._levels is None:
            raise CorruptBitstream("a P-frame without an I-frame before it", offset=head.offset)
        reader = self._container.payload(head)
        header = InterHeader.read(reader, self._sequence)
        reader.expect_end("the P-frame header")
        reference, moved = self._reference, None
        predicted = reference
        if Tool.MOTION in header.tools:
            moved = self._motion_chunk(head, next_chunk(), header.block_log2)
            predicted = moved.carried.state
        symbols = InterSymbols()
        if header.steps:
            activity = None if moved is None else moved.symbols.activity()
            shape = InterShape(
                sorted(header.steps), reference.num_gaussians, header.block_log2, self._levels, activity
            )
            symbols = self._residual(head, next_chunk(), shape)
        state = reconstruct_inter(symbols, header.steps, predicted)
        self._history = symbols
        if moved is not None:
            self._motion = moved.motion.after(moved.carried, moved.symbols, (reference, state))
        return self._keep(state, header.frame_hash, head)

    def _open(self, head: ChunkHead, chunk: ChunkHead, kind: ChunkType) -> ByteReader:
        """Payload of a chunk that belongs to the P-frame of `head`."""
        if chunk.chunk_type != kind or chunk.frame_index != head.frame_index:
            raise CorruptBitstream(f"a P-frame lacks its {kind.name} chunk", offset=chunk.offset)
        return self._container.payload(chunk)

    def _motion_chunk(self, head: ChunkHead, chunk: ChunkHead, block_log2: int) -> _Moved:
        assert self._reference is not None
        assert self._control is not None
        reader = self._open(head, chunk, ChunkType.MOTION)
        motion = self._motion or self._control.motion()
        header = MotionHeader.read(reader, motion.field.num_points)
        streams = _Streams(reader, tuple(reader.uvarint() for _ in range(NUM_MOTION_STREAMS)))
        shape = motion.shape(header, block_log2)
        symbols = code_motion(streams.next, None, motion.history(block_log2), shape)
        streams.close()
        return _Moved(motion, symbols, motion.carry(header, symbols, self._reference))

    def _residual(self, head: ChunkHead, chunk: ChunkHead, shape: InterShape) -> InterSymbols:
        reader = self._open(head, chunk, ChunkType.RESIDUAL)
        streams = _Streams(reader, tuple(reader.uvarint() for _ in shape.attributes))
        symbols = code_inter(streams.next, None, self._history, shape)
        streams.close()
        return symbols

    def _keep(self, state: FrameState, frame_hash: bytes, head: ChunkHead) -> FrameState:
        if self._check and state.hash() != frame_hash:
            raise VerificationError(
                f"frame {head.frame_index} decodes to other values than its encoder had: "
                "please report this file",
                offset=head.offset,
            )
        self._reference = state
        return state

"""Decoding: chunks to frames, with checksums and hashes checked (spec sections 3 to 7)."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import BinaryIO

from dfcgs_codec.bitstream.constants import STATE_COLUMNS, ChunkType, IntraKind, Profile
from dfcgs_codec.bitstream.container import ChunkHead, ContainerReader
from dfcgs_codec.bitstream.frame_headers import InterHeader, IntraHeader, coded_attributes
from dfcgs_codec.bitstream.io import ByteReader
from dfcgs_codec.bitstream.sequence_header import SequenceHeader
from dfcgs_codec.codec.dpb import FrameState, Plane, output
from dfcgs_codec.codec.inter import InterShape, InterSymbols, code_inter
from dfcgs_codec.codec.intra import IntraShape, code_intra
from dfcgs_codec.codec.reconstruct import gof_levels, reconstruct_inter, reconstruct_intra
from dfcgs_codec.codec.symbol_reader import SymbolReader
from dfcgs_codec.codec.verbatim import cloud_of_columns, code_verbatim, state_of
from dfcgs_codec.errors import CorruptBitstream, UnsupportedBitstream, VerificationError
from dfcgs_codec.gaussians import GaussianCloud
from dfcgs_codec.transform.lod import GofLevels


@dataclass(frozen=True)
class DecodedFrame:
    """One decoded frame: its place in the sequence, the number in its file name, its state."""

    index: int
    number: int
    state: FrameState
    sequence: SequenceHeader

    def cloud(self) -> GaussianCloud:
        """The frame's float32 values, in output order."""
        return output(self.state, self.sequence.unit_exponents)


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


class GofDecoder:
    """Decodes the frames of one GoF in turn; holds the reference and the previous frame's symbols."""

    def __init__(self, container: ContainerReader, check: bool) -> None:
        self._container = container
        self._sequence = container.sequence
        self._check = check
        self._reference: FrameState | None = None
        self._levels: GofLevels | None = None
        self._history = InterSymbols()

    def intra(self, head: ChunkHead) -> FrameState:
        """Decode an INTRA_FRAME chunk."""
        reader = self._container.payload(head)
        header = IntraHeader.read(reader, self._sequence)
        self._history = InterSymbols()
        state = decode_intra(reader, header, self._sequence)
        self._levels = gof_levels(state, header.steps)
        return self._keep(state, header.frame_hash, head)

    def inter(self, head: ChunkHead, next_chunk: Callable[[], ChunkHead]) -> FrameState:
        """Decode an INTER_FRAME chunk and the chunks that belong to it."""
        if self._reference is None or self._levels is None:
            raise CorruptBitstream("a P-frame without an I-frame before it", offset=head.offset)
        reader = self._container.payload(head)
        header = InterHeader.read(reader, self._sequence)
        reader.expect_end("the P-frame header")
        symbols = InterSymbols()
        if header.steps:
            shape = InterShape(
                sorted(header.steps), self._reference.num_gaussians, header.block_log2, self._levels
            )
            symbols = self._residual(head, next_chunk(), shape)
        state = reconstruct_inter(symbols, header.steps, self._reference)
        self._history = symbols
        return self._keep(state, header.frame_hash, head)

    def _residual(self, head: ChunkHead, residual: ChunkHead, shape: InterShape) -> InterSymbols:
        if residual.chunk_type != ChunkType.RESIDUAL or residual.frame_index != head.frame_index:
            raise CorruptBitstream("a P-frame lacks its residual chunk", offset=residual.offset)
        reader = self._container.payload(residual)
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


class SequenceDecoder:
    """Decodes a `.dgs` file; needs the file alone."""

    def __init__(self, file: BinaryIO, *, check: bool = True) -> None:
        self.container = ContainerReader(file)
        self.sequence = self.container.sequence
        self._check = check
        self._numbers = self.sequence.frame_numbers.expand()
        if self.sequence.profile != Profile.MAIN or self.sequence.model_id:
            raise UnsupportedBitstream(
                f"profile {self.sequence.profile.name} with model {self.sequence.model_id!r}: "
                "a newer decoder is needed"
            )

    def frames(self, start: int = 0, stop: int | None = None) -> Iterator[DecodedFrame]:
        """Frames start..stop - 1 as far as there are, decoding from the GoF that holds `start`."""
        stop = self.sequence.num_frames if stop is None else min(stop, self.sequence.num_frames)
        if start < 0 or stop < 0:
            raise ValueError(f"frames {start}:{stop}: frames are counted from 0")
        if start >= stop:
            return
        expected, offset = 0, None
        if start > 0 or stop < self.sequence.num_frames:
            entry = [e for e in self.container.index().entries if e.first_frame <= start][-1]
            expected, offset = entry.first_frame, entry.offset
        for frame in self.gof_frames(self.container.chunks(offset)):
            if frame.index != expected:
                raise CorruptBitstream(f"frame {expected} is missing")
            expected = frame.index + 1
            if frame.index >= start:
                yield frame
            if expected == stop and stop < self.sequence.num_frames:
                return
        if expected != self.sequence.num_frames:
            raise CorruptBitstream("fewer frames than the header says")

    def gof_frames(self, chunks: Iterator[ChunkHead]) -> Iterator[DecodedFrame]:
        """The frames whose chunks are given, beginning with an I-frame."""
        gof = GofDecoder(self.container, self._check)
        for head in chunks:
            if head.chunk_type in (ChunkType.INTRA_FRAME, ChunkType.INTER_FRAME):
                if head.frame_index >= self.sequence.num_frames:
                    raise CorruptBitstream("more frames than the header says", offset=head.offset)
                is_intra = head.chunk_type == ChunkType.INTRA_FRAME
                state = gof.intra(head) if is_intra else gof.inter(head, lambda: _next(chunks))
                number = self._numbers[head.frame_index]
                yield DecodedFrame(head.frame_index, number, state, self.sequence)
            else:
                self._side_chunk(head)

    def _side_chunk(self, head: ChunkHead) -> None:
        """Check chunks without a frame; those that need a newer decoder refuse."""
        if head.chunk_type in (ChunkType.HYPERPRIOR, ChunkType.MOTION, ChunkType.TOPOLOGY):
            raise UnsupportedBitstream(
                f"chunk {ChunkType(head.chunk_type).name} needs a newer decoder", offset=head.offset
            )
        if head.chunk_type in (ChunkType.SEQUENCE_HEADER, ChunkType.RESIDUAL):
            raise CorruptBitstream("a chunk stands where it may not", offset=head.offset)
        self.container.payload(head)


def _next(chunks: Iterator[ChunkHead]) -> ChunkHead:
    head = next(chunks, None)
    if head is None:
        raise CorruptBitstream("the last P-frame lacks its residual chunk")
    return head

"""The writing direction of `FrameCoder`."""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from typing import Any, Generic

from dfcgs_codec.bitstream.constants import ChunkType
from dfcgs_codec.bitstream.container import write_chunk
from dfcgs_codec.bitstream.frame_headers import InterHeader, IntraHeader
from dfcgs_codec.bitstream.io import ByteReader, ByteWriter
from dfcgs_codec.bitstream.sequence_header import SequenceHeader
from dfcgs_codec.codec.frame.chunks import Header
from dfcgs_codec.encoder.columns.writer import SymbolWriter
from dfcgs_codec.model.context_model import ContextModel


class ChunkWriter(Generic[Header]):
    """A chunk being written; its `header` may change until its payload is asked for."""

    def __init__(self, kind: ChunkType, header: Header) -> None:
        self.kind, self.header = kind, header
        self._open: list[SymbolWriter] = []
        self._streams: list[bytes] = []

    def next(self) -> SymbolWriter:
        """See ChunkCoder."""
        self._open.append(SymbolWriter())
        return self._open[-1]

    def close(self) -> None:
        """See ChunkCoder."""
        self._streams, self._open = [writer.getvalue() for writer in self._open], []

    def payload(self) -> bytes:
        """Header, lengths of the streams where there may be several, streams."""
        writer = ByteWriter()
        self.header.write(writer)
        if self.header.streams(0) is not None:
            for stream in self._streams:
                writer.uvarint(len(stream))
        for stream in self._streams:
            writer.raw(stream)
        return writer.getvalue()


class FrameWriter:
    """Collects the chunks of a frame."""

    def __init__(self, sequence: SequenceHeader, model: ContextModel | None, frame_index: int) -> None:
        self.sequence, self.model = sequence, model
        self._index = frame_index
        self.chunks: list[ChunkWriter[Any]] = []

    def chunk(
        self,
        kind: ChunkType,
        read: Callable[[ByteReader, SequenceHeader], Header],
        given: Header | None,
    ) -> ChunkWriter[Header]:
        """See FrameCoder."""
        assert given is not None
        chunk = ChunkWriter(kind, given)
        self.chunks.append(chunk)
        return chunk

    def copy(self) -> FrameWriter:
        """One to which chunks may be added, and whose header may change."""
        other = FrameWriter(self.sequence, self.model, self._index)
        other.chunks = [copy(self.chunks[0]), *self.chunks[1:]]
        return other

    @property
    def header(self) -> IntraHeader | InterHeader:
        """That of the first chunk."""
        header: IntraHeader | InterHeader = self.chunks[0].header
        return header

    @header.setter
    def header(self, header: IntraHeader | InterHeader) -> None:
        self.chunks[0].header = header

    def data(self) -> bytes:
        """All chunks."""
        return b"".join(write_chunk(c.kind, self._index, c.payload()) for c in self.chunks)

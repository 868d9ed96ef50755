"""Chunks and files: framing, checksums, the index (spec sections 3 and 7)."""

from __future__ import annotations

import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from typing import BinaryIO

from dfcgs_codec.bitstream.constants import ANCILLARY_BIT, CRC_BYTES, FOREIGN_MAGIC, MAGIC, ChunkType
from dfcgs_codec.bitstream.index import End, Index, IndexEntry
from dfcgs_codec.bitstream.io import ByteReader, ByteWriter
from dfcgs_codec.bitstream.sequence_header import SequenceHeader
from dfcgs_codec.errors import (
    CorruptBitstream,
    NotADgsFile,
    TruncatedBitstream,
    UnsupportedBitstream,
)

#: type, frame index and length never take more
_MAX_HEAD_BYTES = 21
_END_CHUNK_BYTES = 1 + 1 + 1 + 8 + CRC_BYTES


@dataclass(frozen=True)
class ChunkHead:
    """Frame of a chunk: where it is and how long; the payload is not read."""

    chunk_type: int
    frame_index: int
    offset: int
    payload_offset: int
    payload_length: int

    @property
    def end(self) -> int:
        """First byte after the chunk."""
        return self.payload_offset + self.payload_length + CRC_BYTES

    @property
    def is_ancillary(self) -> bool:
        """Unknown chunks with this flag are skipped, others refused."""
        return bool(self.chunk_type & ANCILLARY_BIT)


def write_chunk(chunk_type: int, frame_index: int, payload: bytes) -> bytes:
    """A whole chunk with its checksum."""
    writer = ByteWriter()
    writer.u8(chunk_type)
    writer.uvarint(frame_index)
    writer.uvarint(len(payload))
    writer.raw(payload)
    writer.u32(zlib.crc32(writer.getvalue()))
    return writer.getvalue()


class ContainerReader:
    """Reads chunks of a seekable binary file."""

    def __init__(self, file: BinaryIO) -> None:
        self._file = file
        self.size = file.seek(0, 2)
        self._check_magic()
        self.sequence_head = self.head(len(MAGIC))
        if self.sequence_head.chunk_type != ChunkType.SEQUENCE_HEADER:
            raise CorruptBitstream("the first chunk is not a sequence header", offset=len(MAGIC))
        reader = self.payload(self.sequence_head)
        self.sequence = SequenceHeader.read(reader)
        reader.expect_end("the sequence header")

    def _check_magic(self) -> None:
        self._file.seek(0)
        start = self._file.read(len(MAGIC))
        if start[: len(FOREIGN_MAGIC)] == FOREIGN_MAGIC:
            raise NotADgsFile(
                "a .dgs file of the dgs-py package (magic 'glps'), not of dfcgs: open it with that package"
            )
        if start.startswith(b"ply"):
            raise NotADgsFile("a PLY frame, not a dfcgs file: encode the folder that it is in")
        if not MAGIC.startswith(start):
            raise NotADgsFile(f"not a dfcgs file: it starts with {start!r}, expected {MAGIC!r}")
        if len(start) < len(MAGIC):
            raise TruncatedBitstream("the file ends inside its magic number", offset=len(start))

    def head(self, offset: int) -> ChunkHead:
        """Frame of the chunk at byte `offset`; checks that its bytes exist."""
        self._file.seek(offset)
        reader = ByteReader(self._file.read(_MAX_HEAD_BYTES), offset)
        chunk_type, frame_index, length = reader.u8(), reader.uvarint(), reader.uvarint()
        head = ChunkHead(chunk_type, frame_index, offset, reader.offset, length)
        if head.end > self.size:
            raise TruncatedBitstream(
                f"the chunk at byte {offset} needs {head.end - self.size} bytes more than the file has",
                offset=self.size,
            )
        return head

    def payload(self, head: ChunkHead) -> ByteReader:
        """The payload, after its checksum was found right."""
        self._file.seek(head.offset)
        data = self._file.read(head.end - head.offset)
        if zlib.crc32(data[:-CRC_BYTES]) != int.from_bytes(data[-CRC_BYTES:], "little"):
            raise CorruptBitstream("wrong checksum: the file is damaged here", offset=head.offset)
        start = head.payload_offset - head.offset
        return ByteReader(memoryview(data)[start:-CRC_BYTES], head.payload_offset, CorruptBitstream)

    def peek(self, head: ChunkHead, count: int) -> ByteReader:
        """The first `count` payload bytes, unchecked; for listing only."""
        self._file.seek(head.payload_offset)
        data = self._file.read(min(count, head.payload_length))
        return ByteReader(data, head.payload_offset, CorruptBitstream)

    def occurrences(self, value: int, start: int, block_bytes: int) -> Iterator[int]:
        """Where a byte of this value is, from byte `start` on; `block_bytes` are read at once."""
        while start < self.size:
            self._file.seek(start)
            block = self._file.read(block_bytes)
            found = block.find(value)
            while found >= 0:
                yield start + found
                found = block.find(value, found + 1)
            start += len(block)

    def chunks(self, start: int | None = None, stop: int | None = None) -> Iterator[ChunkHead]:
        """Known chunks from byte `start` on, through END or up to byte `stop`."""
        offset = self.sequence_head.end if start is None else start
        while stop is None or offset < stop:
            head = self.head(offset)
            offset = head.end
            if head.chunk_type in ChunkType.__members__.values():
                yield head
            elif head.is_ancillary:
                self.payload(head)  # skipped, but a damaged type must not pass for an unknown one
            else:
                raise UnsupportedBitstream(
                    f"chunk type {head.chunk_type:#x} is unknown: a newer decoder is needed",
                    offset=head.offset,
                )
            if head.chunk_type == ChunkType.END:
                if offset != self.size:
                    raise CorruptBitstream("bytes after the end chunk", offset=offset)
                return

    def index(self) -> Index:
        """The index, found through the END chunk at the end of the file."""
        tail = self.size - _END_CHUNK_BYTES
        self._file.seek(max(tail, 0))
        if tail < self.sequence_head.end or self._file.read(3) != bytes((ChunkType.END, 0, 8)):
            raise TruncatedBitstream("the end chunk is missing: the file is cut off", offset=self.size)
        end = self.head(tail)
        reader = self.payload(end)
        index_offset = End.read(reader).index_offset
        reader.expect_end("the end chunk")
        if not self.sequence_head.end <= index_offset < end.offset:
            raise CorruptBitstream("the end chunk points outside the file", offset=end.payload_offset)
        head = self.head(index_offset)
        if head.chunk_type != ChunkType.INDEX:
            raise CorruptBitstream("the end chunk does not point at the index", offset=index_offset)
        reader = self.payload(head)
        index = Index.read(reader, self.sequence)
        reader.expect_end("the index")
        if any(entry.offset >= index_offset for entry in index.entries):
            raise CorruptBitstream("the index points behind itself", offset=index_offset)
        return index


class ContainerWriter:
    """Writes a file chunk by chunk and its index at the end."""

    def __init__(self, file: BinaryIO, sequence: SequenceHeader) -> None:
        self._file = file
        self._entries: list[IndexEntry] = []
        self.size = 0
        self._put(MAGIC)
        writer = ByteWriter()
        sequence.write(writer)
        self.chunk(ChunkType.SEQUENCE_HEADER, 0, writer.getvalue())

    def _put(self, data: bytes) -> None:
        self._file.write(data)
        self.size += len(data)

    def chunk(self, chunk_type: int, frame_index: int, payload: bytes) -> None:
        """Append a chunk."""
        self._put(write_chunk(chunk_type, frame_index, payload))

    def gof(self, first_frame: int, frames: list[bytes]) -> None:
        """Append the chunks of a closed GoF, frame by frame, and remember where it starts."""
        self._entries.append(IndexEntry(first_frame, len(frames), self.size))
        for chunks in frames:
            self._put(chunks)

    def finish(self) -> None:
        """Index and end."""
        index_offset = self.size
        writer = ByteWriter()
        Index(tuple(self._entries)).write(writer)
        self.chunk(ChunkType.INDEX, 0, writer.getvalue())
        end = ByteWriter()
        End(index_offset).write(end)
        self.chunk(ChunkType.END, 0, end.getvalue())

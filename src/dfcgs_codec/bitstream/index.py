"""The index and the end of a file, `write` beside `read` (spec section 7)."""

from __future__ import annotations

from dataclasses import dataclass

from dfcgs_codec.bitstream.fields import read_bounded
from dfcgs_codec.bitstream.io import ByteReader, ByteWriter
from dfcgs_codec.bitstream.sequence_header import SequenceHeader
from dfcgs_codec.errors import CorruptBitstream


@dataclass(frozen=True)
class IndexEntry:
    """One GoF: its first frame, its frames, and the byte where its I-frame chunk starts."""

    first_frame: int
    num_frames: int
    offset: int


@dataclass(frozen=True)
class Index:
    """Payload of the INDEX chunk (spec section 7)."""

    entries: tuple[IndexEntry, ...]

    def write(self, writer: ByteWriter) -> None:
        """Count, then frames and bytes of each GoF."""
        writer.uvarint(len(self.entries))
        previous = 0
        for entry in self.entries:
            writer.uvarint(entry.num_frames)
            writer.uvarint(entry.offset - previous)
            previous = entry.offset

    @staticmethod
    def read(reader: ByteReader, sequence: SequenceHeader) -> Index:
        """Refuses an index that does not cover the sequence."""
        start = reader.offset
        entries = []
        first = offset = 0
        for _ in range(read_bounded(reader.uvarint, sequence.num_frames, "num_gofs", reader)):
            count = reader.uvarint()
            offset += reader.uvarint()
            entries.append(IndexEntry(first, count, offset))
            first += count
        if first != sequence.num_frames or any(e.num_frames == 0 for e in entries):
            raise CorruptBitstream("the index does not cover the sequence", offset=start)
        return Index(tuple(entries))


@dataclass(frozen=True)
class End:
    """Payload of the END chunk: where the INDEX chunk starts."""

    index_offset: int

    def write(self, writer: ByteWriter) -> None:
        """Eight bytes, so that the END chunk has a fixed size."""
        writer.u64(self.index_offset)

    @staticmethod
    def read(reader: ByteReader) -> End:
        """The offset."""
        return End(reader.u64())

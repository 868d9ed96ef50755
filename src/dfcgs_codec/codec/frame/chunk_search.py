"""Finding GoFs in a damaged file: chunk by chunk, through the index, or by their looks where that is gone."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

from dfcgs_codec.bitstream.constants import FRAME_CHUNKS, ChunkType
from dfcgs_codec.bitstream.container import ChunkHead, ContainerReader
from dfcgs_codec.bitstream.frame_headers import IntraHeader, read_lengths
from dfcgs_codec.codec.frame.headers import HEADER_BYTES
from dfcgs_codec.errors import BitstreamError, CorruptBitstream

#: bytes of a file that are searched at once
_BLOCK_BYTES = 1 << 20
#: a search gives up after so many times the bytes of the file were summed up
_MOST_SUMMED = 16


@dataclass
class FoundGof:
    """Whole chunks of a GoF, its I-frame first, up to the first damage, which `error` describes."""

    chunks: list[ChunkHead] = field(default_factory=list)
    error: BitstreamError | None = None


class ChunkSearch:
    """Looks for whole chunks; `error`: the first thing that is wrong with the file, if anything is."""

    def __init__(self, container: ContainerReader) -> None:
        self._container = container
        self._summed = 0
        self.error: BitstreamError | None = None
        try:
            self._starts: list[int] | None = [entry.offset for entry in container.index().entries]
        except BitstreamError as error:
            self._starts, self.error = None, error

    def gofs(self) -> Iterator[FoundGof]:
        """GoFs whose I-frame is whole, in the order of the file."""
        gof: FoundGof | None = None
        offset: int | None = self._container.sequence_head.end
        while offset is not None and offset < self._container.size:
            head, error = self._whole(offset)
            if head is None or error is not None:
                if gof is not None and (head is None or head.chunk_type in FRAME_CHUNKS):
                    gof.error = gof.error or error
                self.error = self.error or error
                offset = self._behind(offset, head)
                continue
            offset = head.end
            if head.chunk_type == ChunkType.INTRA_FRAME:
                if gof is not None:
                    yield gof
                gof = FoundGof()
            if gof is not None and gof.error is None and head.chunk_type in FRAME_CHUNKS:
                gof.chunks.append(head)
            if head.chunk_type == ChunkType.END:
                break
        if gof is not None:
            yield gof

    def _whole(self, offset: int) -> tuple[ChunkHead | None, BitstreamError | None]:
        """The chunk at `offset`, None where there is none, and what is wrong with it."""
        head = None
        try:
            head = self._container.head(offset)
            self._container.payload(head)
            if not head.is_ancillary and head.chunk_type not in ChunkType.__members__.values():
                return head, CorruptBitstream(f"chunk type {head.chunk_type:#x}", offset=offset)
        except BitstreamError as error:
            return head, error
        return head, None

    def _behind(self, offset: int, head: ChunkHead | None) -> int | None:
        """Where to go on behind the damaged chunk at `offset`: the next whole one, or the next I-frame."""
        if head is not None and self._whole(head.end)[1] is None:
            return head.end
        if self._starts is not None:
            return next((start for start in self._starts if start > offset), None)
        return self._search(offset + 1)

    def _search(self, start: int) -> int | None:
        for offset in self._container.occurrences(ChunkType.INTRA_FRAME, start, _BLOCK_BYTES):
            head = self._plausible(offset)
            if head is None:
                continue
            self._summed += head.payload_length
            if self._summed > _MOST_SUMMED * self._container.size:
                self.error = CorruptBitstream(
                    "too much that looks like an I-frame and is none", offset=offset
                )
                return None
            if self._whole(offset)[1] is None:
                return offset
        return None

    def _plausible(self, offset: int) -> ChunkHead | None:
        """The chunk at `offset` if its fields could be those of an I-frame; its checksum is not looked at."""
        container = self._container
        try:
            head = container.head(offset)
            if head.frame_index >= container.sequence.num_frames:
                return None
            reader = container.peek(head, HEADER_BYTES)
            header = IntraHeader.read(reader, container.sequence)
            lengths = read_lengths(reader, header.streams(container.sequence.sh_degree))
        except BitstreamError:
            return None
        rest = head.payload_length - (reader.offset - head.payload_offset)
        return head if sum(lengths.values()) == rest else None

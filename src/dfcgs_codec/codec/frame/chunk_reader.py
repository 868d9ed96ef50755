"""The reading direction of `FrameCoder`."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import chain
from typing import Generic

from dfcgs_codec.bitstream.constants import ChunkType
from dfcgs_codec.bitstream.container import ChunkHead, ContainerReader
from dfcgs_codec.bitstream.frame_headers import InterHeader, IntraHeader, read_lengths
from dfcgs_codec.bitstream.io import ByteReader
from dfcgs_codec.bitstream.motion_header import MotionHeader
from dfcgs_codec.bitstream.sequence_header import SequenceHeader
from dfcgs_codec.codec.columns.reader import SymbolReader
from dfcgs_codec.codec.frame.chunks import Header
from dfcgs_codec.codec.frame.limits import Budget
from dfcgs_codec.errors import CorruptBitstream
from dfcgs_codec.model.context_model import ContextModel


def missing_part(kind: ChunkType, found: ChunkHead | None) -> CorruptBitstream:
    """The error where another chunk, or none, is `found` in the place of one that a frame announces."""
    if found is None:
        return CorruptBitstream("the last frame lacks its other chunks")
    return CorruptBitstream(f"a frame lacks its {kind.name} chunk", offset=found.offset)


class ChunkReader(Generic[Header]):
    """A chunk whose `header` was read; `reader` stands behind it. `charge` is told the symbols of streams."""

    def __init__(
        self, header: Header, reader: ByteReader, sh_degree: int, charge: Callable[[int], None] | None
    ) -> None:
        self.header = header
        self._reader, self._charge = reader, charge
        self._open: SymbolReader | None = None
        names = header.streams(sh_degree)
        lengths = [] if names is None else list(read_lengths(reader, names).values())
        if names is None:
            lengths = [reader.remaining]
        elif sum(lengths) != reader.remaining:
            raise CorruptBitstream("stream lengths do not fill the payload", offset=reader.offset)
        self._lengths = iter(lengths)

    def next(self) -> SymbolReader:
        """See ChunkCoder."""
        self.close()
        offset = self._reader.offset
        self._open = SymbolReader(self._reader.raw(next(self._lengths)), offset)
        return self._open

    def close(self) -> None:
        """See ChunkCoder: checks the open stream."""
        if self._open is not None:
            self._open.finish()
            if self._charge is not None:
                self._charge(self._open.num_symbols)
            self._open = None


class FrameReader:
    """Reads the chunks of the frame that begins with `head`, `behind` it the others; charges `budget`.

    `header`: that of the first chunk.
    """

    header: IntraHeader | InterHeader

    def __init__(
        self,
        container: ContainerReader,
        head: ChunkHead,
        behind: Iterator[ChunkHead],
        model: ContextModel | None,
        budget: Budget,
    ) -> None:
        self.sequence, self.model = container.sequence, model
        self._container, self._budget = container, budget
        self._heads, self._index = chain([head], behind), head.frame_index

    def chunk(
        self,
        kind: ChunkType,
        read: Callable[[ByteReader, SequenceHeader], Header],
        given: Header | None,
    ) -> ChunkReader[Header]:
        """See FrameCoder; CorruptBitstream where the next chunk is another."""
        head = next(self._heads, None)
        if head is None:
            raise missing_part(kind, None)
        if head.chunk_type != kind or head.frame_index != self._index:
            raise missing_part(kind, head)
        self._budget.read(head.end - head.offset)
        reader = self._container.payload(head)
        header = read(reader, self.sequence)
        self._budget.chunk(self._index, header)
        if isinstance(header, IntraHeader | InterHeader):
            self.header = header
        counts = kind == ChunkType.RESIDUAL or isinstance(header, MotionHeader)
        charge = self._budget.symbols if counts else None
        return ChunkReader(header, reader, self.sequence.sh_degree, charge)

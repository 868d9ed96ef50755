"""`.dgs` files taken apart into chunks, and put together from others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from io import BytesIO

from dfcgs_codec.bitstream.constants import MAGIC, ChunkType
from dfcgs_codec.bitstream.container import ContainerReader, write_chunk
from dfcgs_codec.bitstream.index import Index, IndexEntry
from dfcgs_codec.bitstream.io import ByteWriter


@dataclass(frozen=True)
class Chunk:
    """Type, frame index and payload, for building other files."""

    chunk_type: int
    frame_index: int
    payload: bytes


def split_chunks(data: bytes) -> list[Chunk]:
    """All known chunks of a file, the sequence header first, without INDEX and END."""
    container = ContainerReader(BytesIO(data))
    heads = [container.sequence_head, *container.chunks()]
    kept = [h for h in heads if h.chunk_type not in (ChunkType.INDEX, ChunkType.END)]
    return [Chunk(h.chunk_type, h.frame_index, container.payload(h).raw(h.payload_length)) for h in kept]


def join_chunks(chunks: Sequence[Chunk], *, index: bytes | None = None, magic: bytes = MAGIC) -> bytes:
    """A file of these chunks with right checksums, an index (`index` replaces its payload) and an end."""
    data = magic
    starts: list[tuple[int, int]] = []
    for chunk in chunks:
        if chunk.chunk_type == ChunkType.INTRA_FRAME:
            starts.append((chunk.frame_index, len(data)))
        data += write_chunk(chunk.chunk_type, chunk.frame_index, chunk.payload)
    frames = [c.frame_index for c in chunks if c.chunk_type in (ChunkType.INTRA_FRAME, ChunkType.INTER_FRAME)]
    if index is None:
        writer = ByteWriter()
        ends = [first for first, _ in starts[1:]] + [max(frames, default=-1) + 1]
        entries = [IndexEntry(first, end - first, at) for (first, at), end in zip(starts, ends, strict=False)]
        Index(tuple(entries)).write(writer)
        index = writer.getvalue()
    end = len(data).to_bytes(8, "little")
    return data + write_chunk(ChunkType.INDEX, 0, index) + write_chunk(ChunkType.END, 0, end)

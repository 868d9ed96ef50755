"""The chunks of a file and their streams, from headers alone: nothing is entropy decoded."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from dfcgs_codec.bitstream.constants import ChunkType, Profile
from dfcgs_codec.bitstream.container import ChunkHead, ContainerReader
from dfcgs_codec.bitstream.frame_headers import InterHeader, IntraHeader, ResidualHeader, read_lengths
from dfcgs_codec.bitstream.motion_header import LatentHeader, MotionHeader
from dfcgs_codec.bitstream.topology_header import TopologyHeader
from dfcgs_codec.codec.frame.chunks import ChunkHeader

#: longer than the header of any chunk with the lengths of its streams
HEADER_BYTES = 512


class ListedChunk(NamedTuple):
    """A chunk, its header if it is a frame's, bytes of its streams by name, Gaussians of the frame."""

    head: ChunkHead
    header: ChunkHeader | None
    lengths: dict[str, int]
    num_gaussians: int


def listed_chunks(container: ContainerReader) -> Iterator[ListedChunk]:
    """All behind the sequence header; BitstreamError where a header does not make sense."""
    sequence, count = container.sequence, 0
    residual = ResidualHeader([])
    motion = LatentHeader.read if sequence.profile == Profile.PAPER else MotionHeader.read
    for head in container.chunks():
        reader = container.peek(head, HEADER_BYTES)
        header: ChunkHeader | None = None
        if head.chunk_type == ChunkType.INTRA_FRAME:
            header = intra = IntraHeader.read(reader, sequence)
            count = intra.num_gaussians
        elif head.chunk_type == ChunkType.INTER_FRAME:
            header = inter = InterHeader.read(reader, sequence)
            residual = ResidualHeader(sorted(inter.steps))
        elif head.chunk_type == ChunkType.TOPOLOGY:
            header = topology = TopologyHeader.read(reader, sequence, count)
            count += topology.num_births - topology.num_removals
        elif head.chunk_type == ChunkType.MOTION:
            header = motion(reader, sequence)
        elif head.chunk_type == ChunkType.RESIDUAL:
            header = residual
        names = None if header is None else header.streams(sequence.sh_degree)
        yield ListedChunk(head, header, read_lengths(reader, names or []), count)

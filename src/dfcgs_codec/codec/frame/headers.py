"""The chunks of a file and their streams, and what it asks of its decoder, from headers alone."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from dfcgs_codec.bitstream.constants import ChunkType, Profile
from dfcgs_codec.bitstream.container import ChunkHead, ContainerReader
from dfcgs_codec.bitstream.frame_headers import (
    InterHeader,
    IntraHeader,
    NoFields,
    coded_attributes,
    read_lengths,
)
from dfcgs_codec.bitstream.motion_header import LatentHeader, MotionHeader
from dfcgs_codec.bitstream.topology_header import TopologyHeader
from dfcgs_codec.codec.frame.chunks import ChunkHeader
from dfcgs_codec.codec.frame.limits import Budget, DecoderLimits
from dfcgs_codec.errors import ResourceLimit

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
    residual = NoFields([])
    motion = LatentHeader.read if sequence.profile == Profile.PAPER else MotionHeader.read
    for head in container.chunks():
        reader = container.peek(head, HEADER_BYTES)
        header: ChunkHeader | None = None
        if head.chunk_type == ChunkType.INTRA_FRAME:
            header = intra = IntraHeader.read(reader, sequence)
            count = intra.num_gaussians
        elif head.chunk_type == ChunkType.INTER_FRAME:
            header = inter = InterHeader.read(reader, sequence)
            residual = NoFields([attribute.name for attribute in sorted(inter.steps)])
        elif head.chunk_type == ChunkType.TOPOLOGY:
            header = topology = TopologyHeader.read(reader, sequence, count)
            count += topology.num_births - topology.num_removals
        elif head.chunk_type == ChunkType.MOTION:
            header = motion(reader, sequence)
        elif head.chunk_type == ChunkType.RESIDUAL:
            header = residual
        names = None if header is None else header.streams(sequence.sh_degree)
        yield ListedChunk(head, header, read_lengths(reader, names or []), count)


def beyond_default_limits(path: Path) -> ResourceLimit | None:
    """How decoders refuse the whole file at `path` by default; None where they take it."""
    with path.open("rb") as file:
        container = ContainerReader(file)
        budget = Budget(DecoderLimits(), coded_attributes(container.sequence.sh_degree))
        try:
            for head, header, *_ in listed_chunks(container):
                budget.read(head.end - head.offset)
                budget.chunk(head.frame_index, header)
        except ResourceLimit as refusal:
            return refusal
    return None

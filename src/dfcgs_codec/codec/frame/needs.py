"""What a file asks of its decoder, from its headers: do decoders take it by default?"""

from __future__ import annotations

from pathlib import Path

from dfcgs_codec.bitstream.constants import ChunkType
from dfcgs_codec.bitstream.container import ChunkHead, ContainerReader
from dfcgs_codec.bitstream.frame_headers import InterHeader, IntraHeader, coded_attributes
from dfcgs_codec.bitstream.io import ByteReader
from dfcgs_codec.bitstream.topology_header import TopologyHeader
from dfcgs_codec.codec.frame.limits import Budget, DecoderLimits
from dfcgs_codec.errors import ResourceLimit

#: longer than the header of any frame
_HEADER_BYTES = 512


class _Charging:
    """Charges one chunk after the other; symbols are not known."""

    def __init__(self, container: ContainerReader) -> None:
        self._container, self._sequence = container, container.sequence
        attributes = coded_attributes(self._sequence.sh_degree)
        self._budget = Budget(DecoderLimits(), attributes)
        self._count = 0

    def chunk(self, head: ChunkHead) -> None:
        """Charge one; ResourceLimit."""
        self._budget.read(head.end - head.offset)
        read = {
            ChunkType.INTRA_FRAME: self._intra,
            ChunkType.INTER_FRAME: self._inter,
            ChunkType.TOPOLOGY: self._topology,
        }.get(ChunkType(head.chunk_type))
        if read is not None:
            read(self._container.peek(head, _HEADER_BYTES), head.frame_index)

    def _intra(self, reader: ByteReader, frame: int) -> None:
        header = IntraHeader.read(reader, self._sequence)
        self._count = header.num_gaussians
        self._budget.intra(frame, self._count, header.control)

    def _inter(self, reader: ByteReader, frame: int) -> None:
        self._budget.inter(frame, self._count, InterHeader.read(reader, self._sequence))

    def _topology(self, reader: ByteReader, frame: int) -> None:
        header = TopologyHeader.read(reader, self._sequence)
        self._count += header.num_births - header.num_removals
        if header.num_births:
            self._budget.births(frame, header.num_births, self._count)


def beyond_default_limits(path: Path) -> ResourceLimit | None:
    """How decoders refuse the whole file at `path` by default; None where they take it."""
    with path.open("rb") as file:
        charging = _Charging(container := ContainerReader(file))
        try:
            for head in container.chunks():
                charging.chunk(head)
        except ResourceLimit as refusal:
            return refusal
    return None

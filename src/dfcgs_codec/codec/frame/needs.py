"""What a file asks of its decoder, from its headers: do decoders take it by default?"""

from __future__ import annotations

from pathlib import Path

from dfcgs_codec.bitstream.container import ContainerReader
from dfcgs_codec.bitstream.frame_headers import coded_attributes
from dfcgs_codec.codec.frame.headers import listed_chunks
from dfcgs_codec.codec.frame.limits import Budget, DecoderLimits
from dfcgs_codec.errors import ResourceLimit


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

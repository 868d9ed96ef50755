"""Getting what can be had out of a damaged file: every frame up to the damage in each GoF."""

from __future__ import annotations

from collections.abc import Iterator
from typing import BinaryIO

from dfcgs_codec.bitstream.constants import ChunkType
from dfcgs_codec.bitstream.container import ChunkHead
from dfcgs_codec.codec.decoder import DecodedFrame, SequenceDecoder
from dfcgs_codec.errors import BitstreamError, VerificationError


def _gofs(decoder: SequenceDecoder, losses: list[str]) -> list[list[ChunkHead]]:
    """Chunk heads of each GoF; a damaged head ends the search."""
    gofs: list[list[ChunkHead]] = []
    try:
        for head in decoder.container.chunks():
            if head.chunk_type == ChunkType.INTRA_FRAME:
                gofs.append([head])
            elif gofs and head.chunk_type not in (ChunkType.INDEX, ChunkType.END):
                gofs[-1].append(head)
    except BitstreamError as error:
        losses.append(f"{error}: nothing behind it can be found")
    return gofs


def salvage(file: BinaryIO, losses: list[str]) -> Iterator[DecodedFrame]:
    """All frames whose chunks, and those of their references, are whole and whose hashes are right.

    What is lost is described in `losses`. The sequence header must be whole: its error is raised.
    """
    decoder = SequenceDecoder(file)
    for gof in _gofs(decoder, losses):
        try:
            yield from decoder.gof_frames(iter(gof))
        except (BitstreamError, VerificationError) as error:
            losses.append(f"the rest of the GoF that begins with frame {gof[0].frame_index}: {error}")

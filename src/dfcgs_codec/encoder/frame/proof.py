"""The last look at a file before it gets its name: is it what a decoder will accept?"""

from __future__ import annotations

from typing import BinaryIO

from dfcgs_codec.bitstream.constants import ChunkType
from dfcgs_codec.bitstream.container import ContainerReader
from dfcgs_codec.bitstream.frame_headers import IntraHeader
from dfcgs_codec.bitstream.io import ByteReader
from dfcgs_codec.bitstream.sequence_header import SequenceHeader
from dfcgs_codec.encoder.frame.report import EncodeReport, FrameRecord
from dfcgs_codec.errors import BitstreamError, VerificationError

_FRAMES = {ChunkType.INTRA_FRAME: "I", ChunkType.INTER_FRAME: "P"}


def _check_intra(reader: ByteReader, sequence: SequenceHeader, frame: FrameRecord) -> None:
    """An I-frame's own header: as many Gaussians, of the sequence's SH degree, as were coded."""
    found = IntraHeader.read(reader, sequence).num_gaussians
    if found != frame.num_gaussians:
        raise VerificationError(f"frame {frame.number}: {found} Gaussians, not {frame.num_gaussians}")


def _walk(container: ContainerReader, report: EncodeReport) -> None:
    frames: list[int] = []
    gofs: list[tuple[int, int]] = []
    for head in container.chunks():
        reader = container.payload(head)
        if head.chunk_type in _FRAMES:
            frames.append(head.frame_index)
        if head.chunk_type == ChunkType.INTRA_FRAME:
            gofs.append((head.frame_index, head.offset))
            _check_intra(reader, container.sequence, report.frames[head.frame_index])
    if frames != list(range(len(report.frames))):
        raise VerificationError("its frames are not one after the other")
    if gofs != [(entry.first_frame, entry.offset) for entry in container.index().entries]:
        raise VerificationError("its index does not point at its I-frames")


def prove_written(file: BinaryIO, header: SequenceHeader, report: EncodeReport) -> None:
    """Read the whole file again: header, every checksum, order of frames, index. Nothing is entropy decoded.

    What is in the chunks is right by construction: encoder and decoder share the code that made it.
    VerificationError where the file is not as it should be.
    """
    file.flush()
    try:
        container = ContainerReader(file)
        if container.sequence != header:
            raise VerificationError("its header is not the one that was written")
        _walk(container, report)
    except (BitstreamError, VerificationError) as error:
        raise VerificationError(
            f"the file that was written does not read back: {error}; the disk, or this program, is at fault"
        ) from error

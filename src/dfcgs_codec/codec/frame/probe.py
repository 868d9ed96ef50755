"""What is in a file, from its headers alone: nothing is entropy decoded."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import Any, BinaryIO

from dfcgs_codec.arguments import AnyPath, path_of
from dfcgs_codec.bitstream.comments import PlyComments
from dfcgs_codec.bitstream.constants import (
    BITSTREAM_VERSION,
    FRAME_CHUNKS,
    STATE_COLUMNS,
    ChunkType,
)
from dfcgs_codec.bitstream.container import ChunkHead, ContainerReader
from dfcgs_codec.bitstream.frame_headers import InterHeader, IntraHeader, coded_attributes
from dfcgs_codec.bitstream.sequence_header import SequenceHeader
from dfcgs_codec.codec.frame.headers import HEADER_BYTES, listed_chunks
from dfcgs_codec.errors import CorruptBitstream

#: values of a PLY vertex that are not in the state: the normals
_NORMALS = 3


@dataclass
class FrameInfo:
    """One frame: bytes of its chunks, and of its streams by attribute."""

    frame_index: int
    frame_number: int
    frame_type: str
    num_gaussians: int
    num_bytes: int
    attribute_bytes: dict[str, int] = field(default_factory=dict)


@dataclass
class SequenceInfo:
    """What `probe` found; `chunks` is (type, frame_index, offset, length) of each."""

    header: SequenceHeader
    num_bytes: int
    encoder_info: str = ""
    frames: list[FrameInfo] = field(default_factory=list)
    chunk_bytes: Counter[str] = field(default_factory=Counter)
    chunks: list[tuple[str, int, int, int]] = field(default_factory=list)
    comments: list[bytes] = field(default_factory=list)

    @property
    def num_gaussians(self) -> int:
        """Gaussians of all frames together."""
        return sum(frame.num_gaussians for frame in self.frames)

    @property
    def ply_bytes(self) -> int:
        """Bytes of the frames as standard PLYs, their text headers left out."""
        columns = sum(STATE_COLUMNS[a] for a in coded_attributes(self.header.sh_degree)) + _NORMALS
        return 4 * columns * self.num_gaussians

    def bytes_by(self, key: str) -> Counter[str]:
        """Bytes by `frame_type`, or by `attribute`; what is not in streams counts as HEADERS."""
        total: Counter[str] = Counter()
        for frame in self.frames:
            if key == "frame_type":
                total[frame.frame_type] += frame.num_bytes
            else:
                total.update(frame.attribute_bytes)
        if key == "attribute":
            total["HEADERS"] = self.num_bytes - sum(total.values())
        return total

    def as_dict(self) -> dict[str, Any]:
        """For JSON; keys are the spec's element names."""
        header = self.header
        return {
            "bitstream_version": BITSTREAM_VERSION,
            "profile": header.profile.name.lower(),
            "level": header.level,
            "sh_degree": header.sh_degree,
            "output_order": header.output_order.name.lower(),
            "num_frames": header.num_frames,
            "frame_rate": list(header.frame_rate),
            "unit_exponents": vars(header.unit_exponents),
            "model_id": header.model_id,
            "encoder_info": self.encoder_info,
            "num_bytes": self.num_bytes,
            "ply_bytes": self.ply_bytes,
            "compression_ratio": round(self.ply_bytes / self.num_bytes, 4),
            "bits_per_gaussian": round(8 * self.num_bytes / max(1, self.num_gaussians), 4),
            "bytes_by_frame_type": dict(self.bytes_by("frame_type")),
            "bytes_by_chunk_type": dict(self.chunk_bytes),
            "bytes_by_attribute": dict(self.bytes_by("attribute")),
            "frames": [vars(frame) for frame in self.frames],
        }


def _collect(container: ContainerReader, info: SequenceInfo) -> None:
    _count(container.sequence_head, info)
    numbers = info.header.frame_numbers.expand()
    for head, header, lengths, num_gaussians in listed_chunks(container):
        kind, size = _count(head, info)
        if kind == ChunkType.ENCODER_INFO:
            info.encoder_info = container.peek(head, HEADER_BYTES).text()
        elif kind == ChunkType.PLY_COMMENTS:
            info.comments += PlyComments.read(container.payload(head)).lines
        if isinstance(header, IntraHeader | InterHeader):
            number = numbers[min(head.frame_index, len(numbers) - 1)]
            changes = not isinstance(header, InterHeader) or header.changes
            name = "skip" if not changes else "I" if isinstance(header, IntraHeader) else "P"
            info.frames.append(FrameInfo(head.frame_index, number, name, num_gaussians, 0))
        if kind in FRAME_CHUNKS and info.frames:
            frame = info.frames[-1]
            frame.num_bytes += size
            frame.num_gaussians = num_gaussians
            by_streams = kind in (ChunkType.INTRA_FRAME, ChunkType.INTER_FRAME, ChunkType.RESIDUAL)
            frame.attribute_bytes |= lengths if by_streams else {kind.name: size}


def _count(head: ChunkHead, info: SequenceInfo) -> tuple[ChunkType, int]:
    kind, size = ChunkType(head.chunk_type), head.end - head.offset
    info.chunk_bytes[kind.name] += size
    info.chunks.append((kind.name, head.frame_index, head.offset, size))
    return kind, size


def probe(path: AnyPath) -> SequenceInfo:
    """Describe the file at `path`; BitstreamError where its headers do not make sense."""
    with path_of("path", path, "the path of a .dgs file").open("rb") as file:
        return probe_file(file)


def probe_file(file: BinaryIO) -> SequenceInfo:
    """The same of a file that is open."""
    container = ContainerReader(file)
    info = SequenceInfo(container.sequence, container.size)
    _collect(container, info)
    if not info.frames:
        raise CorruptBitstream("the file has no frames")
    return info

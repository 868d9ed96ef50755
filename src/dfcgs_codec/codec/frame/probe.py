"""What is in a file, from its headers alone: nothing is entropy decoded."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import Any, BinaryIO

from dfcgs_codec.arguments import AnyPath, path_of
from dfcgs_codec.bitstream.comments import PlyComments
from dfcgs_codec.bitstream.constants import (
    BITSTREAM_VERSION,
    STATE_COLUMNS,
    Attribute,
    ChunkType,
    IntraKind,
)
from dfcgs_codec.bitstream.container import ChunkHead, ContainerReader
from dfcgs_codec.bitstream.frame_headers import (
    InterHeader,
    IntraHeader,
    coded_attributes,
    intra_streams,
)
from dfcgs_codec.bitstream.io import ByteReader
from dfcgs_codec.bitstream.sequence_header import SequenceHeader
from dfcgs_codec.bitstream.topology_header import TopologyHeader
from dfcgs_codec.errors import CorruptBitstream

#: longer than any frame header
_HEADER_BYTES = 512
#: values of a PLY vertex that are not in the state: the normals
_NORMALS = 3
_PERMUTATION = "OUTPUT_ORDER"


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


def _stream_names(header: IntraHeader, sh_degree: int) -> list[str]:
    """What is in the streams of an I-frame, in their order."""
    if not header.num_gaussians:
        return []
    names = [a.name for a in coded_attributes(sh_degree)]
    if header.kind == IntraKind.CODED:
        names = intra_streams(sh_degree)
    if header.has_permutation:
        names.insert(1, _PERMUTATION)
    return names


def _intra(reader: ByteReader, head: ChunkHead, info: SequenceInfo, number: int) -> FrameInfo:
    header = IntraHeader.read(reader, info.header)
    names = _stream_names(header, info.header.sh_degree)
    size = head.end - head.offset
    lengths = dict(zip(names, header.lengths, strict=True))
    return FrameInfo(head.frame_index, number, "I", header.num_gaussians, size, lengths)


def _inter(
    reader: ByteReader, head: ChunkHead, info: SequenceInfo, number: int
) -> tuple[FrameInfo, list[Attribute]]:
    header = InterHeader.read(reader, info.header)
    kind = "P" if header.steps or header.tools else "skip"
    count = info.frames[-1].num_gaussians if info.frames else 0
    return FrameInfo(head.frame_index, number, kind, count, head.end - head.offset), sorted(header.steps)


def _topology(reader: ByteReader, head: ChunkHead, info: SequenceInfo) -> None:
    """Births are counted; how many went is known to a decoder only."""
    header = TopologyHeader.read(reader, info.header)
    frame, size = info.frames[-1], head.end - head.offset
    frame.num_bytes += size
    frame.attribute_bytes[ChunkType.TOPOLOGY.name] = size
    frame.num_gaussians += header.num_births - header.num_removals


def _collect(container: ContainerReader, info: SequenceInfo) -> None:
    numbers = info.header.frame_numbers.expand()
    attributes: list[Attribute] = []
    for head in (container.sequence_head, *container.chunks()):
        kind, size = ChunkType(head.chunk_type), head.end - head.offset
        info.chunk_bytes[kind.name] += size
        info.chunks.append((kind.name, head.frame_index, head.offset, size))
        reader = container.peek(head, _HEADER_BYTES)
        number = numbers[min(head.frame_index, len(numbers) - 1)]
        if kind == ChunkType.ENCODER_INFO:
            info.encoder_info = container.peek(head, _HEADER_BYTES).text()
        elif kind == ChunkType.INTRA_FRAME:
            info.frames.append(_intra(reader, head, info, number))
        elif kind == ChunkType.INTER_FRAME:
            frame, attributes = _inter(reader, head, info, number)
            info.frames.append(frame)
        elif kind == ChunkType.TOPOLOGY and info.frames:
            _topology(reader, head, info)
        elif kind in (ChunkType.HYPERPRIOR, ChunkType.MOTION, ChunkType.ESCAPES) and info.frames:
            info.frames[-1].num_bytes += size
            info.frames[-1].attribute_bytes[kind.name] = size
        elif kind == ChunkType.PLY_COMMENTS:
            info.comments += PlyComments.read(container.payload(head)).lines
        elif kind == ChunkType.RESIDUAL and info.frames:
            info.frames[-1].num_bytes += size
            info.frames[-1].attribute_bytes |= {a.name: reader.uvarint() for a in attributes}


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

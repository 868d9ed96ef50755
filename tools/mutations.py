"""Ways to break a `.dgs` file under right checksums: fields, lengths, steps, streams, order of chunks."""

from __future__ import annotations

import random
from collections.abc import Callable
from dataclasses import dataclass, fields, is_dataclass, replace
from enum import IntEnum
from functools import cache
from typing import Any

from dfcgs_codec.bitstream.constants import ChunkType, Tool
from dfcgs_codec.bitstream.frame_headers import (
    InterHeader,
    IntraHeader,
    IntraSteps,
    SortGrid,
    coded_attributes,
    read_lengths,
)
from dfcgs_codec.bitstream.io import ByteReader, ByteWriter
from dfcgs_codec.bitstream.motion_header import LatentHeader, MotionHeader, SpreadHeader
from dfcgs_codec.bitstream.sequence_header import FrameNumbers, SequenceHeader
from dfcgs_codec.bitstream.topology_header import TopologyHeader
from dfcgs_codec.errors import BitstreamError
from lab.chunks import Chunk, join_chunks, split_chunks
from lab.record import REPOSITORY

FOLDER = REPOSITORY / "tests" / "conformance" / "valid"
#: bytes of a stream that the test's seeds break: small, so that many of them take seconds
SMALL = 3000
_EDGES = (0, 1, 2, 3, 7, 8, 12, 31, 32, 63, 64, 127, 128, 255, 256, 4096, 1 << 14, 1 << 18, 1 << 24)
_LARGE = ((1 << 29) - 1, 1 << 29, (1 << 31) - 1, 1 << 32, (1 << 63) - 1, (1 << 64) - 1)
Rng = random.Random


@cache
def streams(most_bytes: int) -> tuple[bytes, ...]:
    """The valid conformance streams of at most so many bytes."""
    found = [path.read_bytes() for path in sorted(FOLDER.glob("*.dgs"))]
    return tuple(data for data in found if len(data) <= most_bytes)


def _number(rng: Rng, value: int) -> int:
    """Another integer: near, doubled, halved, or at one of the edges of types and limits."""
    near = (value - 1, value + 1, value * 2, value // 2, -value, value + rng.randrange(-9, 10))
    return rng.choice([*near, *rng.sample(_EDGES, 4), rng.choice(_LARGE), -rng.choice(_EDGES)])


def changed(rng: Rng, value: Any) -> Any:
    """The same kind of value, changed in one place."""
    if is_dataclass(value) and not isinstance(value, type):
        name = rng.choice([f.name for f in fields(value)])
        return replace(value, **{name: changed(rng, getattr(value, name))})
    if isinstance(value, IntEnum):
        return rng.choice(list(type(value)))
    if isinstance(value, bool):
        return not value
    if isinstance(value, int):
        return _number(rng, value)
    if isinstance(value, bytes):
        return bytes(rng.randrange(256) for _ in value)
    if isinstance(value, str):
        return rng.choice(["", "main-1", "paper-1", "\x1b[2J", value[:-1]])
    return _changed_group(rng, value)


def _changed_group(rng: Rng, value: Any) -> Any:
    """A tuple, mapping or set with one member changed, gone or doubled; None stays None."""
    if isinstance(value, tuple) and value:
        index = rng.randrange(len(value))
        return (*value[:index], changed(rng, value[index]), *value[index + 1 :])
    if isinstance(value, dict) and value:
        key = rng.choice(sorted(value))
        return value | {key: changed(rng, value[key])}
    if isinstance(value, frozenset):
        kind = type(next(iter(value))) if value else Tool
        return value ^ {rng.choice(list(kind))}
    return value


@dataclass(frozen=True)
class _Parsed:
    """A payload taken apart: its header, the lengths of its streams, the rest."""

    header: Any
    lengths: tuple[int, ...]
    rest: bytes

    def payload(self) -> bytes:
        """Put together again."""
        writer = ByteWriter()
        self.header.write(writer)
        for length in self.lengths:
            writer.uvarint(length)
        return writer.getvalue() + self.rest


def _parse(chunk: Chunk, sequence: SequenceHeader) -> _Parsed | None:
    """None where the chunk has no header that is known, or a broken one."""
    reader = ByteReader(chunk.payload)
    read: dict[int, Callable[[], Any]] = {
        ChunkType.SEQUENCE_HEADER: lambda: SequenceHeader.read(reader),
        ChunkType.INTRA_FRAME: lambda: IntraHeader.read(reader, sequence),
        ChunkType.INTER_FRAME: lambda: InterHeader.read(reader, sequence),
        ChunkType.TOPOLOGY: lambda: TopologyHeader.read(reader, sequence, sequence.limits.max_gaussians),
        ChunkType.MOTION: lambda: _read_motion(reader, sequence),
    }
    if chunk.chunk_type not in read:
        return None
    try:
        header = read[chunk.chunk_type]()
        names = [] if isinstance(header, SequenceHeader) else header.streams(sequence.sh_degree)
        lengths = tuple(read_lengths(reader, names or []).values())
    except BitstreamError:
        return None
    return _Parsed(header, lengths, reader.raw(reader.remaining))


def _read_motion(reader: ByteReader, sequence: SequenceHeader) -> MotionHeader | LatentHeader:
    if sequence.profile.name == "PAPER":
        return LatentHeader.read(reader, sequence)
    return MotionHeader.read(reader, sequence)


def _field(rng: Rng, chunks: list[Chunk], sequence: SequenceHeader) -> list[Chunk]:
    """Change a field of a header."""
    index = rng.randrange(len(chunks))
    parsed = _parse(chunks[index], sequence)
    if parsed is None:
        return _bytes(rng, chunks, sequence)
    header = parsed.header
    with_lengths = rng.random() < 0.15
    parsed = replace(parsed, lengths=changed(rng, parsed.lengths)) if with_lengths else parsed
    parsed = replace(parsed, header=_with_options(rng, changed(rng, header), sequence))
    try:
        payload = parsed.payload()
    except (ValueError, OverflowError, AttributeError, TypeError, KeyError):
        return chunks
    return [*chunks[:index], replace(chunks[index], payload=payload), *chunks[index + 1 :]]


def _with_options(rng: Rng, header: Any, sequence: SequenceHeader) -> Any:
    """Now and then a part that was absent."""
    if rng.random() > 0.1:
        return header
    if isinstance(header, LatentHeader):
        return replace(header, spread=SpreadHeader(rng.randrange(1, 129), rng.randrange(-28, 29)))
    if isinstance(header, TopologyHeader):
        attributes = coded_attributes(sequence.sh_degree)
        steps = dict.fromkeys(attributes, 1 << rng.randrange(20))
        levels = dict.fromkeys(attributes, rng.randrange(-200, 200))
        rule = IntraSteps(steps, rng.randrange(9), levels, 0, frozenset())
        grid = SortGrid(0, 4, (0, 0, 0), False)
        return replace(header, num_births=rng.randrange(1, 99), sort_grid=grid, steps=rule)
    if isinstance(header, SequenceHeader):
        return replace(header, frame_numbers=FrameNumbers(((rng.randrange(9), rng.randrange(1, 9)),)))
    return header


def _bytes(rng: Rng, chunks: list[Chunk], sequence: SequenceHeader) -> list[Chunk]:
    """Change, insert or take away bytes of a payload, mostly of its streams."""
    index = rng.randrange(len(chunks))
    data = bytearray(chunks[index].payload)
    if not data:
        return chunks
    start = rng.randrange(len(data)) if rng.random() < 0.3 else rng.randrange(len(data) // 2, len(data))
    count = rng.choice((1, 1, 2, 4, 16, 64))
    kind = rng.randrange(5)
    fresh = bytes(rng.randrange(256) for _ in range(count))
    if kind == 0:
        data[start] ^= 1 << rng.randrange(8)
    elif kind == 1:
        data[start : start + count] = fresh[: len(data) - start]
    elif kind == 2:
        data[start : start + count] = rng.choice((b"\x00", b"\xff")) * min(count, len(data) - start)
    elif kind == 3:
        data[start:start] = fresh
    else:
        del data[start : start + count]
    return [*chunks[:index], replace(chunks[index], payload=bytes(data)), *chunks[index + 1 :]]


def _order(rng: Rng, chunks: list[Chunk], sequence: SequenceHeader) -> list[Chunk]:
    """Leave out, double or swap chunks, or change their type or frame."""
    result = list(chunks)
    a, b = rng.randrange(len(chunks)), rng.randrange(len(chunks))
    kind = rng.randrange(5)
    if kind == 0:
        del result[a]
    elif kind == 1:
        result.insert(a, chunks[b])
    elif kind == 2:
        result[a], result[b] = chunks[b], chunks[a]
    elif kind == 3:
        result[a] = replace(chunks[a], chunk_type=rng.choice([*ChunkType, 0x33, 0xB3]))
    else:
        result[a] = replace(chunks[a], frame_index=abs(_number(rng, chunks[a].frame_index)) % (1 << 63))
    return result


def _splice(rng: Rng, chunks: list[Chunk], sequence: SequenceHeader) -> list[Chunk]:
    """Put a chunk of another stream in the place of one."""
    other = rng.choice(split_chunks(rng.choice(streams(SMALL))))
    index = rng.randrange(len(chunks))
    other = replace(other, frame_index=chunks[index].frame_index)
    return [*chunks[:index], other, *chunks[index + 1 :]]


_CHANGES: tuple[Callable[[Rng, list[Chunk], SequenceHeader], list[Chunk]], ...] = (
    _field,
    _field,
    _field,
    _bytes,
    _bytes,
    _order,
    _splice,
)


def mutated(rng: Rng, data: bytes) -> bytes:
    """`data` with one to three changes under right checksums; now and then the frame of the file, too."""
    chunks = split_chunks(data)
    sequence = SequenceHeader.read(ByteReader(chunks[0].payload))
    for _ in range(rng.choice((1, 1, 2, 3))):
        chunks = rng.choice(_CHANGES)(rng, chunks, sequence) or chunks
    index = bytes(rng.randrange(200) for _ in range(rng.randrange(9))) if rng.random() < 0.1 else None
    try:
        result = join_chunks(chunks, index=index)
    except ValueError:  # frames in an order that no index can have
        result = join_chunks(chunks, index=b"\x01\x04\x10")
    if rng.random() < 0.1:
        cut = rng.randrange(len(result))
        result = rng.choice((result[:cut], result + b"more", result[:cut] + b"\x00" + result[cut + 1 :]))
    return result

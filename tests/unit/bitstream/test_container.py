from __future__ import annotations

import io
import zlib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dfcgs_codec.bitstream.constants import MAGIC, ChunkType, OutputOrder, Profile
from dfcgs_codec.bitstream.container import ContainerReader, ContainerWriter, write_chunk
from dfcgs_codec.bitstream.index import IndexEntry
from dfcgs_codec.bitstream.sequence_header import FrameNumbers, SequenceHeader, UnitExponents
from dfcgs_codec.errors import (
    BitstreamError,
    CorruptBitstream,
    NotADgsFile,
    TruncatedBitstream,
    UnsupportedBitstream,
)

HEADER = SequenceHeader(
    Profile.MAIN, 1, 0, OutputOrder.FREE, (30, 1), FrameNumbers(((3, 3),)), UnitExponents(-9, -12, -12, -12)
)
GOFS = (
    write_chunk(ChunkType.INTRA_FRAME, 0, b"intra") + write_chunk(ChunkType.INTER_FRAME, 1, b"inter"),
    write_chunk(ChunkType.INTRA_FRAME, 2, b"another"),
)


def make_file(*, between: bytes = b"", finish: bool = True) -> bytes:
    file = io.BytesIO()
    writer = ContainerWriter(file, HEADER)
    writer.chunk(ChunkType.ENCODER_INFO, 0, b"test")
    writer.gof(0, [GOFS[0], between])
    writer.gof(2, [GOFS[1]])
    if finish:
        writer.finish()
    assert writer.size == len(file.getvalue())
    return file.getvalue()


def reader_of(data: bytes) -> ContainerReader:
    return ContainerReader(io.BytesIO(data))


def types(data: bytes) -> list[int]:
    return [head.chunk_type for head in reader_of(data).chunks()]


def test_what_was_written_is_read() -> None:
    reader = reader_of(make_file())
    assert reader.sequence == HEADER
    heads = list(reader.chunks())
    names = [ChunkType(head.chunk_type).name for head in heads]
    assert names == ["ENCODER_INFO", "INTRA_FRAME", "INTER_FRAME", "INTRA_FRAME", "INDEX", "END"]
    assert [head.frame_index for head in heads] == [0, 0, 1, 2, 0, 0]
    assert reader.payload(heads[2]).raw(5) == b"inter"
    assert heads[-1].end == reader.size


@given(st.integers(0, 255), st.integers(0, 2**64 - 1), st.binary(max_size=300))
def test_a_chunk_is_type_index_length_payload_crc(kind: int, index: int, payload: bytes) -> None:
    chunk = write_chunk(kind, index, payload)
    assert chunk[0] == kind
    assert chunk[:-4].endswith(payload)
    assert int.from_bytes(chunk[-4:], "little") == zlib.crc32(chunk[:-4])


def test_the_index_says_where_gofs_start() -> None:
    data = make_file()
    first, second = (data.index(gof) for gof in GOFS)
    assert reader_of(data).index().entries == (IndexEntry(0, 2, first), IndexEntry(2, 1, second))


def test_chunks_can_be_read_from_and_up_to_a_byte() -> None:
    data = make_file()
    reader = reader_of(data)
    first, second = (entry.offset for entry in reader.index().entries)
    found = [head.chunk_type for head in reader.chunks(first, second)]
    assert found == [ChunkType.INTRA_FRAME, ChunkType.INTER_FRAME]


def test_an_unknown_ancillary_chunk_is_skipped() -> None:
    data = make_file(between=write_chunk(0x9A, 1, b"from the future"))
    assert types(data) == types(make_file())


def test_a_skipped_chunk_is_checked_too() -> None:
    """Else damage to a chunk's type could make a frame vanish without a word."""
    chunk = bytearray(write_chunk(0x9A, 1, b"from the future"))
    chunk[5] ^= 1
    with pytest.raises(CorruptBitstream, match="checksum"):
        types(make_file(between=bytes(chunk)))


def test_an_unknown_critical_chunk_is_refused_where_it_stands() -> None:
    chunk = write_chunk(0x1A, 1, b"from the future")
    data = make_file(between=chunk)
    with pytest.raises(UnsupportedBitstream, match="chunk type 0x1a is unknown") as caught:
        types(data)
    assert caught.value.offset == data.index(chunk)


@pytest.mark.parametrize("part", ["type", "frame_index", "payload", "crc"])
def test_the_checksum_covers_everything(part: str) -> None:
    data = bytearray(make_file())
    start = bytes(data).index(GOFS[1])
    position = start + {"type": 0, "frame_index": 1, "payload": 5, "crc": len(GOFS[1]) - 1}[part]
    data[position] ^= 0x30 if part == "type" else 1
    reader = reader_of(bytes(data))
    with pytest.raises(CorruptBitstream, match="checksum") as caught:
        reader.payload(reader.head(start))
    assert caught.value.offset == start


def test_another_packages_dgs_file_is_refused_by_name() -> None:
    with pytest.raises(NotADgsFile, match=r"dgs-py.*glps"):
        reader_of(b"glps\x01\x00\x00\x00 and more")


def test_a_ply_is_called_one() -> None:
    with pytest.raises(NotADgsFile, match="PLY frame"):
        reader_of(b"ply\nformat ascii 1.0\n")


@pytest.mark.parametrize("data", [b"\x89PNG\r\n\x1a\n", b"\x00" * 40, b"\x89DGT"])
def test_other_files_are_refused(data: bytes) -> None:
    with pytest.raises(NotADgsFile, match="it starts with"):
        reader_of(data)


@pytest.mark.parametrize("length", range(len(MAGIC)))
def test_a_file_that_ends_inside_the_magic_is_truncated(length: int) -> None:
    with pytest.raises(TruncatedBitstream):
        reader_of(MAGIC[:length])


def test_every_prefix_is_truncated() -> None:
    data = make_file()
    for length in range(len(data)):
        with pytest.raises(TruncatedBitstream):
            types(data[:length])


def test_every_prefix_lacks_its_index() -> None:
    data = make_file()
    for length in range(len(data)):
        with pytest.raises(TruncatedBitstream):
            reader_of(data[:length]).index()


def test_bytes_after_the_end_are_refused() -> None:
    with pytest.raises(CorruptBitstream, match="after the end"):
        types(make_file() + b"\x00")


def test_the_first_chunk_must_be_the_sequence_header() -> None:
    with pytest.raises(CorruptBitstream, match="not a sequence header"):
        reader_of(MAGIC + write_chunk(ChunkType.INTRA_FRAME, 0, b"x"))


def test_the_sequence_header_has_no_spare_bytes() -> None:
    data = make_file()
    head = reader_of(data).sequence_head
    payload = data[head.payload_offset : head.payload_offset + head.payload_length]
    longer = MAGIC + write_chunk(ChunkType.SEQUENCE_HEADER, 0, payload + b"\x00") + data[head.end :]
    with pytest.raises(CorruptBitstream, match="1 unused bytes after the sequence header"):
        reader_of(longer)


def test_a_length_beyond_the_file_is_truncated_before_anything_is_read() -> None:
    data = make_file(finish=False) + bytes((ChunkType.RESIDUAL, 2)) + b"\xff" * 9 + b"\x01"
    with pytest.raises(TruncatedBitstream, match="bytes more than the file has"):
        types(data)


def end_chunk(offset: int) -> bytes:
    return write_chunk(ChunkType.END, 0, offset.to_bytes(8, "little"))


@pytest.mark.parametrize("where", ["magic", "header", "gof", "itself", "beyond"])
def test_the_end_must_point_at_the_index(where: str) -> None:
    data = make_file()[: -len(end_chunk(0))]
    target = {"magic": 0, "header": 8, "gof": data.index(GOFS[0]), "itself": len(data), "beyond": 2**60}
    with pytest.raises(CorruptBitstream):
        reader_of(data + end_chunk(target[where])).index()


def test_an_index_that_points_behind_itself_is_refused() -> None:
    file = io.BytesIO()
    writer = ContainerWriter(file, HEADER)
    index_offset = writer.size
    writer.chunk(ChunkType.INDEX, 0, bytes((1, 3, index_offset)))
    with pytest.raises(CorruptBitstream, match="behind itself"):
        reader_of(file.getvalue() + end_chunk(index_offset)).index()


@given(st.binary(max_size=200))
def test_garbage_after_the_magic_is_refused(garbage: bytes) -> None:
    with pytest.raises(BitstreamError):
        types(MAGIC + garbage)

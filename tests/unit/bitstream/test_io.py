from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dfcgs_codec.bitstream.io import ByteReader, ByteWriter
from dfcgs_codec.errors import CorruptBitstream, TruncatedBitstream

UINT64 = st.integers(0, 2**64 - 1)


def written(name: str, value: int) -> bytes:
    writer = ByteWriter()
    getattr(writer, name)(value)
    assert len(writer) == len(writer.getvalue())
    return writer.getvalue()


@pytest.mark.parametrize(
    ("name", "value", "data"),
    [
        ("u8", 0xAB, "ab"),
        ("u32", 0x01020304, "04030201"),
        ("u64", 0x0102030405060708, "0807060504030201"),
        ("uvarint", 0, "00"),
        ("uvarint", 127, "7f"),
        ("uvarint", 128, "8001"),
        ("uvarint", 300, "ac02"),
        ("uvarint", 2**64 - 1, "ffffffffffffffffff01"),
        ("svarint", 0, "00"),
        ("svarint", -1, "01"),
        ("svarint", 1, "02"),
        ("svarint", -64, "7f"),
        ("svarint", 64, "8001"),
        ("svarint", -(2**63), "ffffffffffffffffff01"),
        ("svarint", 2**63 - 1, "feffffffffffffffff01"),
    ],
)
def test_fields_have_these_bytes(name: str, value: int, data: str) -> None:
    assert written(name, value).hex() == data
    reader = ByteReader(bytes.fromhex(data))
    assert getattr(reader, name)() == value
    assert reader.remaining == 0


@given(UINT64)
def test_uvarint_round_trip_in_as_few_bytes_as_possible(value: int) -> None:
    data = written("uvarint", value)
    assert len(data) == max(1, -(-value.bit_length() // 7))
    assert ByteReader(data).uvarint() == value


@given(st.integers(-(2**63), 2**63 - 1))
def test_svarint_round_trip(value: int) -> None:
    assert ByteReader(written("svarint", value)).svarint() == value


@pytest.mark.parametrize("value", [-1, 2**64])
def test_uvarint_refuses_to_write_what_it_cannot_read(value: int) -> None:
    with pytest.raises(ValueError, match="out of range"):
        ByteWriter().uvarint(value)


@pytest.mark.parametrize("value", [-(2**63) - 1, 2**63])
def test_svarint_refuses_to_write_what_it_cannot_read(value: int) -> None:
    with pytest.raises(ValueError, match="out of range"):
        ByteWriter().svarint(value)


@pytest.mark.parametrize(
    "data",
    [
        b"\x80\x00",
        b"\xff\x80\x00",
        b"\x80" * 9 + b"\x00",
        b"\xff" * 9 + b"\x02",
        b"\xff" * 10,
        b"\x80" * 20,
    ],
)
def test_uvarint_has_one_spelling(data: bytes) -> None:
    with pytest.raises(CorruptBitstream) as caught:
        ByteReader(data, 100).uvarint()
    assert caught.value.offset == 100


@pytest.mark.parametrize(("name", "size"), [("u8", 1), ("u32", 4), ("u64", 8)])
def test_a_shortage_is_truncated_with_the_offset(name: str, size: int) -> None:
    reader = ByteReader(b"\x00" * (size - 1), 40)
    with pytest.raises(TruncatedBitstream) as caught:
        getattr(reader, name)()
    assert caught.value.offset == 40


def test_a_shortage_inside_a_checked_payload_is_corrupt() -> None:
    with pytest.raises(CorruptBitstream):
        ByteReader(b"\x80", 0, CorruptBitstream).uvarint()


def test_a_huge_count_is_refused_before_anything_is_allocated() -> None:
    with pytest.raises(TruncatedBitstream):
        ByteReader(b"abc").raw(2**62)


def test_offset_counts_from_the_start_of_the_file() -> None:
    reader = ByteReader(b"\x01\x80\x01rest", 1000)
    reader.u8()
    reader.uvarint()
    assert (reader.position, reader.offset, reader.remaining) == (3, 1003, 4)


def test_expect_end() -> None:
    reader = ByteReader(b"ab", 7)
    reader.u8()
    with pytest.raises(CorruptBitstream, match="1 unused bytes after the test"):
        reader.expect_end("the test")
    reader.u8()
    reader.expect_end("the test")


def test_text_replaces_damaged_characters() -> None:
    assert ByteReader("Größe".encode()).text() == "Größe"
    assert ByteReader(b"a\xff").text() == "a\ufffd"

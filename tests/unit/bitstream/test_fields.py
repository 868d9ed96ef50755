from __future__ import annotations

import pytest

from dfcgs_codec.bitstream.constants import IntraKind
from dfcgs_codec.bitstream.fields import at_most, read_bounded, read_enum
from dfcgs_codec.bitstream.io import ByteReader
from dfcgs_codec.errors import LimitExceeded, UnsupportedBitstream


def test_read_enum_names_the_field_and_the_byte() -> None:
    assert read_enum(IntraKind, ByteReader(b"\x01"), "intra_kind") is IntraKind.CODED
    with pytest.raises(UnsupportedBitstream, match="intra_kind 9 is unknown") as caught:
        read_enum(IntraKind, ByteReader(b"\x09", 12), "intra_kind")
    assert caught.value.offset == 12


def test_at_most_lets_the_limit_itself_pass() -> None:
    assert at_most(5, 5, "count", 0) == 5
    with pytest.raises(LimitExceeded, match="count is 6, at most 5"):
        at_most(6, 5, "count", 0)


def test_read_bounded_reports_where_the_field_begins() -> None:
    reader = ByteReader(b"\xac\x02", 50)
    with pytest.raises(LimitExceeded, match="width is 300") as caught:
        read_bounded(reader.uvarint, 299, "width", reader)
    assert caught.value.offset == 50

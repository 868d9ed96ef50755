"""Reading fields whose range is limited."""

from __future__ import annotations

from collections.abc import Callable
from enum import IntEnum
from typing import TypeVar

from dfcgs_codec.bitstream.io import ByteReader
from dfcgs_codec.errors import LimitExceeded, UnsupportedBitstream

_EnumT = TypeVar("_EnumT", bound=IntEnum)


def read_enum(kind: type[_EnumT], reader: ByteReader, name: str) -> _EnumT:
    """A byte that names a member of `kind`; an unknown one is UnsupportedBitstream."""
    offset = reader.offset
    value = reader.u8()
    try:
        return kind(value)
    except ValueError:
        raise UnsupportedBitstream(
            f"{name} {value} is unknown: a newer decoder is needed", offset=offset
        ) from None


def at_most(value: int, limit: int, name: str, offset: int) -> int:
    """`value`, or LimitExceeded when it is above `limit`."""
    if value > limit:
        raise LimitExceeded(f"{name} is {value}, at most {limit} is allowed", offset=offset)
    return value


def read_bounded(read: Callable[[], int], limit: int, name: str, reader: ByteReader) -> int:
    """The field that `read` reads, or LimitExceeded when it is above `limit`."""
    offset = reader.offset
    return at_most(read(), limit, name, offset)

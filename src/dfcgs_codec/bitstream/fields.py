"""Reading fields whose range is limited."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from enum import IntEnum
from typing import TypeVar

from dfcgs_codec.bitstream.constants import STATE_LIMIT, Attribute
from dfcgs_codec.bitstream.io import ByteReader, ByteWriter
from dfcgs_codec.errors import BitstreamError, CorruptBitstream, LimitExceeded, UnsupportedBitstream

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


def read_flag(reader: ByteReader, name: str) -> bool:
    """A byte that is 0 or 1."""
    return bool(read_bounded(reader.u8, 1, name, reader))


def read_mask(
    reader: ByteReader,
    members: Iterable[_EnumT],
    name: str,
    reason: str,
    error: type[BitstreamError] = CorruptBitstream,
) -> list[_EnumT]:
    """Those of `members` whose bit is set in a byte; `error` for other bits, with the reason."""
    members, offset = list(members), reader.offset
    bits = reader.u8()
    if bits & ~mask_of(members):
        raise error(f"{name} {bits:#x} {reason}", offset=offset)
    return [member for member in members if bits >> member & 1]


def mask_of(members: Iterable[int]) -> int:
    """The byte in which the bits of `members` are set."""
    return sum(1 << member for member in members)


def read_point(reader: ByteReader, limit: int, name: str) -> tuple[int, int, int]:
    """Three signed numbers of magnitude <= `limit`."""
    offset = reader.offset
    x, y, z = reader.svarint(), reader.svarint(), reader.svarint()
    at_most(max(abs(x), abs(y), abs(z)), limit, name, offset)
    return x, y, z


def at_most(value: int, limit: int, name: str, offset: int) -> int:
    """`value`, or LimitExceeded when it is above `limit`."""
    if value > limit:
        raise LimitExceeded(f"{name} is {value}, at most {limit} is allowed", offset=offset)
    return value


def read_bounded(read: Callable[[], int], limit: int, name: str, reader: ByteReader) -> int:
    """The field that `read` reads, or LimitExceeded when it is above `limit`."""
    offset = reader.offset
    return at_most(read(), limit, name, offset)


def write_steps(writer: ByteWriter, steps: dict[Attribute, int]) -> None:
    """Steps in rising order of attributes."""
    for attribute in sorted(steps):
        writer.uvarint(steps[attribute])


def read_steps(reader: ByteReader, attributes: list[Attribute]) -> dict[Attribute, int]:
    """Refuses steps of 0 and those beyond the grid."""
    steps = {}
    for attribute in attributes:
        offset = reader.offset
        steps[attribute] = read_bounded(reader.uvarint, STATE_LIMIT, "step", reader)
        if steps[attribute] == 0:
            raise CorruptBitstream("a quantiser step is 0", offset=offset)
    return steps


def read_levels(reader: ByteReader, attributes: list[Attribute]) -> dict[Attribute, int]:
    """The weight of each attribute at which steps are as given."""
    levels = {}
    for attribute in attributes:
        offset = reader.offset
        levels[attribute] = reader.svarint()
        at_most(abs(levels[attribute]), STATE_LIMIT, "visibility_level", offset)
    return levels


def write_levels(writer: ByteWriter, levels: dict[Attribute, int]) -> None:
    """Levels in rising order of attributes."""
    for attribute in sorted(levels):
        writer.svarint(levels[attribute])

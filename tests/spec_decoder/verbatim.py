"""Verbatim I-frames."""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator
from typing import TYPE_CHECKING

from tests.spec_decoder.basics import (
    COLUMNS,
    OPACITY,
    POSITION,
    ROTATION,
    SH_DC,
    STATE_LIMIT,
    clip,
    transposed,
)
from tests.spec_decoder.columns import permutation
from tests.spec_decoder.lods import Lods
from tests.spec_decoder.state import State, compress, normalise
from tests.spec_decoder.stream import occurring
from tests.spec_decoder.tables import uniform

if TYPE_CHECKING:
    from tests.spec_decoder.basics import Matrix, Row
    from tests.spec_decoder.headers import Sequence
    from tests.spec_decoder.stream import RangeDecoder


def float_column(stream: RangeDecoder, n: int) -> Row:
    """Bit patterns."""
    pattern, contexts = [0] * n, [0] * n
    for shift in (24, 16, 8, 0):
        if stream.decode(uniform(2)) == 0:
            plane = stream.bits(8, n)
        else:
            plane = stream.grouped(contexts, stream.read_histograms(occurring(contexts), 256))
        pattern = [p | byte << shift for p, byte in zip(pattern, plane, strict=True)]
        contexts = [0] * n
        if shift == 24:
            center = stream.decode(uniform(256))
            contexts = [clip((byte & 127) - center, -4, 3) + 4 for byte in plane]
    return pattern


def float_of(pattern: int) -> float:
    value: float = struct.unpack("<f", struct.pack("<I", pattern))[0]
    return value


def to_grid(value: float, exponent: int, origin: int = 0) -> int:
    if math.isnan(value):
        return 0
    if math.isinf(value):
        return STATE_LIMIT if value > 0 else -STATE_LIMIT
    # Python's round goes to even; scaling by a power of two is exact in binary64
    return clip(round(math.ldexp(value, -exponent)) - origin, -STATE_LIMIT, STATE_LIMIT)


def float_quaternion(row: list[float]) -> Row:
    if not all(map(math.isfinite, row)) or not any(row):
        return [1 << 24, 0, 0, 0]
    exponent = math.frexp(max(abs(c) for c in row))[1]
    return normalise([round(math.ldexp(c, 24 - exponent)) for c in row])


def verbatim_state(patterns: dict[int, Matrix], exponents: dict[int, int], origin: Row) -> dict[int, Matrix]:
    planes = {}
    for attribute, rows in patterns.items():
        values = [[float_of(p) for p in row] for row in rows]
        e = exponents[min(attribute, SH_DC)]
        if attribute == ROTATION:
            planes[attribute] = [float_quaternion(row) for row in values]
        elif attribute == POSITION:
            planes[attribute] = [
                [to_grid(v, e, o) for v, o in zip(row, origin, strict=True)] for row in values
            ]
        elif attribute == OPACITY:
            planes[attribute] = [[compress(to_grid(row[0], e), e)] for row in values]
        else:
            planes[attribute] = [[to_grid(value, e) for value in row] for row in values]
    return planes


def verbatim_intra(
    streams: Iterator[RangeDecoder], n: int, sequence: Sequence, has_permutation: bool
) -> State:
    attributes = sequence.attributes
    patterns: dict[int, Matrix] = {}
    order = None
    for attribute in attributes:
        stream = next(streams)
        patterns[attribute] = transposed([float_column(stream, n) for _ in range(COLUMNS[attribute])])
        if attribute == POSITION and has_permutation:
            order = permutation(next(streams), Lods(n))
    return State(verbatim_state(patterns, sequence.exponents, sequence.origin), order, patterns)

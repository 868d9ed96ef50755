"""Chapter 8: states, their hash, rotations."""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass
from typing import TYPE_CHECKING

from tests.spec_decoder.basics import POSITION, blake, clip, round_divide, round_shift, sign

if TYPE_CHECKING:
    from tests.spec_decoder.basics import Matrix, Row


def from_stereo(p: Row) -> Row:
    p = [clip(c, -(2**18), 2**18) for c in p]
    s = sum(c * c for c in p)
    d = 2**36 + s
    return [round_divide((2**36 - s) << 24, d)] + [round_divide(c << 43, d) for c in p]


def multiply(a: Row, b: Row) -> Row:
    w, x, y, z = a
    s, i, j, k = b
    return [
        round_shift(w * s - x * i - y * j - z * k, 24),
        round_shift(w * i + x * s + y * k - z * j, 24),
        round_shift(w * j - x * k + y * s + z * i, 24),
        round_shift(w * k + x * j - y * i + z * s, 24),
    ]


def normalise(a: Row) -> Row:
    length = max(math.isqrt(sum(c * c for c in a)), 1)
    return [round_divide(c << 24, length) for c in a]


@dataclass
class State:
    planes: dict[int, Matrix]
    order: Row | None = None
    verbatim: dict[int, Matrix] | None = None
    escapes: bytes = b""

    @property
    def positions(self) -> Matrix:
        return self.planes[POSITION]

    def hash(self) -> bytes:
        """8.5."""
        data = b"".join(digest(self.planes[a]) for a in sorted(self.planes))
        if self.order is not None:
            data += digest([[place] for place in self.order])
        for patterns in (self.verbatim or {}).values():
            data += b"".join(struct.pack(f"<{len(row)}I", *row) for row in patterns)
        return blake(data + self.escapes)


def digest(plane: Matrix) -> bytes:
    return blake(b"".join(struct.pack(f"<{len(row)}i", *row) for row in plane))


KNOTS = (28, 42, 54, 66, 77, 88, 99)


def opacity_knots(e: int) -> tuple[Row, Row]:
    """8.3."""
    logit_knots, companded_knots = [0], [0]
    for i in range(1, 8):
        logit_knots.append(KNOTS[i - 1] << (-4 - e))
        companded_knots.append(companded_knots[-1] + ((logit_knots[i] - logit_knots[i - 1]) >> (i - 1)))
    return logit_knots, companded_knots


def compress(v: int, e: int) -> int:
    logit_knots, companded_knots = opacity_knots(e)
    zone = sum(knot <= abs(v) for knot in logit_knots[1:])
    half = (1 << zone) >> 1
    return sign(v) * (companded_knots[zone] + ((abs(v) - logit_knots[zone] + half) >> zone))


def expand(c: int, e: int) -> int:
    logit_knots, companded_knots = opacity_knots(e)
    zone = sum(knot <= abs(c) for knot in companded_knots[1:])
    return sign(c) * (logit_knots[zone] + ((abs(c) - companded_knots[zone]) << zone))

"""Chapter 1: refusal, arithmetic, fields."""

from __future__ import annotations

import hashlib
import json
import operator
from pathlib import Path
from typing import TypeVar

STATE_LIMIT = 2**29 - 1

GAUSSIAN, LAPLACE, HEAVY = 0, 1, 2

POSITION, SCALE, ROTATION, OPACITY, SH_DC = 0, 1, 2, 3, 4

MOTION, TOPOLOGY, VISIBILITY, LATENT, REFINEMENT, ESCAPE = 1, 2, 4, 8, 16, 32

MAIN, PAPER = 0, 1

COLUMNS = (3, 3, 4, 1, 3, 9, 15, 21)

ROOT = Path(__file__).resolve().parents[2]
#: 1.3: by section and name
CONSTANTS = json.loads((ROOT / "spec" / "constants.json").read_text(encoding="utf-8"))
Row = list[int]

Matrix = list[list[int]]

T = TypeVar("T")


class Refused(Exception):
    """The file does not conform."""


class ModelMismatch(Refused):
    """The file wants a model that the decoder does not have."""

    code = "model-mismatch"


def require(condition: bool) -> None:
    if not condition:
        raise Refused


def clip(a: int, low: int, high: int) -> int:
    return min(max(a, low), high)


def sign(a: int) -> int:
    return (a > 0) - (a < 0)


def round_divide(a: int, b: int) -> int:
    return (2 * a + b) // (2 * b)


def round_shift(a: int, n: int) -> int:
    return (a + (1 << (n - 1))) >> n


def unfold(u: int) -> int:
    return u >> 1 if u % 2 == 0 else -(u >> 1) - 1


class Fields:
    def __init__(self, data: bytes) -> None:
        self.data = data
        self.place = 0

    def raw(self, count: int) -> bytes:
        require(self.place + count <= len(self.data))
        self.place += count
        return self.data[self.place - count : self.place]

    def u8(self) -> int:
        return self.raw(1)[0]

    def uvarint(self) -> int:
        value = 0
        for i in range(10):
            byte = self.u8()
            value |= (byte & 127) << 7 * i
            if byte < 128:
                require(not (byte == 0 and i > 0) and value < 2**64)
                return value
        raise Refused

    def svarint(self) -> int:
        return unfold(self.uvarint())


def blake(data: bytes) -> bytes:
    return hashlib.blake2b(data, digest_size=16).digest()


def transposed(columns: Matrix) -> Matrix:
    return [list(row) for row in zip(*columns, strict=True)]


def in_range(plane: Matrix) -> Matrix:
    require(all(abs(value) <= STATE_LIMIT for row in plane for value in row))
    return plane


def dot(a: Row, b: Row) -> int:
    return sum(map(operator.mul, a, b))


def zeros(count: int) -> Matrix:
    return [[0] * 3 for _ in range(count)]


def shift_left(a: int, n: int) -> int:
    return a << n if n >= 0 else a >> -n

"""Section 15.3: where births stand."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import accumulate
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from tests.spec_decoder.basics import Matrix, Row, T
    from tests.spec_decoder.intra import Intra


@dataclass
class Place:
    """Where a row of a frame comes from: the `index`-th survivor or birth."""

    is_birth: bool
    index: int


@dataclass
class Topology:
    """What a TOPOLOGY chunk says; `places` less those that are expected."""

    kept: Row
    births: Intra | None
    places: Row | None


def merged(rows: list[Place], survivors: list[T], births: list[T]) -> list[T]:
    return [(births if row.is_birth else survivors)[row.index] for row in rows]


def cell_key(cell: Row) -> int:
    """15.3."""
    x, y, z = (min(c + 2**20, 2**21 - 1) for c in cell)
    return sum(
        (x >> b & 1) << (3 * b + 2) | (y >> b & 1) << (3 * b + 1) | (z >> b & 1) << 3 * b for b in range(21)
    )


def interleaved(survivors: Matrix, births: Matrix) -> list[Place]:
    """15.3, from cells."""
    rising = accumulate((cell_key(cell) for cell in survivors), max)
    rows = [(key, 0, i) for i, key in enumerate(rising)]
    rows += [(cell_key(cell), 1, j) for j, cell in enumerate(births)]
    return [Place(birth == 1, index) for _, birth, index in sorted(rows)]

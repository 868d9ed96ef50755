"""Sections 14.1 and 14.2: control points, and who gathers from which."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from tests.spec_decoder.basics import round_shift, transposed
from tests.spec_decoder.columns import ladder

if TYPE_CHECKING:
    from tests.spec_decoder.basics import Matrix, Row


@dataclass
class ControlHeader:
    """What section 5 says of control points."""

    spacing: int
    shift: int


@dataclass
class Gathered:
    """A point with the control points that it gathers from (14.2) and what it has learnt (14.6)."""

    rank: Row
    weight: Row
    effort: Row = field(default_factory=lambda: [0] * 5)
    choice: int = 0

    def candidates(self, each: Matrix) -> Matrix:
        """The blend, then what each of the control points gives."""
        columns = transposed(each)
        blend = [round_shift(sum(w * x for w, x in zip(self.weight, c, strict=True)), 12) for c in columns]
        return [blend, *each]

    def learn(self, actual: Row, displacements: Matrix, translation_step: int) -> None:
        for j in range(5):
            error = sum(abs(d - a) for d, a in zip(displacements[j], actual, strict=True))
            kind = ladder(error // (4 * translation_step), 64)
            self.effort[j] += 16 * kind - (self.effort[j] >> 2)
        judged = [self.effort[0] - 16, *self.effort[1:]]
        self.choice = judged.index(min(judged))


def squared_distance(a: Row, b: Row) -> int:
    return sum((x - y) ** 2 for x, y in zip(a, b, strict=True))


def farthest(cells: Matrix, wanted: int) -> Row:
    chosen = [0]
    distance = [squared_distance(cell, cells[0]) for cell in cells]
    while len(chosen) < wanted and max(distance) > 0:
        chosen.append(distance.index(max(distance)))
        latest = cells[chosen[-1]]
        distance = [min(d, squared_distance(c, latest)) for d, c in zip(distance, cells, strict=True)]
    return chosen


def gather(cell: Row, others: Matrix) -> Gathered:
    squared = [squared_distance(cell, other) for other in others]
    count, asked = min(4, len(others)), min(5, len(others))
    rank = sorted(range(len(others)), key=lambda j: (squared[j], j))[:asked]
    distance = [math.isqrt(squared[j]) for j in rank]
    edge = max(distance[asked - 1] if asked > count else 2 * distance[asked - 1], 1)
    square = [(2**10 - (distance[k] << 10) // edge) ** 2 for k in range(count)]
    total = max(sum(square), 1)
    weight = [(s << 12) // total for s in square] + [0] * (4 - count)
    weight[0] += 2**12 - sum(weight)
    return Gathered(rank[:count] + [rank[0]] * (4 - count), weight)

"""Section 9.2: levels of detail."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from tests.spec_decoder.basics import clip, round_shift

if TYPE_CHECKING:
    from tests.spec_decoder.basics import Matrix, Row


def num_lods(n: int, most: int = 8) -> int:
    count = 0
    while count < most and n >> (count + 1) >= 32:
        count += 1
    return count


@dataclass
class Lods:
    """Levels of detail of `count` rows; distance weights with `positions`, else equal ones (9.2)."""

    count: int
    positions: Matrix | None = None
    most: int = 8
    _weights: dict[int, Row] = field(default_factory=dict)

    def finest(self, most: int) -> Lods:
        """17.3: of the levels only these count."""
        return replace(self, most=most)

    @property
    def base(self) -> range:
        return range(0, self.count, 2 ** num_lods(self.count, self.most))

    def levels(self) -> Iterator[tuple[range, Callable[[int], Row]]]:
        """The rows of each level, and a function that gives the neighbours of a row."""
        for lod in range(num_lods(self.count, self.most) - 1, -1, -1):
            step = 2 ** (lod + 1)
            last = (self.count - 1) // step

            def neighbours(row: int, lod: int = lod, step: int = step, last: int = last) -> Row:
                i = (row - 2**lod) // step
                return [clip(i + k - 3, 0, last) * step for k in range(8)]

            yield range(2**lod, self.count, step), neighbours

    def weights(self, row: int, neighbours: Row) -> Row:
        if self.positions is None:
            return [32] * 8
        if row not in self._weights:
            self._weights[row] = distance_weights(
                self.positions[row], [self.positions[n] for n in neighbours]
            )
        return self._weights[row]

    def statistics(self, row: int, neighbours: Row, values: Row) -> tuple[int, int]:
        weight = self.weights(row, neighbours)
        mean = sum(values[n] * w for n, w in zip(neighbours, weight, strict=True))
        middle = round_shift(mean, 8)
        return mean, sum(abs(values[n] - middle) * w for n, w in zip(neighbours, weight, strict=True))


def distance_weights(q: Row, neighbours: Matrix) -> Row:
    inverse = []
    for other in neighbours:
        d = [min(abs(a - b), 1 << 20) for a, b in zip(other, q, strict=True)]
        inverse.append(2**32 // (math.isqrt(sum(c * c for c in d)) + 1))
    total = sum(inverse)
    weight = [(x << 8) // total for x in inverse]
    weight[inverse.index(max(inverse))] += 256 - sum(weight)
    return weight

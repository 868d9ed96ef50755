"""Profile PAPER: control points give their motion away."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from tests.spec_decoder.basics import CONSTANTS, POSITION, ROTATION, STATE_LIMIT, clip, round_shift
from tests.spec_decoder.gathering import farthest, squared_distance
from tests.spec_decoder.state import State, normalise

if TYPE_CHECKING:
    from tests.spec_decoder.basics import Matrix, Row
    from tests.spec_decoder.gathering import ControlHeader

#: B.7
DECAY: Row = CONSTANTS["B.7"]["DECAY"]


def decayed(x: int) -> int:
    if x >= 2**16:
        return 0
    r = 2**24
    for b in range(16):
        if x >> b & 1:
            r = round_shift(r * DECAY[b], 24)
    return r


def neighbours(cell: Row, cells: Matrix, num_neighbours: int, decay_exponent: int) -> list[tuple[int, int]]:
    """B.7: Gaussians of the I-frame and their weights."""
    squared = [squared_distance(cell, other) for other in cells]
    nearest = sorted(range(len(cells)), key=lambda i: (squared[i], i))[: min(num_neighbours, len(cells))]
    shift = decay_exponent + 8
    distance = [math.isqrt(squared[i] << 8) for i in nearest]
    beyond = [d - distance[0] for d in distance]
    left = [decayed(b << shift if shift >= 0 else b >> -shift) for b in beyond]
    weight = [(v << 16) // sum(left) for v in left]
    weight[0] += 2**16 - sum(weight)
    return list(zip(nearest, weight, strict=True))


class Spreading:
    """B.7: control points of a GoF, and over whom they spread their motion."""

    def __init__(self, positions: Matrix, control: ControlHeader) -> None:
        middle = positions[len(positions) // 2]
        self.cells = [
            [clip((a - b) >> control.shift, -(2**20), 2**20) for a, b in zip(p, middle, strict=True)]
            for p in positions
        ]
        self.gaussian = farthest(self.cells, min(max(1, len(positions) // control.spacing), 16384))
        self._found: dict[tuple[int, int], list[list[tuple[int, int]]]] = {}

    def _neighbours(self, spread: tuple[int, int]) -> list[list[tuple[int, int]]]:
        """Of each control point; they stay for the GoF."""
        if spread not in self._found:
            self._found[spread] = [neighbours(self.cells[i], self.cells, *spread) for i in self.gaussian]
        return self._found[spread]

    def moved(self, reference: State, motions: Matrix, spread: tuple[int, int]) -> State:
        """With the seven components of each control point."""
        total = [[0] * 7 for _ in self.cells]
        for m, found in zip(motions, self._neighbours(spread), strict=True):
            for i, weight in found:
                total[i] = [a + weight * b for a, b in zip(total[i], m, strict=True)]
        planes = dict(reference.planes)
        positions, rotations = list(planes[POSITION]), list(planes[ROTATION])
        for i, row in enumerate(total):
            received = [round_shift(value, 16) for value in row]
            positions[i] = [clip(positions[i][c] + received[c], -STATE_LIMIT, STATE_LIMIT) for c in range(3)]
            r = [rotations[i][c] + clip(received[3 + c], -(2**24), 2**24) for c in range(4)]
            if any(received[3:]) and any(r):
                rotations[i] = normalise(r)
        planes[POSITION], planes[ROTATION] = positions, rotations
        return State(planes, reference.order)

"""Sections 14.3 to 14.6: control points move, and Gaussians with them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from tests.spec_decoder.basics import POSITION, ROTATION, STATE_LIMIT, clip, require, round_shift, zeros
from tests.spec_decoder.gathering import farthest, gather
from tests.spec_decoder.inter import num_blocks
from tests.spec_decoder.lods import Lods
from tests.spec_decoder.prior import PriorColumn, column_inputs, log, prior_column, size
from tests.spec_decoder.state import State, from_stereo, multiply, normalise
from tests.spec_decoder.stream import occurring, open_streams
from tests.spec_decoder.topology import merged

if TYPE_CHECKING:
    from tests.spec_decoder.basics import Fields, Matrix, Row
    from tests.spec_decoder.gathering import ControlHeader, Gathered
    from tests.spec_decoder.prior import PriorModel
    from tests.spec_decoder.stream import RangeDecoder
    from tests.spec_decoder.topology import Place


@dataclass
class MotionSymbols:
    """14.3: a mode for each block, who follows, six symbols of each control point."""

    mode: Row
    follows: list[bool]
    symbols: Matrix


def matrix(v: Row) -> Matrix:
    w, x, y, z = from_stereo(v)
    m = [
        [-(y * y + z * z), x * y - w * z, x * z + w * y],
        [x * y + w * z, -(x * x + z * z), y * z - w * x],
        [x * z - w * y, y * z + w * x, -(x * x + y * y)],
    ]
    return [[round_shift(e, 27) for e in row] for row in m]


class MotionField:
    """Control points of a GoF, and the Gaussians bound to them."""

    def __init__(self, positions: Matrix, control: ControlHeader, prior: PriorModel | None) -> None:
        n = len(positions)
        self.prior = prior
        self.middle, self.shift = positions[n // 2], control.shift
        cells = [self.cell(p) for p in positions]
        self.gaussian = farthest(cells, min(max(1, n // control.spacing), 16384))
        count = len(self.gaussian)
        own_cells = [cells[i] for i in self.gaussian]
        self.cells = cells
        self.points = [gather(cell, own_cells) for cell in cells]
        self.pivot = [list(positions[i]) for i in self.gaussian]
        # 14.1: levels begin at 0, 1, 4, 16, ...; those of the first gather from none
        starts = [0, *(4**level for level in range(count) if 4**level < count)]
        self.binding: list[Gathered | None] = []
        for start, stop in zip(starts, [*starts[1:], count], strict=True):
            for cell in own_cells[start:stop]:
                self.binding.append(gather(cell, own_cells[:start]) if start > 0 else None)
        self.habit_t, self.habit_v = zeros(count), zeros(count)
        self.t, self.v, self.matrices = zeros(count), zeros(count), [zeros(3)] * count
        self.translation_step = 1
        self.last = MotionSymbols([], [False] * n, [[0] * 6 for _ in range(count)])

    def cell(self, position: Row) -> Row:
        return [
            clip((a - b) >> self.shift, -(2**20), 2**20) for a, b in zip(position, self.middle, strict=True)
        ]

    def keep(self, kept: Row) -> None:
        """15.2."""
        self.cells = [self.cells[i] for i in kept]
        self.points = [self.points[i] for i in kept]
        self.last = replace(self.last, mode=[], follows=[self.last.follows[i] for i in kept])

    def insert(self, births: Matrix, rows: list[Place]) -> None:
        """15.4, from the positions of births."""
        cells = [self.cell(position) for position in births]
        own_cells = [self.cell(pivot) for pivot in self.pivot]
        self.points = merged(rows, self.points, [gather(cell, own_cells) for cell in cells])
        self.cells = merged(rows, self.cells, cells)
        follows = merged(rows, self.last.follows, [False] * len(births))
        self.last = replace(self.last, mode=[], follows=follows)

    def decode(self, fields: Fields) -> MotionSymbols:
        """6.3, 14.3; moves the control points."""
        steps = (fields.uvarint(), fields.uvarint())
        require(1 <= steps[0] <= STATE_LIMIT and steps[1] <= 2**18)
        streams = open_streams(fields, 2)
        mode, follows = self._followers(next(streams))
        symbols = self._symbols(next(streams), steps)
        require(next(streams, None) is None)
        self.last = MotionSymbols(mode, follows, symbols)
        self._move(symbols, steps)
        return self.last

    def _followers(self, stream: RangeDecoder) -> tuple[Row, list[bool]]:
        n = len(self.points)
        before, followed = self.last.mode, self.last.follows
        if len(before) != num_blocks(n):
            before = [0] * num_blocks(n)
        mode = stream.grouped(before, stream.read_histograms(occurring(before), 3))
        follows = [mode[i >> 6] == 1 for i in range(n)]
        rows = [i for i in range(n) if mode[i >> 6] == 2]
        if rows:
            contexts = [int(followed[i]) for i in rows]
            flags = stream.grouped(contexts, stream.read_histograms(occurring(contexts), 2))
            for i, flag in zip(rows, flags, strict=True):
                follows[i] = flag == 1
        return mode, follows

    def _symbols(self, stream: RangeDecoder, steps: tuple[int, int]) -> Matrix:
        """14.3."""
        rows = sorted(range(len(self.pivot)), key=lambda k: self.gaussian[k])
        symbols = [[0] * 6 for _ in self.pivot]
        num_columns = 6 if steps[1] > 0 else 3
        columns = self._columns(stream, rows, (num_columns, steps))
        for c, column in enumerate(columns):
            for k, s in zip(rows, column, strict=True):
                require(abs(s) <= 2 * STATE_LIMIT // steps[min(c // 3, 1)])
                symbols[k][c] = s
        return symbols

    def _columns(self, stream: RangeDecoder, rows: Row, coding: tuple[int, tuple[int, int]]) -> Iterator[Row]:
        """14.3; `coding` is the number of columns and the steps."""
        num_columns, steps = coding
        model = self.prior
        assert model is not None
        habits = [self._habit(k, steps) for k in rows]
        inputs = [self._prior_inputs(k, habit) for k, habit in zip(rows, habits, strict=True)]
        columns: Matrix = []
        residuals: Matrix = []
        for c in range(num_columns):
            before = [self.last.symbols[k][c] for k in rows]
            weights = model.control_weights[c]
            column = PriorColumn(
                "control",
                [*weights[: 1 + c], *weights[-2:]],
                [
                    *([16 * r for r in residual] for residual in residuals),
                    [16 * s for s in before],
                    [habit[c] for habit in habits],
                ],
                inputs,
                [0] * len(rows),
                [
                    column_inputs(s, [column[j] for column in columns], 64 if c >= 3 else 0)
                    for j, s in enumerate(before)
                ],
            )
            value, residual = prior_column(stream, model, Lods(len(rows)), column)
            yield value
            columns.append(value)
            residuals.append(residual)

    def _habit(self, k: int, steps: tuple[int, int]) -> Row:
        """14.3: the expected change in six columns."""
        turns = [16 * h // steps[1] if steps[1] > 0 else 0 for h in self.habit_v[k]]
        return [*(16 * h // steps[0] for h in self.habit_t[k]), *turns]

    def _prior_inputs(self, k: int, habit: Row) -> Row:
        """14.3: x."""
        x = [log(size(self.last.symbols[k])), log(size(habit))]
        point = self.binding[k]
        if point is None:
            x += [0, 0]
        else:
            efforts = [effort >> 4 for effort in point.effort]
            x += [efforts[point.choice], max(efforts) - min(efforts)]
        return [min(value, 255) for value in x]

    def _displace(self, k: int, x: Row) -> Row:
        offset = [a - b for a, b in zip(x, self.pivot[k], strict=True)]
        return [
            self.t[k][a]
            + round_shift(sum(e * o for e, o in zip(self.matrices[k][a], offset, strict=True)), 20)
            for a in range(3)
        ]

    def displacements(self, point: Gathered, x: Row) -> Matrix:
        return point.candidates([self._displace(k, x) for k in point.rank])

    def turns(self, point: Gathered) -> Matrix:
        return point.candidates([self.v[k] for k in point.rank])

    def _move(self, symbols: Matrix, steps: tuple[int, int]) -> None:
        """14.4."""
        self.translation_step, turn_step = steps
        for k, point in enumerate(self.binding):
            t, v = [0] * 3, [0] * 3
            if point is not None:
                t = self.displacements(point, self.pivot[k])[point.choice]
                v = self.turns(point)[point.choice]
            s, limit = symbols[k], 2 * STATE_LIMIT
            self.t[k] = [clip(t[a] + s[a] * self.translation_step, -limit, limit) for a in range(3)]
            self.v[k] = [0] * 3
            if turn_step > 0:
                self.v[k] = [clip(v[a] + s[3 + a] * turn_step, -(2**18), 2**18) for a in range(3)]
            self.matrices[k] = matrix(self.v[k])

    def carry(self, reference: State, follows: list[bool]) -> State:
        """14.5."""
        planes = dict(reference.planes)
        positions, rotations = list(planes[POSITION]), list(planes[ROTATION])
        for i, point in enumerate(self.points):
            if not follows[i]:
                continue
            displacement = self.displacements(point, positions[i])[point.choice]
            positions[i] = [
                clip(x + d, -STATE_LIMIT, STATE_LIMIT)
                for x, d in zip(positions[i], displacement, strict=True)
            ]
            turn = self.turns(point)[point.choice]
            if any(turn):
                rotations[i] = normalise(multiply(from_stereo(turn), rotations[i]))
        planes[POSITION], planes[ROTATION] = positions, rotations
        return State(planes, reference.order)

    def learn(self, reference: Matrix, decoded: Matrix) -> None:
        """14.6, from positions."""
        for i, point in enumerate(self.points):
            if self.last.follows[i]:
                actual = [a - b for a, b in zip(decoded[i], reference[i], strict=True)]
                point.learn(actual, self.displacements(point, reference[i]), self.translation_step)
        # pivots move when all control points have learnt: displacements are those of this frame
        for k, own in enumerate(self.binding):
            self.habit_t[k], self.habit_v[k] = self.t[k], self.v[k]
            if own is not None:
                displacements = self.displacements(own, self.pivot[k])
                own.learn(self.t[k], displacements, self.translation_step)
                chosen_t, chosen_v = displacements[own.choice], self.turns(own)[own.choice]
                self.habit_t[k] = [a - b for a, b in zip(self.t[k], chosen_t, strict=True)]
                self.habit_v[k] = [a - b for a, b in zip(self.v[k], chosen_v, strict=True)]
        self.pivot = [
            [clip(x + d, -STATE_LIMIT, STATE_LIMIT) for x, d in zip(*pair, strict=True)]
            for pair in zip(self.pivot, self.t, strict=True)
        ]

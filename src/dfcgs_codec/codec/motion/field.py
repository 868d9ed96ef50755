"""How the control points of a GoF move, coarse to fine, and what is learnt (spec sections 14.4, 14.6).

A control point's motion is predicted from coarser ones, as if it were part of the rigid body that one of
them moves; which one is told by the frames before, without bits.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from dfcgs_codec.array_types import Float64, Int64
from dfcgs_codec.bitstream.constants import MAX_CONTROL_POINTS, STATE_LIMIT
from dfcgs_codec.bitstream.frame_headers import ControlHeader
from dfcgs_codec.bitstream.motion_header import MotionHeader
from dfcgs_codec.codec.motion.followers import Binding
from dfcgs_codec.codec.state.planes import scaled
from dfcgs_codec.transform.control_points import farthest_points, gather_from
from dfcgs_codec.transform.rigid import RigidMotion
from dfcgs_codec.transform.rotation import STEREO_ONE

#: each level has this many times the control points of all coarser ones together, and one more
LEVEL_GROWTH_LOG2 = 2


def level_starts(count: int) -> list[int]:
    """First control point of each level, and `count` at the end: 0, 1, 4, 16, ..."""
    starts = [0, 1]
    while starts[-1] < count:
        starts.append(starts[-1] << LEVEL_GROWTH_LOG2)
    return [*starts[:-1], count]


def control_points(cells: Int64, control: ControlHeader) -> Int64:
    """Which of the I-frame's Gaussians, at `cells` (N, 3), are control points (n,), coarse to fine.

    One for every `spacing` Gaussians, at least one.
    """
    return farthest_points(cells, min(max(1, len(cells) // control.spacing), MAX_CONTROL_POINTS))


@dataclass(frozen=True)
class MotionHistory:
    """How each control point's last motion differed from its prediction by coarser ones; int64 (n, 3)."""

    translations: Int64
    vectors: Int64


def _rest(count: int) -> MotionHistory:
    nothing = np.zeros((count, 3), np.int64)
    return MotionHistory(nothing, nothing)


#: gives the symbols (rows, 6) of control points `rows`, told their expected translations and turns
SymbolSource = Callable[[slice, Int64, Int64], Int64]


@dataclass(frozen=True)
class FieldMotion:
    """Motion of all control points in one frame, and how each level's candidates predicted it."""

    motion: RigidMotion
    #: for each level but the first: displacements (5, 3, rows) by candidate
    predicted: list[Float64] = field(default_factory=list)


@dataclass(frozen=True)
class MotionField:
    """Control points of a GoF before a frame: where they are, who predicts whom, and their history.

    `gaussians` (n,): index in the I-frame, coarse to fine; `pivots` (n, 3) move along.
    """

    gaussians: Int64
    pivots: Int64
    parents: list[Binding]
    history: MotionHistory

    @property
    def num_points(self) -> int:
        """n."""
        return len(self.gaussians)

    @staticmethod
    def of(positions: Int64, cells: Int64, control: ControlHeader) -> MotionField:
        """Control points of I-frame `positions` (N, 3)."""
        points = control_points(cells, control)
        chosen = cells[points]
        starts = level_starts(len(points))
        parents = [
            Binding.of(gather_from(chosen[start:end], chosen[:start])) for start, end in pairwise(starts[1:])
        ]
        return MotionField(points, positions[points], parents, _rest(len(points)))

    def move(self, header: MotionHeader, symbols: SymbolSource) -> FieldMotion:
        """Motion of all control points, level by level: prediction plus steps times what `symbols` gives."""
        translations = np.zeros((self.num_points, 3), np.int64)
        vectors = np.zeros((self.num_points, 3), np.int64)
        predicted = []
        for start, end, binding in self._levels():
            rows = slice(start, end)
            expected = translations[rows], vectors[rows]
            if binding is not None:
                coarse = RigidMotion(self.pivots[:start], translations[:start], vectors[:start])
                moves = binding.moves(coarse, self.pivots[rows].T.astype(np.float64))
                expected = binding.chosen(moves).T.astype(np.int64), binding.turns(coarse)
                predicted.append(moves)
            change = symbols(rows, *expected)
            moved = expected[0] + scaled(change[:, :3], header.translation_step)
            translations[rows] = np.clip(moved, -2 * STATE_LIMIT, 2 * STATE_LIMIT)
            if header.is_rigid:
                turned = expected[1] + scaled(change[:, 3:6], header.turn_step)
                vectors[rows] = np.clip(turned, -STEREO_ONE, STEREO_ONE)
        return FieldMotion(RigidMotion(self.pivots, translations, vectors), predicted)

    def _levels(self) -> list[tuple[int, int, Binding | None]]:
        """First and last + 1 control point of each level, and who predicts them: nobody the first."""
        starts = level_starts(self.num_points)
        return [
            (*ends, binding) for ends, binding in zip(pairwise(starts), [None, *self.parents], strict=True)
        ]

    def after(self, moved: FieldMotion, step: int) -> MotionField:
        """The field before the next frame; `step` is that of translations."""
        motion = moved.motion
        translations, vectors = motion.translations.copy(), motion.vectors.copy()
        parents = []
        for (start, end, _), binding, moves in zip(
            self._levels()[1:], self.parents, moved.predicted, strict=True
        ):
            learnt = binding.learn(moves, motion.translations[start:end].T.astype(np.float64), step)
            coarse = RigidMotion(self.pivots[:start], motion.translations[:start], motion.vectors[:start])
            translations[start:end] -= learnt.chosen(moves).T.astype(np.int64)
            vectors[start:end] -= learnt.turns(coarse)
            parents.append(learnt)
        pivots = np.clip(self.pivots + motion.translations, -STATE_LIMIT, STATE_LIMIT)
        return replace(self, pivots=pivots, parents=parents, history=MotionHistory(translations, vectors))

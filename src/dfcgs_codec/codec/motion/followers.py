"""Which control point a Gaussian follows, learnt from what was decoded (spec sections 14.2, 14.6).

Each Gaussian has five candidates: the blend of its four nearest control points, and each of them alone. After
every frame both sides know which of them would have come closest, and let that one lead next time.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dfcgs_codec.array_types import Float64, Int32, Int64
from dfcgs_codec.transform.control_points import GATHER_WEIGHT_BITS, NUM_GATHERED, Gathering
from dfcgs_codec.transform.lod import ladder
from dfcgs_codec.transform.pieces import pieces
from dfcgs_codec.transform.rigid import RigidMotion, displacements

#: candidates: the blend, then the four control points
NUM_CANDIDATES = 1 + NUM_GATHERED
BLEND = 0
#: a frame's effort is counted in 1/16 of a half octave; an older one fades by a quarter with each frame
EFFORT_FRACTION_BITS = 4
EFFORT_DECAY_LOG2 = 2
#: effort that the blend is forgiven
BLEND_ADVANTAGE = 16
_MAX_EFFORT_CLASS = 64
#: errors are counted in this many translation steps, so that those below do not matter
EFFORT_STEPS = 4


def efforts_of(errors: Float64, step: int) -> Int32:
    """Half octaves of `errors` (integers >= 0) in multiples of `step`: about what their residual costs."""
    # exact: both are integers, and the quotient of those below 2**53 never rounds up to an integer
    classes = ladder(np.floor(errors / (EFFORT_STEPS * step)), _MAX_EFFORT_CLASS)
    return (classes << EFFORT_FRACTION_BITS).astype(np.int32)


def blend(values: list[Float64], weights: Int64) -> Float64:
    """Mean of four control points' integers (..., N), rounded to nearest; `weights` (4, N) sum to 2**12."""
    total: Float64 = values[0] * weights[0]
    for value, weight in zip(values[1:], weights[1:], strict=True):
        total += value * weight
    total += float(1 << (GATHER_WEIGHT_BITS - 1))
    total *= 2.0**-GATHER_WEIGHT_BITS
    np.floor(total, out=total)
    return total


@dataclass(frozen=True)
class Binding:
    """Control points of N points: `gathering`, the candidates' `efforts` (5, N) so far, the `choice` (N,)."""

    gathering: Gathering
    efforts: Int32
    choice: Int64

    @staticmethod
    def of(gathering: Gathering) -> Binding:
        """Before anything is known, all follow the blend."""
        count = gathering.ranks.shape[1]
        return Binding(gathering, np.zeros((NUM_CANDIDATES, count), np.int32), np.zeros(count, np.int64))

    def of_rows(self, rows: Int64) -> Binding:
        """The same of some points."""
        if len(rows) == len(self.choice):
            return self
        return Binding(self.gathering.of(rows), self.efforts[:, rows], self.choice[rows])

    def with_rows(self, rows: Int64, learnt: Binding) -> Binding:
        """With what was `learnt` of some points."""
        if len(rows) == len(self.choice):
            return learnt
        efforts, choice = self.efforts.copy(), self.choice.copy()
        efforts[:, rows], choice[rows] = learnt.efforts, learnt.choice
        return replace(self, efforts=efforts, choice=choice)

    def merge(self, births: Binding, source: Int64) -> Binding:
        """With `births`: point i of the result is point source[i] of these and those."""
        gathering = Gathering(
            np.concatenate([self.gathering.ranks, births.gathering.ranks], axis=1)[:, source],
            np.concatenate([self.gathering.weights, births.gathering.weights], axis=1)[:, source],
        )
        efforts = np.concatenate([self.efforts, births.efforts], axis=1)[:, source]
        return Binding(gathering, efforts, np.concatenate([self.choice, births.choice])[source])

    def moves(self, motion: RigidMotion, positions: Float64) -> Float64:
        """Displacements (5, 3, N), integers, of `positions` (3, N) by each candidate."""
        table, gathering = motion.table(), self.gathering
        result = np.empty((NUM_CANDIDATES, *positions.shape))
        for part in pieces(positions.shape[1]):
            some = positions[:, part]
            alone = [displacements(table, ranks[part], some) for ranks in gathering.ranks]
            for candidate, moved in enumerate(alone, BLEND + 1):
                result[candidate, :, part] = moved
            result[BLEND, :, part] = blend(alone, gathering.weights[:, part])
        return result

    def chosen(self, moves: Float64) -> Float64:
        """Of `moves` (5, 3, N) those of each point's choice, (3, N)."""
        result: Float64 = moves[BLEND].copy()
        for part in pieces(len(self.choice)):
            for candidate in range(1, NUM_CANDIDATES):
                is_chosen = self.choice[part] == candidate
                np.copyto(result[:, part], moves[candidate, :, part], where=is_chosen)
        return result

    def turns(self, motion: RigidMotion) -> Int64:
        """Turn vectors (N, 3), Q0.18, of each point's choice."""
        vectors = np.empty((len(self.choice), 3), np.int64)
        for part in pieces(len(vectors)):
            choice, ranks, found = self.choice[part], self.gathering.ranks[:, part], vectors[part]
            leader = ranks[np.maximum(choice - 1, 0), np.arange(len(choice))]
            motion.vectors.take(leader, axis=0, out=found)
            rows = np.flatnonzero(choice == BLEND)
            alone = [motion.vectors.take(of_one[rows], axis=0).T.astype(np.float64) for of_one in ranks]
            found[rows] = blend(alone, self.gathering.weights[:, part][:, rows]).T
        return vectors

    def learn(self, moves: Float64, actual: Float64, step: int) -> Binding:
        """After a frame: `moves` (5, 3, N) of the candidates, what happened (3, N), translation step."""
        efforts, choice = np.empty_like(self.efforts), np.empty_like(self.choice)
        for part in pieces(len(choice)):
            errors = np.abs(moves[:, 0, part] - actual[0, part])
            for axis in (1, 2):
                errors += np.abs(moves[:, axis, part] - actual[axis, part])
            before = self.efforts[:, part]
            efforts[:, part] = before - (before >> EFFORT_DECAY_LOG2) + efforts_of(errors, step)
            choice[part] = choose(efforts[:, part])
        return replace(self, efforts=efforts, choice=choice)


def choose(efforts: Int32) -> Int64:
    """The candidate of least effort, the first of equals; the blend has an advantage."""
    judged = efforts.copy()
    judged[BLEND] -= BLEND_ADVANTAGE
    best: Int64 = judged.argmin(axis=0)
    return best

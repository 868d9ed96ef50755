"""The rigid motions that carry the decoded reference nearest to a frame (weighted Procrustes)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csc_array

from dfcgs_codec.array_types import Float64, Int64
from dfcgs_codec.bitstream.constants import STATE_LIMIT
from dfcgs_codec.bitstream.motion_header import MotionHeader
from dfcgs_codec.codec.motion.field import MotionField
from dfcgs_codec.codec.motion.followers import BLEND, Binding, blend
from dfcgs_codec.transform.control_points import GATHER_WEIGHT_BITS
from dfcgs_codec.transform.pieces import pieces
from dfcgs_codec.transform.rigid import RigidMotion, displacements
from dfcgs_codec.transform.rotation import ONE, STEREO_ONE, from_stereo, to_stereo

#: a control point that carries less than this many Gaussians has no motion of its own
_MIN_SUPPORT = 3.0
#: how much a fit prefers not to turn, relative to its spread
_STILL_SHARE = 1e-4
#: position steps at which a Gaussian that goes elsewhere counts half
_TRUSTED_STEPS = 2.0
#: columns of the sums: weight, source, target, source x target
_WEIGHT, _SOURCE, _TARGET, _CROSS = slice(0, 1), slice(1, 4), slice(4, 7), slice(7, 16)


@dataclass(frozen=True)
class Moments:
    """Sums over the Gaussians that each control point carries; (n, 16) float64, about `center` (3,)."""

    sums: Float64
    center: Float64


def _carriers(binding: Binding, num_points: int) -> csc_array:
    """How much each control point carries each of N Gaussians; (n, N) sparse, a column for each Gaussian."""
    blended = binding.choice == BLEND
    shares = (binding.gathering.weights.T / (1 << GATHER_WEIGHT_BITS)) ** 2
    weights = np.where(blended[:, None], shares, 1.0)
    taken = blended[:, None] | (binding.choice[:, None] == np.arange(1, shares.shape[1] + 1))
    starts = np.concatenate([np.zeros(1, np.int64), np.cumsum(taken.sum(axis=1))])
    ranks = binding.gathering.ranks.T[taken]
    return csc_array((weights[taken], ranks, starts), shape=(num_points, len(blended)))


def measure(
    binding: Binding, source: Float64, target: Float64, num_points: int, trust: Float64 | None = None
) -> Moments:
    """Moments of the motion of N Gaussians from `source` to `target`, (N, 3) each.

    `trust` (N,): weights of a robust fit.
    """
    center = source.mean(axis=0)
    columns = np.empty((len(source), 16))
    for part in pieces(len(source)):
        some = np.empty((16, part.stop - part.start))
        some[_WEIGHT] = 1.0
        np.subtract(source[part].T, center[:, None], out=some[_SOURCE])
        np.subtract(target[part].T, center[:, None], out=some[_TARGET])
        for axis in range(3):
            np.multiply(some[1 + axis], some[_TARGET], out=some[7 + 3 * axis : 10 + 3 * axis])
        if trust is not None:
            some *= trust[part]
        columns[part] = some.T
    return Moments(_carriers(binding, num_points) @ columns, center)


def chosen_moves(binding: Binding, motion: RigidMotion, positions: Float64) -> Float64:
    """Displacements (3, N) of `positions` (3, N) by each one's choice, without those of other candidates."""
    table, result = motion.table(), np.empty_like(positions)
    gathering = binding.gathering
    for part in pieces(positions.shape[1]):
        choice, some, ranks = binding.choice[part], positions[:, part], gathering.ranks[:, part]
        leader = ranks[np.maximum(choice - 1, 0), np.arange(len(choice))]
        result[:, part] = displacements(table, leader, some)
        rows = np.flatnonzero(choice == BLEND)
        alone = [displacements(table, of_one[rows], some[:, rows]) for of_one in ranks]
        result[:, part.start + rows] = blend(alone, gathering.weights[:, part][:, rows])
    return result


def trusted(errors: Float64, step: int) -> Float64:
    """Weights (N,) of Gaussians whose motion misses by `errors` (N, 3): less for those that go elsewhere."""
    x, y, z = errors.T
    distance = (x * x + y * y + z * z) / (_TRUSTED_STEPS * step) ** 2
    weights: Float64 = 1.0 / (1.0 + distance)
    return weights


def _turns(moments: Moments) -> Float64:
    """Turn vectors (n, 3), in units of the stereographic one, that carry sources to targets best."""
    sums = moments.sums
    weight = np.maximum(sums[:, _WEIGHT], 1e-9)
    source, target = sums[:, _SOURCE] / weight, sums[:, _TARGET] / weight
    spread = (sums[:, _CROSS] / weight).reshape(-1, 3, 3) - source[:, :, None] * target[:, None, :]
    size = np.linalg.norm(spread, axis=(1, 2)) + 1e-9
    spread += np.eye(3) * (_STILL_SHARE * size)[:, None, None]
    u, _, vt = np.linalg.svd(spread)
    sign = np.sign(np.linalg.det(u @ vt))
    vt[:, 2] *= sign[:, None]
    matrices = np.swapaxes(u @ vt, 1, 2)
    return to_stereo(_quaternions(matrices))


def _quaternions(matrices: Float64) -> Float64:
    """Unit quaternions (n, 4) of rotation matrices (n, 3, 3) of less than half a turn."""
    m = matrices
    w = np.sqrt(np.maximum(1 + m[:, 0, 0] + m[:, 1, 1] + m[:, 2, 2], 1e-6)) / 2
    x = (m[:, 2, 1] - m[:, 1, 2]) / (4 * w)
    y = (m[:, 0, 2] - m[:, 2, 0]) / (4 * w)
    z = (m[:, 1, 0] - m[:, 0, 1]) / (4 * w)
    quaternions = np.stack([w, x, y, z], axis=1)
    quaternions /= np.linalg.norm(quaternions, axis=1, keepdims=True)
    return quaternions


class MotionQuantiser:
    """Gives `MotionField.move` the symbols that come closest to the motion measured."""

    def __init__(self, field: MotionField, moments: Moments, header: MotionHeader, zero_bin: float) -> None:
        self._field, self._moments, self._header, self._zero_bin = field, moments, header, zero_bin
        self._turns = _turns(moments) * STEREO_ONE if header.is_rigid else None
        self.symbols = np.zeros((field.num_points, 6), np.int64)

    def __call__(self, rows: slice, translations: Int64, vectors: Int64) -> Int64:
        """Symbols of control points `rows`, whose motion is expected as given."""
        sums = self._moments.sums[rows]
        held = sums[:, 0] >= _MIN_SUPPORT
        turned = np.zeros_like(vectors)
        if self._turns is not None:
            turn = self._quantised(self._turns[rows] - vectors, self._header.turn_step)
            self.symbols[rows, 3:] = turn * held[:, None]
            turned = vectors + self.symbols[rows, 3:] * self._header.turn_step
        goal = self._translations(sums, self._field.pivots[rows], turned)
        shift = self._quantised(goal - translations, self._header.translation_step)
        self.symbols[rows, :3] = shift * held[:, None]
        return self.symbols[rows]

    def _quantised(self, residual: Float64, step: int) -> Int64:
        limit = 2 * STATE_LIMIT // step
        scaled = np.clip(residual / step, -limit, limit)
        return np.where(np.abs(scaled) < self._zero_bin, 0, np.rint(scaled)).astype(np.int64)

    def _translations(self, sums: Float64, pivots: Int64, vectors: Int64) -> Float64:
        """Where pivots must go for sources to meet targets on average, given the turns."""
        weight = np.maximum(sums[:, _WEIGHT], 1e-9)
        about = pivots - self._moments.center
        source, target = sums[:, _SOURCE] / weight - about, sums[:, _TARGET] / weight - about
        w, x, y, z = (from_stereo(vectors) / ONE).T
        axis = np.stack([x, y, z], axis=1)
        side = 2 * np.cross(axis, source)
        turned = source + w[:, None] * side + np.cross(axis, side)
        return np.asarray(target - turned, np.float64)

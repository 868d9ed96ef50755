"""How an encoder chooses symbols of turns, and the axis names that they lead to."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dfcgs_codec.array_types import Float64, Int64, UInt8
from dfcgs_codec.codec.intra.turns import TurnContexts, Turns, TurnWalk, pole_turns
from dfcgs_codec.encoder.intra.trellis_search import best_path
from dfcgs_codec.encoder.matching.canonical import AxisNames, product
from dfcgs_codec.transform.rotation import CELLS, ONE, STEREO_ONE, multiply
from dfcgs_codec.transform.trellis import takes_turns


@dataclass(frozen=True)
class TurnChooser:
    """Chooses tilts and spins from where the frame is expected: to the nearest, or the best path."""

    quaternions: Int64
    walk: TurnWalk

    def choose(self, rows: slice, frames: Int64, contexts: TurnContexts) -> Turns:
        """Symbols of the Gaussians `rows`."""
        is_needle = self.walk.is_needle[rows]
        pole = np.where(is_needle, 1, 3)
        turn, flips = _unflipped(multiply(frames * np.array([1, -1, -1, -1]), self.quaternions[rows]), pole)
        swing = _times_conjugate(turn, _twist(turn, pole))
        swing[swing[:, 0] < 0] *= -1
        stereo = swing[:, 1:] / (1.0 + swing[:, :1]) * STEREO_ONE
        parts = np.where(is_needle[:, None], stereo[:, 1:], stereo[:, :2])
        steps = self.walk.tilt_steps[rows]
        both = np.concatenate([contexts[0]] * 2)
        tilts = self._nearest((parts / steps[:, None]).T.ravel(), both).reshape(2, -1).T
        # what is left to turn once the tilt is rounded
        rounded = self.walk.tilts_of(tilts, steps)
        tilted, _ = pole_turns(rounded, np.zeros(len(steps), np.int64), is_needle)
        conjugate = tilted * np.array([1, -1, -1, -1])
        left = _twist(multiply(conjugate, np.rint(turn * ONE).astype(np.int64)) / ONE, pole)
        spin = left[np.arange(len(left)), pole] / (1.0 + left[:, 0]) * STEREO_ONE
        return Turns(tilts, self._nearest(spin / self.walk.spin_steps[rows], contexts[1]), flips)

    def _nearest(self, real: Float64, contexts: UInt8) -> Int64:
        if not (self.walk.alternating and takes_turns(len(real))):
            return np.rint(real).astype(np.int64)
        return best_path(real, contexts)


def _twist(turns: Float64, pole: Int64) -> Float64:
    """The part of each turn (rows, 4) that is about the pole's axis, w >= 0, of length 1."""
    rows = np.arange(len(turns))
    result = np.zeros_like(turns)
    w, p = turns[:, 0], turns[rows, pole]
    length = np.maximum(np.hypot(w, p), 1e-12)
    sign = np.where(w < 0, -1.0, 1.0)
    result[:, 0], result[rows, pole] = np.abs(w) / length, sign * p / length
    return result


def _times_conjugate(a: Float64, b: Float64) -> Float64:
    return product(a, b * np.array([1.0, -1.0, -1.0, -1.0]))


def _unflipped(turns: Int64, pole: Int64) -> tuple[Float64, Int64]:
    """Of the four names of each Gaussian the one with the smallest tilt, then the smallest turn about it.

    And the flips that lead back.
    """
    real = turns / ONE
    rows = np.arange(len(real))
    # a half turn about axis 1 turns the pole around
    upright = real[:, 0] ** 2 + real[rows, pole] ** 2 >= 0.5
    real = np.where(upright[:, None], real, _times_conjugate(real, np.array([[0.0, 0.0, 1.0, 0.0]])))
    about = np.zeros_like(real)
    about[rows, pole] = 1.0
    near = np.abs(real[:, 0]) >= np.abs(real[rows, pole])
    # about the pole first, then about axis 1: i j = k, and k j is i but for its sign
    both = np.where(pole == 1, 3, 1)
    flips = np.where(upright, np.where(near, 0, pole), np.where(near, 2, both))
    return np.where(near[:, None], real, _times_conjugate(real, about)), flips


def settled_names(names: AxisNames, target: Int64, decoded: Int64) -> AxisNames:
    """The names under which `target` quaternions (N, 4) lie near the `decoded` ones: flipped where needed."""
    turn = np.abs(multiply(decoded * np.array([1, -1, -1, -1]), target))
    flips = turn.argmax(axis=1)
    flipped = np.flatnonzero(flips)
    turns = names.turns.copy()
    turns[flipped] = multiply(turns[flipped], CELLS[flips[flipped]] * ONE)
    return AxisNames(names.order, turns)

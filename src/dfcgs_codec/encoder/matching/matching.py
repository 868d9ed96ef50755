"""Re-identification: which Gaussian of the frame before is which Gaussian of this one, the order being lost.

Attributes equal bit for bit tell first. The others are matched as nearest neighbours in a space of position
and appearance whose units are typical changes from frame to frame: assumed for a sample, found by appearance
more than by position, and measured from then on. Matched neighbours predict how the rest moved.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dfcgs_codec.array_types import Float64, Int64
from dfcgs_codec.encoder.matching.descriptors import appearance, features, match_bits, spread
from dfcgs_codec.encoder.matching.nearest import (
    Pairs,
    certain_pairs,
    mutual,
    next_nearest,
    passing,
    sample,
    tree,
)
from dfcgs_codec.gaussians import GaussianCloud

#: changes assumed at first, as shares of the spread of appearance and of positions
_FIRST_CHANGE, _FIRST_TRAVEL = 0.05, 0.05
#: smallest changes used: of appearance as a share of its spread, of positions as a share of typical spacing
_LEAST_CHANGE, _LEAST_TRAVEL = 1e-3, 0.5
#: what float32 resolves of positions, share of their spread
_RESOLUTION = 1e-6
#: matched neighbours that predict a motion
_NEIGHBOURS = 4
#: largest distances of a pair, in typical changes: without ratio test, and with
_REACH, _FAR_REACH = 8.0, 32.0
#: rounds over all, then over the leftovers if these are at most this share of the frame
_ROUNDS, _LEFT_SHARE = 2, 0.1
#: 90 % of the lengths of vectors of 1 and 3 standard normal numbers are below these
_NORMAL_90, _NORMAL_90_3D = 1.64, 2.5


@dataclass
class _Frames:
    """Two frames, and the pairs so far.

    `before` and `now` are positions (N, 3) from the middle of their frame, in units of `before`'s spread;
    appearances are (N, 10). Each of `guesses` (N_before, 3) says how far Gaussians might have moved,
    nan where it does not know. `partner` (N_now,) is the result so far.
    """

    before: Float64
    now: Float64
    appearance_before: Float64
    appearance_now: Float64
    guesses: list[Float64]
    partner: Int64

    def matched(self) -> Int64:
        """Rows of `now` that have a partner."""
        return np.flatnonzero(self.partner >= 0)

    def free(self) -> Pairs:
        """Rows of `before` and rows of `now` without partner."""
        unmatched = np.ones(len(self.before), bool)
        unmatched[self.partner[self.matched()]] = False
        return np.flatnonzero(unmatched), np.flatnonzero(self.partner < 0)

    def done(self) -> bool:
        """Whether one of the sides has nothing left to match, or nothing is matched that could predict."""
        return min(map(len, (*self.free(), self.matched()))) == 0

    def accept(self, pairs: Pairs) -> Int64:
        """Write pairs down; returns their rows of `now`."""
        self.partner[pairs[1]] = pairs[0]
        return pairs[1]


def _frames(before: GaussianCloud, now: GaussianCloud, moved: Float64 | None, partner: Int64) -> _Frames:
    positions = [cloud.positions.astype(np.float64) for cloud in (before, now)]
    size = spread(positions[0]).max()
    middles = [np.median(p, axis=0) for p in positions]
    old, new = ((p - middle) / size for p, middle in zip(positions, middles, strict=True))
    guesses = [np.zeros_like(old)]
    if moved is not None:
        guesses.append((moved + middles[0] - middles[1]) / size)
    return _Frames(old, new, appearance(before), appearance(now), guesses, partner)


def _first_units(frames: _Frames) -> tuple[Float64, Float64]:
    """(13,) typical changes of position and appearance to begin with, and the smallest ones used later."""
    places, rows = tree(frames.before, _RESOLUTION)
    spacing = float(np.median(places.query(places.data[sample(len(rows))], k=[2])[0]))
    travel = max(_RESOLUTION, _LEAST_TRAVEL * spacing if np.isfinite(spacing) else 0.0)
    change = spread(frames.appearance_before)
    first = np.append(np.full(3, _FIRST_TRAVEL), _FIRST_CHANGE * change)
    return first, np.append(np.full(3, travel), _LEAST_CHANGE * change)


def _neighbours(known: Float64, positions: Float64, skip: int) -> tuple[Int64, Float64]:
    """Rows (N, k) of the nearest of `known` but the first `skip`; weights: inverse squares of distances."""
    places, rows = tree(known, _RESOLUTION)
    skip = min(skip, len(rows) - 1)
    ranks = range(skip + 1, min(skip + _NEIGHBOURS, len(rows)) + 1)
    distance, near = places.query(positions, k=list(ranks))
    weights = 1.0 / (distance**2 + _RESOLUTION**2)
    return rows[near], weights / weights.sum(axis=1, keepdims=True)


def _predict(frames: _Frames, rows: Int64, skip: int = 0) -> Float64:
    """Positions (n, 3) now of Gaussians `rows` of `before`, as their matched neighbours moved.

    Each moves by a guess plus what its neighbours moved beyond theirs: that guess for which these agree best.
    """
    new = frames.matched()
    old = frames.partner[new]
    near, weights = _neighbours(frames.before[old], frames.before[rows], skip)
    best, least = np.zeros((len(rows), 3)), np.full(len(rows), np.inf)
    for guess in frames.guesses:
        beyond = (frames.now[new] - frames.before[old] - guess[old])[near]
        mean = np.einsum("nk,nkd->nd", weights, beyond)
        scatter = np.abs(beyond - mean[:, None]).sum(axis=(1, 2))
        # false where a guess is nan
        better = (scatter < least) & np.isfinite(guess[rows]).all(axis=1)
        best[better] = guess[rows[better]] + mean[better]
        least[better] = scatter[better]
    return frames.before[rows] + best


def _typical_changes(frames: _Frames, found: Int64) -> Float64:
    """(13,) errors of predicted positions, and changes of appearance, of pairs: rows `found` of `now`."""
    some = found[sample(len(found))]
    old = frames.partner[some]
    error = np.linalg.norm(_predict(frames, old, skip=1) - frames.now[some], axis=1)
    change = np.abs(frames.appearance_before[old] - frames.appearance_now[some])
    travel = np.quantile(error, 0.9) / _NORMAL_90_3D
    return np.append(np.full(3, travel), np.quantile(change, 0.9, axis=0) / _NORMAL_90)


def _bootstrap(frames: _Frames, units: Float64) -> Pairs:
    """Pairs of a sample that are certain without prediction, from the guess that gives most."""
    old, new = frames.free()
    positions = [frames.before[old] + np.nan_to_num(guess[old]) for guess in frames.guesses]
    there = [features(p, frames.appearance_before[old], units) for p in positions]
    first, second = certain_pairs(there, features(frames.now[new], frames.appearance_now[new], units))
    return old[first], new[second]


def _there(frames: _Frames, old: Int64, units: Float64) -> Float64:
    return features(_predict(frames, old), frames.appearance_before[old], units)


def _match_free(frames: _Frames, units: Float64) -> Pairs:
    """Mutual neighbours among all that have no partner."""
    old, new = frames.free()
    here = features(frames.now[new], frames.appearance_now[new], units)
    first, second, _ = mutual(_there(frames, old, units), here, _REACH)
    return old[first], new[second]


def _match_leftovers(frames: _Frames, units: Float64) -> Pairs:
    """Mutual neighbours much farther apart, if that passes the ratio test against all of `now`."""
    old, new = frames.free()
    here = features(frames.now, frames.appearance_now, units)
    first, second, distance = mutual(_there(frames, old, units), here[new], _FAR_REACH)
    certain = passing(distance, next_nearest(here, new[second]))
    return old[first[certain]], new[second[certain]]


def _match_rest(frames: _Frames) -> None:
    first, least = _first_units(frames)
    units = np.append(least[:3], first[3:])
    latest = frames.matched()[:0]
    for _ in range(_ROUNDS):
        # those left over from a round may change more than the others, and are measured for themselves
        found = frames.accept(_bootstrap(frames, first))
        latest = found if len(found) else latest
        if not len(latest) or frames.done():
            break
        units = np.maximum(least, _typical_changes(frames, latest))
        latest = np.append(latest, frames.accept(_match_free(frames, units)))
        if frames.done():
            break
    for _ in range(_ROUNDS):
        too_many = np.count_nonzero(frames.partner < 0) > _LEFT_SHARE * len(frames.partner)
        if too_many or frames.done() or not len(frames.accept(_match_leftovers(frames, units))):
            break


def match(before: GaussianCloud, now: GaussianCloud, moved: Float64 | None = None) -> Int64:
    """Index in `before` of each Gaussian of `now`, (N_now,) int64, -1 for births; one-to-one.

    `moved` (N_before, 3), scene units, predicts the displacement of each Gaussian of `before`, for instance
    as that in the frame before; nan where it is unknown. It counts where matched neighbours bear it out.
    Frames that have nothing to do with each other give few pairs or none.
    """
    partner = match_bits(before, now)
    if np.count_nonzero(partner >= 0) < min(before.num_gaussians, now.num_gaussians):
        _match_rest(_frames(before, now, moved, partner))
    return partner

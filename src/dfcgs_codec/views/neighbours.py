"""Cameras and their neighbours: what stands between these, and what a step outside.

Cameras are compared as points in 12 dimensions, position and turn: a turn by one radian is as far as the
radius of the rig. Neighbours are those of the Gabriel graph, two cameras with no third in the ball between
them, that look in a similar direction: along a path only those that follow each other, on a rectangle of
cameras also those across its empty middle, and on a dome that looks inward never those across.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from dfcgs_codec.array_types import Float64, Int64

#: cameras nearer than this share of the radius are one
SAME = 1e-6
#: neighbours of a camera, at most, and how far apart they look: cos 60 degrees
_NEIGHBOURS = 6
_SIMILAR = 0.5
#: a direction leads outward where no neighbour is within about 70 degrees of it
_OUTWARD = 0.35
#: right, left, down, up, forward, backward and the corners, in the camera's axes
_SIDES = ((1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1))
_CORNERS = ((1, 1, 0), (1, -1, 0), (-1, 1, 0), (-1, -1, 0))
_DIRECTIONS = np.vstack([_SIDES, np.array(_CORNERS) / math.sqrt(2)])


@dataclass(frozen=True)
class Poses:
    """Positions (n, 3), turns (n, 3, 3), world to camera, and the given camera (n,) that each is made of."""

    positions: Float64
    rotations: Float64
    sources: Int64

    def take(self, index: Int64) -> Poses:
        """Those of `index`."""
        return Poses(*(array[index] for array in vars(self).values()))

    def features(self, radius: float) -> Float64:
        """(n, 12): distances between them are those of cameras."""
        turns = self.rotations.reshape(-1, 9) * (radius / math.sqrt(2))
        return np.hstack([self.positions, turns])


def _joined(parts: list[Poses]) -> Poses:
    return Poses(*map(np.concatenate, zip(*(vars(part).values() for part in parts), strict=True)))


def distances(points: Float64, point: Float64) -> Float64:
    """From the points (n, d) to `point` (d,)."""
    found: Float64 = np.linalg.norm(points - point, axis=1)
    return found


def edges_of(given: Poses, radius: float) -> Int64:
    """Pairs (m, 2) of neighbours, first below second: of each camera the nearest first, not too many."""
    positions, forward = given.positions, given.rotations[:, 2]
    n = len(positions)
    is_edge = forward @ forward.T >= _SIMILAR
    np.fill_diagonal(is_edge, False)
    for third in range(n):
        to_third = positions[third] - positions
        # a third camera is in the ball between two where it sees them at an obtuse angle
        is_edge &= to_third @ to_third.T >= -((SAME * radius) ** 2)
    features = given.features(radius)
    pairs = []
    for first in range(n):
        others = np.flatnonzero(is_edge[first])
        nearest = others[np.argsort(distances(features[others], features[first]), kind="stable")]
        pairs += [(min(first, other), max(first, other)) for other in nearest[:_NEIGHBOURS].tolist()]
    return np.array(list(dict.fromkeys(pairs)), np.int64).reshape(-1, 2)


def _mean_turns(rotations: Float64, weights: Float64) -> Float64:
    """The rotations (n, 3, 3) next to the weighted means of n times k, (n, k, 3, 3), by `weights` (k,).

    The first of the k where they have no mean, such as upright and upside down.
    """
    mean = np.einsum("k,nkij->nij", weights, rotations)
    u, sizes, v = np.linalg.svd(mean)
    u[:, :, 2] *= np.sign(np.linalg.det(u @ v))[:, None]
    has_mean = sizes[:, 1] > 1e-3
    turns: Float64 = np.where(has_mean[:, None, None], u @ v, rotations[:, 0])
    return turns


def _mixed(given: Poses, groups: Int64, weights: tuple[float, ...]) -> Poses:
    """Weighted means of the groups (n, k) of cameras."""
    shares = np.array(weights)
    positions = np.einsum("k,nki->ni", shares, given.positions[groups])
    first = groups[:, int(shares.argmax())]
    return Poses(positions, _mean_turns(given.rotations[groups], shares), given.sources[first])


def _triples(edges: Int64, positions: Float64) -> Int64:
    """Each camera and its two nearest neighbours (m, 3), where it has two."""
    triples = []
    for index, position in enumerate(positions):
        others = edges[(edges == index).any(axis=1)].sum(axis=1) - index
        if len(others) > 1:
            nearest = np.argsort(distances(positions[others], position), kind="stable")
            triples.append((index, *others[nearest[:2]].tolist()))
    return np.array(triples, np.int64).reshape(-1, 3)


def between(given: Poses, edges: Int64) -> Poses:
    """In the middle and at the quarters between two neighbours, and in the middle of three."""
    parts = [_mixed(given, edges, weights) for weights in ((0.5, 0.5), (0.75, 0.25), (0.25, 0.75))]
    triples = _triples(edges, given.positions)
    forward = given.rotations[:, 2]
    is_similar = (forward[triples[:, 1]] * forward[triples[:, 2]]).sum(axis=1) >= _SIMILAR
    return _joined([*parts, _mixed(given, triples[is_similar], (1 / 3, 1 / 3, 1 / 3))])


def outside(given: Poses, edges: Int64, reach: float) -> Poses:
    """Each camera moved by `reach` in those of its directions in which it has no neighbour."""
    beside = np.concatenate([edges, edges[:, ::-1]])
    parts = []
    for index, rotation in enumerate(given.rotations):
        directions = _DIRECTIONS @ rotation
        away = given.positions[beside[beside[:, 0] == index, 1]] - given.positions[index]
        away = away[np.linalg.norm(away, axis=1) > 0]
        away /= np.linalg.norm(away, axis=1, keepdims=True)
        is_outward = (directions @ away.T < _OUTWARD).all(axis=1)
        moved = given.positions[index] + reach * directions[is_outward]
        parts.append(replace(given.take(np.full(len(moved), index)), positions=moved))
    return _joined(parts)

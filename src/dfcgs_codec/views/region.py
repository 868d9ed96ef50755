"""Cameras of the region in which viewers stand: the given ones, between neighbours, and a little outside.

Cameras are compared as points in 12 dimensions, position and turn: a turn by one radian is as far as the
radius of the rig. Neighbours are those of the Gabriel graph, two cameras with no third in the ball between
them, that look in a similar direction: along a path only those that follow each other, on a rectangle of
cameras also those across its empty middle, and on a dome that looks inward never those across.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from dfcgs_codec.arguments import real, refusal, whole
from dfcgs_codec.views.camera import ViewCamera, Views

Float64 = npt.NDArray[np.float64]
Int64 = npt.NDArray[np.int64]

DEFAULT_COUNT = 24
DEFAULT_MARGIN = 0.15
#: neighbours of a camera, at most, and how far apart they look: cos 60 degrees
_NEIGHBOURS = 6
_SIMILAR = 0.5
#: given cameras that are looked at, the farthest from each other
_MOST_GIVEN = 256
#: so many cameras, the farthest from each other, say how large a rig is: the margin is a share of the
#: distance between them, which is the spacing of a sparse rig, and grows neither with a dense one's number
#: of cameras nor with the length of a path
_SPREAD_OUT = 8
#: cameras nearer than this share of the radius are one
_SAME = 1e-6
#: where no rig says how far viewers move: a share of the scene
_SCENE_SHARE = 1 / 8
#: a direction leads outward where no neighbour is within about 70 degrees of it
_OUTWARD = 0.35
#: from which kind the next camera is taken: given, between, outside
_TURNS = (0, 1, 2, 0, 1)
#: right, left, down, up, the corners, forward and backward, in the camera's axes
_DIRECTIONS = np.array(
    [(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (1, 1, 0), (1, -1, 0), (-1, 1, 0), (-1, -1, 0)]
    + [(0, 0, 1), (0, 0, -1)],
    np.float64,
)


@dataclass(frozen=True)
class _Poses:
    """Positions (n, 3), turns (n, 3, 3), world to camera, and the given camera (n,) that each is made of."""

    positions: Float64
    rotations: Float64
    sources: Int64

    def take(self, index: Int64) -> _Poses:
        """Those of `index`."""
        return _Poses(self.positions[index], self.rotations[index], self.sources[index])

    def features(self, radius: float) -> Float64:
        """(n, 12): distances between them are those of cameras."""
        turns = self.rotations.reshape(-1, 9) * (radius / math.sqrt(2))
        return np.hstack([self.positions, turns])


def _joined(parts: list[_Poses]) -> _Poses:
    return _Poses(
        np.concatenate([part.positions for part in parts]),
        np.concatenate([part.rotations for part in parts]),
        np.concatenate([part.sources for part in parts]),
    )


def _given(cameras: tuple[ViewCamera, ...]) -> tuple[_Poses, Float64]:
    """The cameras about the middle of their positions, and that (3,)."""
    positions = np.array([camera.position for camera in cameras])
    middle = (positions.min(axis=0) + positions.max(axis=0)) / 2
    rotations = np.array([camera.rotation for camera in cameras])
    return _Poses(positions - middle, rotations, np.arange(len(cameras))), middle


def _radius(positions: Float64, scene_size: float) -> float:
    """The radius of the rig or, of cameras in one place, the scene's size."""
    radius = float(np.linalg.norm(positions, axis=1).max())
    return radius if radius > _SAME * scene_size else scene_size or 1.0


def _distances(points: Float64, point: Float64) -> Float64:
    distances: Float64 = np.linalg.norm(points - point, axis=1)
    return distances


def _farthest(features: Float64, count: int, same: float) -> Int64:
    """`count` of the points (n, d): that nearest to the mean, then always the farthest from those before.

    Fewer where others are no further than `same` from them.
    """
    order = [int(_distances(features, features.mean(axis=0)).argmin())]
    left = _distances(features, features[order[0]])
    while len(order) < count and left.max() > same:
        order.append(int(left.argmax()))
        left = np.minimum(left, _distances(features, features[order[-1]]))
    return np.array(order)


def _edges(given: _Poses, radius: float) -> Int64:
    """Pairs (m, 2) of neighbours, first below second: of each camera those nearest first, and not too many."""
    positions, forward = given.positions, given.rotations[:, 2]
    n = len(positions)
    is_edge = forward @ forward.T >= _SIMILAR
    np.fill_diagonal(is_edge, False)
    for third in range(n):
        to_third = positions[third] - positions
        # a third camera is in the ball between two where it sees them at an obtuse angle
        is_edge &= to_third @ to_third.T >= -((_SAME * radius) ** 2)
    features = given.features(radius)
    pairs = []
    for first in range(n):
        others = np.flatnonzero(is_edge[first])
        nearest = others[np.argsort(_distances(features[others], features[first]), kind="stable")]
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


def _mixed(given: _Poses, groups: Int64, weights: tuple[float, ...]) -> _Poses:
    """Weighted means of the groups (n, k) of cameras."""
    shares = np.array(weights)
    positions = np.einsum("k,nki->ni", shares, given.positions[groups])
    first = groups[:, int(shares.argmax())]
    return _Poses(positions, _mean_turns(given.rotations[groups], shares), given.sources[first])


def _triples(edges: Int64, count: int) -> Int64:
    """Of each camera it and its two nearest neighbours, (m, 3), where these are neighbours, too, or near it."""
    beside: list[list[int]] = [[] for _ in range(count)]
    for first, second in edges.tolist():
        beside[first].append(second)
        beside[second].append(first)
    triples = [(i, *others[:2]) for i, others in enumerate(beside) if len(others) > 1]
    return np.array(triples, np.int64).reshape(-1, 3)


def _between(given: _Poses, edges: Int64) -> _Poses:
    """In the middle and at the quarters between two neighbours, and in the middle of three."""
    parts = [_mixed(given, edges, weights) for weights in ((0.5, 0.5), (0.75, 0.25), (0.25, 0.75))]
    triples = _triples(edges, len(given.positions))
    forward = given.rotations[:, 2]
    is_similar = (forward[triples[:, 1]] * forward[triples[:, 2]]).sum(axis=1) >= _SIMILAR
    return _joined([*parts, _mixed(given, triples[is_similar], (1 / 3, 1 / 3, 1 / 3))])


def _outside(given: _Poses, edges: Int64, reach: float) -> _Poses:
    """Each camera moved by `reach` in those of its directions in which it has no neighbour."""
    beside = np.concatenate([edges, edges[:, ::-1]])
    lengths = np.linalg.norm(_DIRECTIONS, axis=1)
    parts = []
    for index, rotation in enumerate(given.rotations):
        directions = _DIRECTIONS / lengths[:, None] @ rotation
        away = given.positions[beside[beside[:, 0] == index, 1]] - given.positions[index]
        away = away[np.linalg.norm(away, axis=1) > 0]
        away /= np.linalg.norm(away, axis=1, keepdims=True)
        is_outward = (directions @ away.T < _OUTWARD).all(axis=1)
        moved = given.positions[index] + reach * directions[is_outward]
        parts.append(given.take(np.full(len(moved), index)))
        parts[-1] = _Poses(moved, parts[-1].rotations, parts[-1].sources)
    return _joined(parts)


def _in_turns(kinds: list[Float64], count: int, same: float) -> list[tuple[int, int]]:
    """Kinds and indices of `count` points of the kinds (n, d), the first that of kind 0 in its middle.

    Each is the farthest from those before of the kind whose turn it is; kinds that have no more are left out.
    """
    chosen = [(0, 0)]
    left = [_distances(points, kinds[0][0]) for points in kinds]
    turn = 0
    while len(chosen) < count:
        turns = [_TURNS[(turn + step) % len(_TURNS)] for step in range(1, len(_TURNS) + 1)]
        step = next((s for s, kind in enumerate(turns, 1) if left[kind].max(initial=0.0) > same), None)
        if step is None:
            break
        turn += step
        kind = _TURNS[turn % len(_TURNS)]
        chosen.append((kind, int(left[kind].argmax())))
        point = kinds[kind][chosen[-1][1]]
        left = [np.minimum(d, _distances(p, point)) for d, p in zip(left, kinds, strict=True)]
    return chosen


def _reach(given: _Poses, margin: float, scene_size: float, same: float) -> float:
    """How far outside viewers stand, in scene units."""
    spread = given.positions[_farthest(given.positions, _SPREAD_OUT, same)]
    if len(spread) < 2:
        return margin * scene_size * _SCENE_SHARE
    apart = np.linalg.norm(spread[:, None] - spread[None], axis=2)
    np.fill_diagonal(apart, np.inf)
    spacing = float(np.median(apart.min(axis=1)))
    return margin * (min(spacing, scene_size) if scene_size else spacing)


def _checked(name: str, value: float) -> float:
    number = real(name, value)
    if not 0 <= number < math.inf:
        raise refusal(name, value, "a finite number, 0 or more")
    return number


def reach_of(views: Views, *, margin: float = DEFAULT_MARGIN, scene_size: float) -> float:
    """How far outside the given cameras the region goes, in scene units; arguments of `positions_between`."""
    given, _ = _given(views.cameras)
    size = _checked("scene_size", scene_size)
    same = _SAME * _radius(given.positions, size)
    return _reach(given, _checked("margin", margin), size, same)


def positions_between(
    views: Views, count: int = DEFAULT_COUNT, *, margin: float = DEFAULT_MARGIN, scene_size: float
) -> list[ViewCamera]:
    """At most `count` cameras that cover where viewers stand; the first k of them are a good choice of k.

    Two fifths are given cameras, as far from each other as can be, two fifths stand between neighbours, and
    one fifth `margin` outside: a share of the distance between eight cameras that are spread over the rig,
    at most that share of `scene_size`, the scene's diameter in scene units, and of an eighth of it where all
    cameras are in one place. There are fewer than `count` where a rig has no more. The same input gives the
    same cameras, in the same order. InputError for arguments out of range.
    """
    count = whole("count", count)
    if count < 1:
        raise refusal("count", count, "1 or more")
    size, share = _checked("scene_size", scene_size), _checked("margin", margin)
    given, middle = _given(views.cameras)
    radius = _radius(given.positions, size)
    same = _SAME * radius
    reach = _reach(given, share, size, same)
    given = given.take(_farthest(given.features(radius), max(count, _MOST_GIVEN), same))
    edges = _edges(given, radius)
    kinds = [given, _between(given, edges), _outside(given, edges, reach)]
    chosen = _in_turns([kind.features(radius) for kind in kinds], count, same)
    poses = [(kinds[kind].take(np.array([index]))) for kind, index in chosen]
    return [
        views.cameras[int(pose.sources[0])].moved_to(pose.positions[0] + middle, pose.rotations[0])
        for pose in poses
    ]

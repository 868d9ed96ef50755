"""Cameras of the region in which viewers stand: given ones, between neighbours, and a little outside."""

from __future__ import annotations

import math

import numpy as np

from dfcgs_codec.arguments import real, refusal, whole
from dfcgs_codec.array_types import Float64, Int64
from dfcgs_codec.views.camera import ViewCamera, Views
from dfcgs_codec.views.neighbours import SAME, Poses, between, distances, edges_of, outside

DEFAULT_COUNT = 24
DEFAULT_MARGIN = 0.15
#: given cameras that are looked at, the farthest from each other
_MOST_GIVEN = 256
#: so many cameras, the farthest from each other, say how large a rig is: the margin is a share of the
#: distance between them, about the spacing of a sparse rig, and the same for a dense one of its size
_SPREAD_OUT = 8
#: where no rig says how far viewers move: a share of the scene
_SCENE_SHARE = 1 / 8
#: from which kind the next camera is taken: given, between, outside
_TURNS = (0, 1, 2, 0, 1)


def _given(cameras: tuple[ViewCamera, ...]) -> tuple[Poses, Float64]:
    """The cameras about the middle of their positions, and that (3,)."""
    positions = np.array([camera.position for camera in cameras])
    middle = (positions.min(axis=0) + positions.max(axis=0)) / 2
    rotations = np.array([camera.rotation for camera in cameras])
    return Poses(positions - middle, rotations, np.arange(len(cameras))), middle


def _radius(positions: Float64, scene_size: float) -> float:
    radius = float(np.linalg.norm(positions, axis=1).max())
    return radius if radius > SAME * scene_size else scene_size or 1.0


def _farthest(features: Float64, count: int, same: float) -> Int64:
    """`count` of the points (n, d): that nearest to the mean, then always the farthest from those before.

    Fewer where others are no further than `same` from them.
    """
    order = [int(distances(features, features.mean(axis=0)).argmin())]
    left = distances(features, features[order[0]])
    while len(order) < count and left.max() > same:
        order.append(int(left.argmax()))
        left = np.minimum(left, distances(features, features[order[-1]]))
    return np.array(order)


def _in_turns(kinds: list[Float64], count: int, same: float) -> list[tuple[int, int]]:
    """Kinds and indices of `count` points of the kinds (n, d), the first that of kind 0 in its middle.

    Each is the farthest from those before of the kind whose turn it is; kinds that have no more are left out.
    """
    chosen = [(0, 0)]
    left = [distances(points, kinds[0][0]) for points in kinds]
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
        left = [np.minimum(d, distances(p, point)) for d, p in zip(left, kinds, strict=True)]
    return chosen


def _reach(given: Poses, margin: float, scene_size: float, same: float) -> float:
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
    same = SAME * _radius(given.positions, size)
    return _reach(given, _checked("margin", margin), size, same)


def _camera(views: Views, pose: Poses, middle: Float64, is_given: bool) -> ViewCamera:
    """The camera of a pose about `middle` (3,): a given one as it is."""
    source = views.cameras[int(pose.sources[0])]
    return source if is_given else source.moved_to(pose.positions[0] + middle, pose.rotations[0])


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
    same = SAME * radius
    reach = _reach(given, share, size, same)
    given = given.take(_farthest(given.features(radius), max(count, _MOST_GIVEN), same))
    edges = edges_of(given, radius)
    kinds = [given, between(given, edges), outside(given, edges, reach)]
    chosen = _in_turns([kind.features(radius) for kind in kinds], count, same)
    return [_camera(views, kinds[kind].take(np.array([index])), middle, kind == 0) for kind, index in chosen]

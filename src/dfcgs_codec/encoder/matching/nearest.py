"""Nearest neighbours among features, in time that crowds of equal points cannot make quadratic."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from dfcgs_codec.array_types import Bool, Float64, Int64, UInt64

Pairs = tuple[Int64, Int64]

#: most rows in a sample, and in the one that says whether and how far to search
_SAMPLE, _PILOT = 4096, 512
#: points of one cell that are told apart at most
_CROWD = 8
#: sizes of such cells, in units of the features: for a sample, and for all, whose units are more certain
_SAMPLE_CELL, _CELL = 0.1, 1.0
#: cells farther out than this are not told apart
_FARTHEST = 1 << 52
#: ratio test: the nearest is certain if its distance is at most this share of that of the next
_RATIO = 0.6
#: share of a pilot that must pass; by chance, 0.6 to the power of the dimension does
_PASSING_SHARE = 0.3
#: odd 64-bit weights, one for each column
WEIGHTS = np.random.default_rng(1).integers(0, 1 << 64, 60, dtype=np.uint64) | np.uint64(1)


def sample(count: int, size: int = _SAMPLE) -> Int64:
    """Evenly spread rows."""
    return np.arange(0, count, max(1, -(-count // size)))


def runs(ordered: UInt64) -> Pairs:
    """Starts and lengths of the runs of equal values."""
    starts = np.flatnonzero(np.append(True, ordered[1:] != ordered[:-1])[: len(ordered)])
    return starts, np.diff(starts, append=len(ordered))


def ranks(keys: UInt64) -> Int64:
    """(N,) 0 for the first holder of a key, 1 for the second, ..."""
    order = np.argsort(keys, kind="stable")
    starts, lengths = runs(keys[order])
    numbers = np.empty(len(keys), np.int64)
    numbers[order] = np.arange(len(keys)) - np.repeat(starts, lengths)
    return numbers


def tree(points: Float64, cell: float) -> tuple[cKDTree, Int64]:
    """A k-d tree of some rows of `points` (N, C), and these rows: all but those in crowded cells.

    A search would have to try all members of a crowd, one by one.
    """
    cells = np.clip(np.floor(points / cell), -_FARTHEST, _FARTHEST).astype(np.int64).view(np.uint64)
    keys = np.einsum("nc,c->n", cells, WEIGHTS[: points.shape[1]])
    rows = np.arange(len(points))
    # that there is no crowd is seen without sorting
    if np.bincount((keys >> np.uint64(44)).view(np.int64)).max() > _CROWD:
        rows = np.flatnonzero(ranks(keys) < _CROWD)
    return cKDTree(points[rows], balanced_tree=False), rows


def mutual(old: Float64, new: Float64, reach: float) -> tuple[Int64, Int64, Float64]:
    """Rows of features (N, C) that are each other's nearest, and their distances up to `reach`."""
    (old_tree, old_rows), (new_tree, new_rows) = tree(old, _CELL), tree(new, _CELL)
    distance, first = old_tree.query(new_tree.data, distance_upper_bound=reach)
    second = np.flatnonzero(np.isfinite(distance))
    asked, which = np.unique(first[second], return_inverse=True)
    second = second[new_tree.query(old_tree.data[asked])[1][which] == second]
    return old_rows[first[second]], new_rows[second], distance[second]


def next_nearest(points: Float64, rows: Int64) -> Float64:
    """Distances of some `rows` of features from their nearest other."""
    distance: Float64 = tree(points, _CELL)[0].query(points[rows], k=[2])[0][:, 0]
    return distance


def passing(nearest: Float64, following: Float64 | float) -> Bool:
    """Which pass the ratio test, by the distances of the nearest and of the next."""
    return nearest <= _RATIO * following


def _pilot(old_tree: cKDTree, new: Float64) -> tuple[float, float]:
    """Share of a few of `new` that pass the ratio test, each with its own partner; a bound for searches."""
    some = sample(len(new), _PILOT)
    distance, first = old_tree.query(new[some], k=2)
    certain = passing(distance[:, 0], distance[:, 1])
    bound = 1.5 * np.quantile(distance[certain, 0], 0.9) / _RATIO if certain.any() else 0.0
    return len(np.unique(first[certain, 0])) / len(some), float(bound)


def certain_pairs(olds: list[Float64], new: Float64) -> Pairs:
    """Mutual neighbours of a sample of features that pass the ratio test; none if these would be few.

    Of several versions of the old features, that which gives most is used.
    """
    old_trees = [tree(old, _SAMPLE_CELL) for old in olds]
    new_tree, new_rows = tree(new, _SAMPLE_CELL)
    pilots = [_pilot(old_tree, new_tree.data) for old_tree, _ in old_trees]
    best = int(np.argmax([share for share, _ in pilots]))
    (old_tree, old_rows), (share, bound) = old_trees[best], pilots[best]
    if share < _PASSING_SHARE:
        return old_rows[:0], new_rows[:0]
    some = sample(len(new_rows))
    distance, first = old_tree.query(new_tree.data[some], k=2, distance_upper_bound=bound)
    certain = passing(distance[:, 0], np.minimum(distance[:, 1], bound))
    some, first = some[certain], first[certain, 0]
    back = new_tree.query(old_tree.data[first])[1]
    return old_rows[first[back == some]], new_rows[some[back == some]]

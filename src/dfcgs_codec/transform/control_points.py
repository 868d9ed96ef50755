"""Which Gaussians of a GoF are control points, and who follows them (spec sections 14.1, 14.2).

Control points come coarse to fine.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dfcgs_codec.array_types import Int64
from dfcgs_codec.bitstream.constants import MAX_CONTROL_POINTS
from dfcgs_codec.core import procedures

#: cells lie within +- this
CELL_LIMIT = 1 << 20
#: control points that a Gaussian gathers from
NUM_GATHERED = 4
GATHER_WEIGHT_BITS = 12
#: Gaussians of a bucket of the farthest point search; in Morton order they are close together
_BUCKET = 256
#: so many of them are looked at together: what is computed then stays in the processor's cache
_BUCKETS_AT_ONCE = 64
_RADIUS_BITS = 10
#: neighbours asked for beyond those needed, so that ties can be put in order
_SPARE = 4
#: distances computed at once where many neighbours tie
_MAX_DISTANCES = 4_000_000


def control_cells(positions: Int64, center: Int64, shift: int) -> Int64:
    """Cells (N, 3) that control points are chosen on: `positions` about `center`, clipped."""
    cells: Int64 = np.clip((positions - center) >> shift, -CELL_LIMIT, CELL_LIMIT)
    return cells


def _outside(low: Int64, high: Int64, point: list[int]) -> Int64:
    """Squared distance (buckets,) of `point` to the boxes between `low` and `high`, (3, buckets) each."""
    total = np.zeros(low.shape[1], np.int64)
    for axis in range(3):
        apart = np.maximum(low[axis] - point[axis], point[axis] - high[axis])
        np.maximum(apart, 0, out=apart)
        apart *= apart
        total += apart
    return total


def _buckets(cells: Int64) -> Int64:
    """Cells (N, 3) as columns (3, buckets, 256), the last one repeated to fill the last bucket."""
    spare = -len(cells) % _BUCKET
    # column by column: numpy's sums over a short last axis are slow
    columns = np.pad(cells.T, ((0, 0), (0, spare)), mode="edge")
    return np.ascontiguousarray(columns).reshape(3, -1, _BUCKET)


def farthest_points(cells: Int64, count: int) -> Int64:
    """Exact farthest point sampling of `cells` (N, 3): at most `count` indices, coarse to fine.

    Begins with Gaussian 0; each next one is the farthest from all before it, the first of equals. Ends early
    when every Gaussian coincides with a chosen one.
    """
    if procedures.is_worth(len(cells)):
        return procedures.farthest_points(cells, count)
    return _farthest_points(cells, count)


def _farthest_points(cells: Int64, count: int) -> Int64:
    buckets = _buckets(cells)
    low, high = buckets.min(axis=2), buckets.max(axis=2)
    farthest = np.full(low.shape[1], np.iinfo(np.int64).max)
    distance = np.full(buckets.shape[1:], np.iinfo(np.int64).max)
    chosen = [0]
    while len(chosen) < count:
        point = cells[chosen[-1]].tolist()
        # a bucket whose box is farther away than its farthest Gaussian is from the set cannot change
        near = np.flatnonzero(_outside(low, high, point) < farthest)
        for start in range(0, len(near), _BUCKETS_AT_ONCE):
            some = near[start : start + _BUCKETS_AT_ONCE]
            closer = np.minimum(distance[some], _squared_to(buckets[:, some], point))
            distance[some] = closer
            farthest[some] = closer.max(axis=1)
        best = int(farthest.argmax())
        if farthest[best] == 0:
            break
        # in a bucket that was filled up the first of equals is one that is there
        chosen.append(best * _BUCKET + int(distance[best].argmax()))
    return np.array(chosen, np.int64)


def _squared_to(columns: Int64, point: list[int]) -> Int64:
    """Squared distances (...) of `columns` (3, ...) to `point`; works in place."""
    for axis in range(3):
        columns[axis] -= point[axis]
    columns *= columns
    columns[0] += columns[1]
    columns[0] += columns[2]
    squared: Int64 = columns[0]
    return squared


def _squared(cells: Int64, control: Int64, ranks: Int64) -> Int64:
    """Squared distances (rows, k) of cells (rows, 3) to the control cells of `ranks` (rows, k)."""
    total = np.zeros(ranks.shape, np.int64)
    for axis in range(3):
        difference = control[:, axis][ranks] - cells[:, axis, None]
        total += difference * difference
    return total


def _sorted(ranks: Int64, squared: Int64) -> tuple[Int64, Int64]:
    order = np.lexsort((ranks, squared), axis=1)
    return np.take_along_axis(ranks, order, 1), np.take_along_axis(squared, order, 1)


def _search_all(cells: Int64, control: Int64, count: int) -> Int64:
    """Ranks of the nearest by looking at all."""
    distinct, inverse = np.unique(cells, axis=0, return_inverse=True)
    found = np.empty((len(distinct), count), np.int64)
    step = max(1, _MAX_DISTANCES // len(control))
    everyone = np.arange(len(control))
    for start in range(0, len(distinct), step):
        rows = slice(start, start + step)
        squared = np.zeros((len(distinct[rows]), len(control)), np.int64)
        for axis in range(3):
            squared += (distinct[rows, axis, None] - control[:, axis]) ** 2
        # one number for distance and rank: cells are below 2**20, ranks below 2**14
        squared <<= MAX_CONTROL_POINTS.bit_length()
        squared |= everyone
        squared.partition(count - 1, axis=1)
        nearest_ones = np.sort(squared[:, :count], axis=1)
        found[rows] = nearest_ones & ((1 << MAX_CONTROL_POINTS.bit_length()) - 1)
    return found[inverse.reshape(-1)]


def nearest(cells: Int64, control: Int64, count: int) -> tuple[Int64, Int64]:
    """Ranks and squared distances (N, count) of the nearest of `control` (n, 3), n >= count; ties by rank."""
    # files without motion do without it
    from scipy.spatial import cKDTree

    asked = min(len(control), count + 1)
    tree = cKDTree(control.astype(np.float64))
    ranks = tree.query(cells.astype(np.float64), asked)[1].reshape(len(cells), asked).astype(np.int64)
    squared = _squared(cells, control, ranks)
    # the tree's distances are exact, but its order among equals is not defined
    ties = np.flatnonzero((squared[:, 1:] <= squared[:, :-1]).any(axis=1))
    if len(ties):
        more = min(len(control), count + _SPARE)
        wider = tree.query(cells[ties].astype(np.float64), more)[1].reshape(len(ties), more)
        put, distances = _sorted(wider.astype(np.int64), _squared(cells[ties], control, wider))
        open_end = np.flatnonzero(distances[:, count - 1] == distances[:, -1])
        if len(open_end) and more < len(control):
            put[open_end, :count] = _search_all(cells[ties[open_end]], control, count)
        ranks[ties, :count] = put[:, :count]
        squared[ties, :count] = _squared(cells[ties], control, put[:, :count])
    return ranks[:, :count], squared[:, :count]


@dataclass(frozen=True)
class Gathering:
    """For each point its nearest control points, and weights that sum to 2**12; both int64 (4, N).

    Where there are fewer than four control points, the nearest is repeated with weight 0.
    """

    ranks: Int64
    weights: Int64

    def of(self, rows: Int64) -> Gathering:
        """The same of some points."""
        return Gathering(self.ranks[:, rows], self.weights[:, rows])


def gather_from(cells: Int64, control: Int64) -> Gathering:
    """Who follows whom: weights (1 - d / edge)**2, where the edge is the distance of the fifth nearest."""
    if procedures.is_worth(len(cells)):
        return Gathering(*procedures.gather(cells, control))
    return _gather_from(cells, control)


def _gather_from(cells: Int64, control: Int64) -> Gathering:
    count = min(NUM_GATHERED, len(control))
    asked = min(NUM_GATHERED + 1, len(control))
    ranks, squared = nearest(cells, control, asked)
    # exact: the square root of an integer below 2**53 is correctly rounded
    distance = np.sqrt(squared.astype(np.float64)).astype(np.int64)
    edge = np.maximum(distance[:, -1] if asked > count else 2 * distance[:, -1], 1)
    reach = (1 << _RADIUS_BITS) - (distance[:, :count] << _RADIUS_BITS) // edge[:, None]
    squares = (reach * reach).T
    total = squares.sum(axis=0)
    weights = np.zeros((NUM_GATHERED, len(cells)), np.int64)
    weights[:count] = (squares << GATHER_WEIGHT_BITS) // np.maximum(total, 1)
    weights[0] += (1 << GATHER_WEIGHT_BITS) - weights.sum(axis=0)
    followed = np.repeat(ranks[:, :1], NUM_GATHERED, axis=1)
    followed[:, :count] = ranks[:, :count]
    return Gathering(np.ascontiguousarray(followed.T), weights)

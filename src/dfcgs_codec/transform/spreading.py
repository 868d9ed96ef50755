"""Over which Gaussians the motion of a control point is spread, as the paper does it (spec annex B.7)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from dfcgs_codec.array_types import Int64

#: distances are in 1/16 of a cell
DISTANCE_FRACTION_BITS = 4
#: the weights of a control point sum to 2**16
SPREAD_WEIGHT_BITS = 16
#: distances in the exponent are in 2**-12, what they leave in 2**-24
DECAY_ARGUMENT_BITS = 12
DECAY_FRACTION_BITS = 24
#: round(2**24 * exp(-2**(i - 12))): what bit i of a distance leaves; part of the format
DECAY = (
    16773120,
    16769026,
    16760840,
    16744480,
    16711808,
    16646655,
    16517109,
    16261035,
    15760736,
    14805841,
    13066109,
    10175896,
    6171993,
    2270549,
    307285,
    5628,
)
#: candidates looked at together
_MAX_CANDIDATES = 1 << 21


def decayed(distance: Int64) -> Int64:
    """2**24 * exp(-distance), of distances >= 0 in 2**-12; nothing is left from 16 on."""
    result = np.where(distance >> len(DECAY), 0, 1 << DECAY_FRACTION_BITS).astype(np.int64)
    for bit, factor in enumerate(DECAY):
        less = (result * factor + (1 << (DECAY_FRACTION_BITS - 1))) >> DECAY_FRACTION_BITS
        result = np.where(distance >> bit & 1, less, result)
    return result


@dataclass(frozen=True)
class Spreading:
    """For each of n control points its K nearest Gaussians, the nearest first, and weights that sum to 2**16.

    Both int64 (n, K).
    """

    gaussians: Int64
    weights: Int64

    def received(self, motions: Int64, count: int) -> Int64:
        """What `count` Gaussians receive (count, C) of the control points' `motions` (n, C), rounded."""
        shares = self.weights[:, :, None] * motions[:, None, :]
        total = np.zeros((count, motions.shape[1]), np.int64)
        np.add.at(total, self.gaussians, shares)
        return (total + (1 << (SPREAD_WEIGHT_BITS - 1))) >> SPREAD_WEIGHT_BITS


def spread_from(cells: Int64, points: Int64, num_neighbours: int, decay_exponent: int) -> Spreading:
    """Shares of the Gaussians nearest to control points `points` (n,): exp(-d) over its sum.

    `cells` (N, 3) are those of Gaussians; d is in units of which a cell is 2**decay_exponent wide. The
    distance of the nearest is taken off all, which changes no share and lets none vanish.
    """
    gaussians, squared = _neighbours(cells, cells[points], min(num_neighbours, len(cells)))
    # exact: the square root of an integer below 2**53 is correctly rounded
    distance = np.sqrt((squared << 2 * DISTANCE_FRACTION_BITS).astype(np.float64)).astype(np.int64)
    beyond = distance - distance[:, :1]
    shift = decay_exponent + DECAY_ARGUMENT_BITS - DISTANCE_FRACTION_BITS
    left = decayed(beyond << shift if shift >= 0 else beyond >> -shift)
    weights = (left << SPREAD_WEIGHT_BITS) // left.sum(axis=1)[:, None]
    weights[:, 0] += (1 << SPREAD_WEIGHT_BITS) - weights.sum(axis=1)
    return Spreading(gaussians, weights)


def _neighbours(cells: Int64, control: Int64, count: int) -> tuple[Int64, Int64]:
    """The `count` nearest of `cells` (N, 3) to each of `control` (n, 3), ties by index; squared distances."""
    # files without motion do without it
    from scipy.spatial import cKDTree

    # cells that many Gaussians share would make the search slow
    order = np.lexsort(cells.T)
    begins = np.flatnonzero(np.append(True, np.diff(cells[order], axis=0).any(axis=1)))
    sizes = np.minimum(np.diff(np.append(begins, len(cells))), count)
    distinct = cells[order[begins]]
    tree = cKDTree(distinct.astype(np.float64))
    centers = control.astype(np.float64)
    asked = min(count, len(distinct))
    last = tree.query(centers, asked)[1].reshape(len(control), asked)[:, -1]
    reach = ((distinct[last] - control) ** 2).sum(axis=1)
    # squares are integers, so that half of one more excludes none of the equals and lets none further in;
    # where a great many are equally far, not all are looked at together
    radius = np.sqrt(reach + 0.5)
    total = np.cumsum(tree.query_ball_point(centers, radius, return_length=True) * int(sizes.max()))
    parts = []
    start = 0
    while start < len(control):
        before = total[start - 1] if start else 0
        stop = max(start + 1, int(np.searchsorted(total, before + _MAX_CANDIDATES, side="right")))
        found = tree.query_ball_point(centers[start:stop], radius[start:stop])
        parts.append(_nearest_found(found, (order, begins, sizes), (cells, control[start:stop], count)))
        start = stop
    gaussians, squared = zip(*parts, strict=True)
    return np.concatenate(gaussians), np.concatenate(squared)


def _nearest_found(
    found: npt.NDArray[np.object_],
    distinct: tuple[Int64, Int64, Int64],
    search: tuple[Int64, Int64, int],
) -> tuple[Int64, Int64]:
    """The nearest of what was found about some control points: lists of distinct cells."""
    places = np.concatenate([np.asarray(some, np.int64) for some in found])
    ranks = np.repeat(np.arange(len(found)), [len(some) for some in found])
    order, begins, sizes = distinct
    members = _members(order, begins, sizes, places)
    return _nearest_of(members, np.repeat(ranks, sizes[places]), search)


def _members(order: Int64, begins: Int64, sizes: Int64, places: Int64) -> Int64:
    """Gaussians of the distinct cells `places`, as many of each as its size says, by rising index."""
    repeated = np.repeat(places, sizes[places])
    ends = np.cumsum(sizes[places])
    within = np.arange(len(repeated)) - np.repeat(ends - sizes[places], sizes[places])
    members: Int64 = order[begins[repeated] + within]
    return members


def _nearest_of(candidates: Int64, ranks: Int64, search: tuple[Int64, Int64, int]) -> tuple[Int64, Int64]:
    """The nearest of `candidates`, each of which is one of the control point `ranks`, in rising order."""
    cells, control, count = search
    squared = ((cells[candidates] - control[ranks]) ** 2).sum(axis=1)
    by_distance = np.lexsort((candidates, squared, ranks))
    starts = np.searchsorted(ranks, np.arange(len(control)))
    chosen: Int64 = by_distance[starts[:, None] + np.arange(count)]
    return candidates[chosen], squared[chosen]

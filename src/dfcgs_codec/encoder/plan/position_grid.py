"""The grid of positions: as fine as the step wants, around the scene wherever that is."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from dfcgs_codec.array_types import AnyArray, Bool, Float64, Floats
from dfcgs_codec.bitstream.constants import MAX_ORIGIN
from dfcgs_codec.errors import InputError

#: log2 of the grid units to a step, so that the grid's own rounding hardly counts
UNITS_PER_STEP_LOG2 = 6
#: what room to grow must leave of them
_FEWEST_UNITS_LOG2 = 5
#: and what a scene that reaches far leaves of them; beyond, Gaussians are escapes as long as these are few
_FEWEST_UNITS_FAR_LOG2 = 3
FINEST_EXPONENT = -60
_COARSEST_EXPONENT = 40
#: log2 of the units that a grid reaches, half its range, so that motion does not leave it at once
_REACH_LOG2 = 28
#: later frames may reach 16 times as far as the first
_ROOM_TO_GROW_LOG2 = 4
_MAX_REACH_LOG2 = 80
#: log2 of the units that a scene spans at least
_SMALLEST_LOG2 = 10
#: Gaussians that lie apart from all others, at most, and how many times as far from the middle
_FAR_ONES, _TIMES_AS_FAR = 2, 4.0
#: Gaussians that most scenes are told by to have none
_SAMPLE = 1024
#: Gaussians that may be escapes where all others have the units that suit them
_VERY_FEW = 2
#: and where else units were coarser: some, and one in so many; never more than a tenth
_FEW, _ONE_IN, _TENTH = 8, 1000, 10


@dataclass(frozen=True)
class PositionGrid:
    """log2 of the unit, the origin in units, and what is to be said of it."""

    exponent: int
    origin: tuple[int, int, int] = (0, 0, 0)
    notes: tuple[str, ...] = ()


def _reach(distances: Float64, few: int) -> float:
    """The largest of `distances` (N,) but for a `few`."""
    last = len(distances) - 1 - min(few, len(distances) // _TENTH)
    return float(np.partition(distances, last)[last])


def _none_is_far(some: AnyArray, positions: AnyArray) -> bool:
    """Whether a sample tells already: what is large in it is as large in all."""
    middle = np.median(some, axis=0)
    reach = _reach(np.abs(some - middle).max(axis=1), _FAR_ONES)
    low, high = positions.min(axis=0), positions.max(axis=0)
    return bool(np.maximum(high - middle, middle - low).max() <= _TIMES_AS_FAR * reach)


def far_ones(positions: AnyArray) -> Bool:
    """Which of `positions` (N, 3) lie apart from all others: one or two that are several times as far out."""
    count = len(positions)
    if count <= _TENTH or _none_is_far(positions[:: max(1, count // _SAMPLE)], positions):
        return np.zeros(count, np.bool_)
    distances = np.abs(positions - np.median(positions, axis=0)).max(axis=1)
    reach = _reach(distances, _FAR_ONES)
    # where all others are at one point, nothing is several times as far out
    far: Bool = distances > (_TIMES_AS_FAR * reach if reach else np.inf)
    return far


def plan_position_grid(positions: Floats, step: float) -> PositionGrid:
    """A grid for finite `positions` (N, 3), N > 0, that holds them but for a few, with units below `step`.

    It begins at the scene's own zero, or in the middle of the scene where that is far away. InputError for
    scenes beyond what exponents can say.
    """
    wide = positions.astype(np.float64)
    largest = float(np.abs(wide).max())
    if 0.0 < largest < 2.0 ** (FINEST_EXPONENT + _SMALLEST_LOG2):
        raise InputError(
            f"positions reach {largest:g} scene units at most, and the finest unit is 2**{FINEST_EXPONENT}: "
            "multiply positions, and add the logarithm of the factor to log-scales, before the export"
        )
    centre = np.median(wide, axis=0)
    from_zero, from_centre = (np.abs(wide - point).max(axis=1) for point in (np.zeros(3), centre))
    fits = math.floor(math.log2(step)) - _FEWEST_UNITS_LOG2 + _REACH_LOG2
    reach = _reach(from_zero, _VERY_FEW)
    if reach <= 2.0 ** min(fits, _MAX_REACH_LOG2):
        return PositionGrid(_exponent(step, reach))
    few = _FEW + len(wide) // _ONE_IN
    for bits in (_FEWEST_UNITS_LOG2, _FEWEST_UNITS_FAR_LOG2):
        exponent = max(FINEST_EXPONENT, min(_COARSEST_EXPONENT, math.floor(math.log2(step)) - bits))
        for origin, distances in ((np.zeros(3), from_zero), (centre, from_centre)):
            reach = _reach(distances, few)
            if reach <= 2.0 ** (exponent + _REACH_LOG2):
                return _around(origin, max(exponent, _exponent(step, reach)))
    if _reach(from_centre, few) < _reach(from_zero, few):
        return _coarse(centre, _reach(from_centre, few), step)
    return _coarse(np.zeros(3), _reach(from_zero, few), step)


def _suited(step: float) -> int:
    return max(FINEST_EXPONENT, min(_COARSEST_EXPONENT, math.floor(math.log2(step)) - UNITS_PER_STEP_LOG2))


def _holding(reach: float) -> int:
    return math.ceil(math.log2(max(reach, 2.0**FINEST_EXPONENT))) - _REACH_LOG2


def _exponent(step: float, reach: float) -> int:
    """Many units to a step, as far as the grid still holds `reach`, and if it can some times more."""
    # room to grow is never bought with precision
    roomy = min(_holding(reach) + _ROOM_TO_GROW_LOG2, math.floor(math.log2(step)) - _FEWEST_UNITS_LOG2)
    return max(_holding(reach), min(roomy, _COARSEST_EXPONENT), _suited(step))


def _around(centre: Float64, exponent: int) -> PositionGrid:
    """The origin is whole in scene units: values that another tool has quantised stay on their lattices."""
    largest = float(np.abs(centre).max())
    if largest:
        exponent = max(exponent, math.ceil(math.log2(largest)) - MAX_ORIGIN.bit_length() + 1)
    x, y, z = (round(round(value) / 2.0**exponent) for value in centre.tolist())
    return PositionGrid(exponent, (x, y, z))


def _coarse(centre: Float64, reach: float, step: float) -> PositionGrid:
    if not max(reach, float(np.abs(centre).max())) < 2.0**_MAX_REACH_LOG2:
        raise InputError(
            f"positions reach {reach:g} scene units; scenes up to 2**{_MAX_REACH_LOG2} can be coded"
        )
    grid = _around(centre, _holding(reach))
    note = (
        f"the scene reaches {reach:g} units and its Gaussians are so small that positions want steps of "
        f"{step:g}: these grow to {2.0**grid.exponent:g} for all; a crop to what is looked at keeps it sharp"
    )
    return PositionGrid(grid.exponent, grid.origin, (note,) if 2.0**grid.exponent > step else ())

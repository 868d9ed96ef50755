"""Sections 9.3 to 9.7: what symbols are worth."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

from tests.spec_decoder.basics import (
    CONSTANTS,
    OPACITY,
    POSITION,
    ROTATION,
    SCALE,
    STATE_LIMIT,
    clip,
    in_range,
    require,
    round_shift,
    sign,
)
from tests.spec_decoder.state import State, expand, from_stereo, multiply, normalise

if TYPE_CHECKING:
    from tests.spec_decoder.basics import Matrix, Row
    from tests.spec_decoder.inter import Activity
    from tests.spec_decoder.intra import IntraHeader


def scaled(symbols: Matrix, step: int) -> Matrix:
    """9.3: symbols of all attributes keep a limit, ROTATION included."""
    require(all(abs(value) <= 2 * STATE_LIMIT // step for row in symbols for value in row))
    return [[value * step for value in row] for row in symbols]


OCTAVES_PER_LOG = 23637

ALPHA_WEIGHTS: Row = CONSTANTS["9.5"]["ALPHA_WEIGHTS"]

ROUNDNESS_WEIGHTS: Row = CONSTANTS["9.5"]["ROUNDNESS_WEIGHTS"]

MULTIPLIERS: Row = CONSTANTS["9.5"]["MULTIPLIERS"]

COVER_WEIGHT, MAX_COARSENESS = 16, 16


def octaves_of(s: Row, exponents: dict[int, int]) -> Row:
    """Of each axis, in sixteenths."""
    shift = clip(10 - exponents[SCALE], 0, 63)
    return [(OCTAVES_PER_LOG * c) >> shift for c in s]


def alpha_weight(o: int, exponents: dict[int, int]) -> int:
    quarter = expand(o, exponents[OPACITY]) >> (-2 - exponents[OPACITY])
    return ALPHA_WEIGHTS[clip(quarter + 32, 0, 63)]


def roundness(r: int) -> int:
    return ROUNDNESS_WEIGHTS[max(r, 0) >> 2] if max(r, 0) >> 2 < 16 else 2 * r


def visibility_weight(attribute: int, s: Row, o: int, exponents: dict[int, int]) -> int:
    """Of a Gaussian, from its SCALE and OPACITY; less what its cover class takes."""
    _, middle, longest = sorted(octaves_of(s, exponents))
    alpha, area = alpha_weight(o, exponents), longest + middle
    if attribute == POSITION:
        return alpha
    if attribute == OPACITY:
        return area
    return alpha + area + (roundness(longest - middle) if attribute == ROTATION else 0)


def coarser(changes: Matrix, multipliers: Row) -> Matrix:
    """Of each Gaussian's changes, with its multiplier."""
    return [
        [round_shift(change * multiplier, 8) for change in row]
        for row, multiplier in zip(changes, multipliers, strict=True)
    ]


@dataclass
class Steps:
    """The steps of a P-frame, and its `visibility_level` of each attribute if it has the tool VISIBILITY."""

    steps: dict[int, int]
    levels: dict[int, int]
    exponents: dict[int, int]
    cover: Row

    def coarseness(self, attribute: int, reference: State) -> Row:
        """9.5: of each Gaussian, in quarter octaves; 0 without the tool."""
        if attribute not in self.levels:
            return [0] * len(reference.positions)
        level, coarseness = self.levels[attribute], []
        for s, (o,), c in zip(reference.planes[SCALE], reference.planes[OPACITY], self.cover, strict=True):
            weight = visibility_weight(attribute, s, o, self.exponents) - COVER_WEIGHT * c
            coarseness.append(clip((level - weight) >> 3, 0, MAX_COARSENESS))
        return coarseness

    def changes(self, attribute: int, symbols: Matrix, reference: State) -> Matrix:
        """9.3 and 9.4: what symbols are worth."""
        changes = scaled(symbols, self.steps[attribute])
        return coarser(changes, [MULTIPLIERS[c] for c in self.coarseness(attribute, reference)])


def reconstruct_inter(activity: dict[int, Activity], steps: Steps, reference: State) -> State:
    """9.3; SCALE and OPACITY of the predicted frame are those of the reference frame (9.5)."""
    if not activity:
        return reference
    planes = dict(reference.planes)
    for attribute, found in activity.items():
        plane, changes = planes[attribute], steps.changes(attribute, found.symbols, reference)
        if attribute == ROTATION:
            planes[attribute] = [
                normalise(multiply(q, from_stereo(change))) if any(r) else q
                for q, r, change in zip(plane, found.symbols, changes, strict=True)
            ]
        else:
            planes[attribute] = in_range(
                [[a + b for a, b in zip(*rows, strict=True)] for rows in zip(plane, changes, strict=True)]
            )
    return State(planes, reference.order)


MAX_COVER, MAX_TURN_WEIGHT, SPIN_WEIGHT, MAX_TURN_STEP = 15, 64, 16, 2**16


class Look(NamedTuple):
    """9.6: what weights of a Gaussian are made from."""

    alpha: int
    area: int
    hidden: int
    is_needle: bool
    long: int
    flat: int

    @property
    def seen(self) -> int:
        return ((self.alpha + self.area) >> 1) - self.hidden


def look_of(s: Row, o: int, c: int, exponents: dict[int, int]) -> Look:
    axis = octaves_of(s, exponents)
    is_needle = axis[0] - axis[1] > axis[1] - axis[2]
    long = roundness(axis[0] - axis[1])
    flat = min(roundness(axis[1] - axis[2] if is_needle else axis[0] - axis[2]), MAX_TURN_WEIGHT)
    area = sum(axis) - min(axis)
    return Look(alpha_weight(o, exponents), area, COVER_WEIGHT * c, is_needle, long, flat)


def step_of(header: IntraHeader, attribute: int, weight: int) -> int:
    multiplier = MULTIPLIERS[clip((header.levels[attribute] - weight) >> 3, 0, MAX_COARSENESS)]
    return round_shift(header.steps[attribute] * multiplier, 8)


def is_alternating(header: IntraHeader, attribute: int) -> bool:
    return bool(header.alternating >> attribute & 1)


THIN_OCTAVE = 11


def expand_thinness(c: int, octaves: int, e: int) -> int:
    """9.7."""
    thin_knots = [i * (THIN_OCTAVE << (-4 - e)) for i in range(octaves + 1)]
    flat_knots = [0]
    for i in range(1, octaves + 1):
        flat_knots.append(flat_knots[i - 1] + (thin_knots[1] >> (i - 1)))
    zone = sum(knot <= abs(c) for knot in flat_knots[1:])
    return sign(c) * (thin_knots[zone] + ((abs(c) - flat_knots[zone]) << zone))


def thin_axis(row: Row, octaves: int, e: int) -> Row:
    """9.7: the scales of a Gaussian from the values of its columns."""
    if not octaves:
        return row
    return [row[0], row[1], row[1] - expand_thinness(row[2], octaves, e)]

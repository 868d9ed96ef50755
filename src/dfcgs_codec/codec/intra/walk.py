"""The walk of a coded I-frame, or of births (spec section 11.4).

Positions come first, as coarse as any of them may be; then cover classes, scales and opacities, whose steps
depend on what is there by then; then the positions' low bits, rotations and colours.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from dfcgs_codec.array_types import Int64
from dfcgs_codec.bitstream.constants import STATE_COLUMNS, STATE_LIMIT, Attribute
from dfcgs_codec.bitstream.frame_headers import IntraSteps, SortGrid
from dfcgs_codec.bitstream.sequence_header import UnitExponents
from dfcgs_codec.codec.columns.coder import SymbolCoder
from dfcgs_codec.codec.columns.column import Column, ColumnGoal, Earlier, code_integers, code_permutation
from dfcgs_codec.codec.intra.positions import code_positions
from dfcgs_codec.codec.intra.steps import IntraWeights, column_steps, position_octaves, turn_steps
from dfcgs_codec.codec.intra.turns import ChooseTurns, TurnWalk
from dfcgs_codec.codec.state.planes import FrameState, Plane
from dfcgs_codec.entropy.symbols import code_bits
from dfcgs_codec.errors import CorruptBitstream
from dfcgs_codec.transform.companding import expand_thinness
from dfcgs_codec.transform.lod import LevelsOfDetail, build_levels

#: largest cover class
MAX_COVER = 15
#: steps of turns count as no larger than this, in stereographic units
MAX_TURN_STEP = 1 << 16
#: the axis that may be companded
THIN_AXIS = 2


class IntraGoal(Protocol):
    """What an encoder wants a frame to be, in canonical order, and how it chooses symbols."""

    @property
    def positions(self) -> Int64:
        """(N, 3), in units of the position step."""

    @property
    def cover(self) -> Int64:
        """Cover classes (N,)."""

    @property
    def permutation(self) -> Int64 | None:
        """Places in the output (N,), where there are any."""

    def column(
        self, attribute: Attribute, column: int, decoded: Mapping[Attribute, Int64], before: list[Int64]
    ) -> ColumnGoal:
        """A column of an attribute; `decoded` planes, and the columns `before` it of its own attribute."""

    def turns(self, walk: TurnWalk) -> ChooseTurns:
        """How symbols of turns are chosen."""

    @property
    def keeps_names(self) -> bool:
        """Whether rotations keep their axes, for they are those of frames before."""

    def beside(self, work: Callable[[], None]) -> Callable[[], None]:
        """Begin with `work`; the result waits for it."""


@dataclass(frozen=True)
class IntraShape:
    """What the headers say that the walk needs."""

    num_gaussians: int
    has_permutation: bool
    sort_grid: SortGrid
    steps: IntraSteps
    units: UnitExponents


@dataclass
class _Walk:
    """A walk under way: where streams come from, what is wanted, what is there."""

    next_coder: Callable[[], SymbolCoder]
    goal: IntraGoal | None
    shape: IntraShape
    lod: LevelsOfDetail
    planes: dict[Attribute, Int64] = field(default_factory=dict)

    def columns(self, attribute: Attribute, weights: IntraWeights, earlier: Earlier) -> None:
        """The stream of an attribute, each column with the help of `earlier` ones and those before it."""
        coder, rule = self.next_coder(), self.shape.steps
        steps = column_steps(rule, attribute, weights)
        found: list[Int64] = []
        for column in range(STATE_COLUMNS[attribute]):
            is_thin = attribute == Attribute.SCALE and column == THIN_AXIS and rule.thin_octaves > 0
            alternating = attribute in rule.alternating
            walk = Column(steps, self.lod, earlier, not alternating, alternating and not is_thin)
            goal = None
            if self.goal is not None:
                goal = self.goal.column(attribute, column, self.planes, found)
            coded = walk.code(coder, goal)
            found.append(self._third_axis(found[-1], coded) if is_thin else coded)
        self.planes[attribute] = np.stack(found, axis=1)

    def _third_axis(self, second: Int64, thinness: Int64) -> Int64:
        """Log-scales (N,) of axis 2, from those of axis 1 and how thin it is beside it (spec section 9.7)."""
        shape = self.shape
        third = second - expand_thinness(thinness, shape.units.scale, shape.steps.thin_octaves)
        return _in_range(third)

    def cover(self) -> Int64:
        """The cover classes (N,)."""
        given = None if self.goal is None else self.goal.cover
        cover = code_integers(self.next_coder(), given, self.lod, self.shape.num_gaussians)
        if cover.min() < 0 or cover.max() > MAX_COVER:
            raise CorruptBitstream("a cover class is out of range")
        return cover

    def positions(self, coarse: Int64, weights: IntraWeights) -> None:
        """The low bits of positions; `coarse` (N, 3) is what is known of them."""
        coder, rule = self.next_coder(), self.shape.steps
        most, step = rule.coarse_log2, rule.steps[Attribute.POSITION]
        octaves = position_octaves(rule, weights)
        indices = coarse.copy()
        for bits in range(1, most + 1):
            rows = np.flatnonzero(octaves == most - bits)
            low = None
            if self.goal is not None:
                shifted = self.goal.positions[rows] >> (most - bits)
                low = (shifted & ((1 << bits) - 1)).ravel()
            found = code_bits(coder, low, bits, 3 * len(rows)).reshape(-1, 3)
            indices[rows] = (coarse[rows] << bits) | found
        _check_indices(indices, step)
        # the middle of the cells of the finest steps that a coarse one spans
        width = np.left_shift(np.int64(1), octaves)[:, None]
        self.planes[Attribute.POSITION] = _in_range(indices * width * step + ((width - 1) * step >> 1))

    def rotations(self, coder: SymbolCoder, weights: IntraWeights) -> None:
        """The rotations, in a stream that is open."""
        rule, goal = self.shape.steps, self.goal
        tilts, spins = (np.minimum(steps, MAX_TURN_STEP) for steps in turn_steps(rule, weights))
        walk = TurnWalk(tilts, spins, weights.is_needle, self.lod, Attribute.ROTATION in rule.alternating)
        choose = None if goal is None else goal.turns(walk)
        keeps_names = goal is not None and goal.keeps_names
        self.planes[Attribute.ROTATION] = walk.code(coder, choose, keeps_names=keeps_names)


def _check_indices(indices: Int64, step: int) -> None:
    if np.abs(indices).max() > 2 * STATE_LIMIT // step:
        raise CorruptBitstream("a symbol is too large for its step")


def _in_range(values: Int64) -> Int64:
    if np.abs(values).max() > STATE_LIMIT:
        raise CorruptBitstream("a reconstructed value leaves the range of the state")
    return values


def _at_once(work: Callable[[], None]) -> Callable[[], None]:
    work()
    return lambda: None


def code_intra(
    next_coder: Callable[[], SymbolCoder], goal: IntraGoal | None, shape: IntraShape
) -> FrameState:
    """All streams; `next_coder` opens each one in turn; `goal`: None when reading; returns the state."""
    count, rule = shape.num_gaussians, shape.steps
    known = None if goal is None else goal.positions >> rule.coarse_log2
    coarse = code_positions(next_coder(), known, shape.sort_grid, count)
    _check_indices(coarse, rule.steps[Attribute.POSITION])
    walk = _Walk(next_coder, goal, shape, build_levels(coarse))
    order = None
    if shape.has_permutation:
        places = None if goal is None else goal.permutation
        order = Plane(code_permutation(next_coder(), places, walk.lod, np.zeros(count, np.int64))[:, None])
    weights = IntraWeights(walk.cover())
    walk.columns(Attribute.SCALE, weights, Earlier())
    weights = weights.with_scales(walk.planes[Attribute.SCALE], shape.units)
    walk.columns(Attribute.OPACITY, weights, Earlier())
    weights = weights.with_opacities(walk.planes[Attribute.OPACITY], shape.units)
    walk.positions(coarse, weights)
    # rotations and colours know nothing of each other; a reader ends a stream before it opens the next
    coder = next_coder()

    def turn() -> None:
        walk.rotations(coder, weights)

    wait = (_at_once if goal is None else goal.beside)(turn)
    colours = Earlier()
    for attribute in sorted(rule.steps):
        if attribute >= Attribute.SH_DC:
            walk.columns(attribute, weights, colours)
    wait()
    planes = {attribute: Plane(walk.planes[attribute]) for attribute in sorted(rule.steps)}
    return FrameState(planes, order, cover=weights.cover)

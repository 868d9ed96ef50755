"""The walk of a graded I-frame: steps follow cover and visibility as they become known (spec section 11.5).

Positions come first, as coarse as any of them may be; then cover classes, scales and opacities, whose steps
depend on what is there by then; then the positions' low bits, rotations and colours.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field

import numpy as np

from dfcgs_codec.bitstream.constants import STATE_COLUMNS, STATE_LIMIT, Attribute
from dfcgs_codec.bitstream.frame_headers import Grading
from dfcgs_codec.bitstream.sequence_header import UnitExponents
from dfcgs_codec.codec.component import EarlierPasses, code_component
from dfcgs_codec.codec.dpb import FrameState, Plane
from dfcgs_codec.codec.graded_component import Earlier, GradedColumn, Quantise, Target
from dfcgs_codec.codec.graded_rotation import ChooseTurns, GradedRotation
from dfcgs_codec.codec.intra import IntraShape, code_permutation
from dfcgs_codec.codec.position_tree import code_positions
from dfcgs_codec.codec.symbols import Int64, SymbolCoder
from dfcgs_codec.codec.visibility import (
    IntraWeights,
    alpha_weights,
    axes_of,
    coarse_octaves,
    steps_of,
)
from dfcgs_codec.entropy.symbols import code_bits
from dfcgs_codec.errors import CorruptBitstream
from dfcgs_codec.transform.companding import compress_thinness, expand_thinness
from dfcgs_codec.transform.lod import LevelsOfDetail, build_levels

#: largest cover class
MAX_COVER = 15
#: the axis that may be companded
_THIN_AXIS = 2
#: steps of turns count as no larger than this, in stereographic units
MAX_TURN_STEP = 1 << 16


@dataclass(frozen=True)
class GradedTarget:
    """What an encoder wants a frame to be: `planes` (N, C) in canonical order, classes, places, its choices.

    `positions` (N, 3): in units of the position step. `thinness`: how symbols of companded axes are chosen,
    which are decoded to no less than `least_thinness`, for axes must not grow by octaves.
    `opacities`: what they, (N, 1), are to be beside the scales that were decoded, (N, 3), both in grid units.
    `turns`: how symbols of turns are chosen; `keeps_names`: whether rotations keep their axes, for they are
    those of frames before.
    """

    planes: Mapping[Attribute, Int64]
    positions: Int64
    cover: Int64
    permutation: Int64 | None
    quantise: Mapping[Attribute, Quantise]
    thinness: Quantise
    least_thinness: int
    opacities: Callable[[Int64], Int64]
    turns: Callable[[GradedRotation], ChooseTurns]
    keeps_names: bool = False


@dataclass(frozen=True)
class GradedShape:
    """What the headers say that the walk needs."""

    intra: IntraShape
    steps: Mapping[Attribute, int]
    grading: Grading
    units: UnitExponents


@dataclass
class _Walk:
    """A walk under way: where streams come from, what is wanted, what is there."""

    next_coder: Callable[[], SymbolCoder]
    target: GradedTarget | None
    shape: GradedShape
    lod: LevelsOfDetail
    planes: dict[Attribute, Int64] = field(default_factory=dict)

    def opacities(self, weights: Int64) -> None:
        """Code the opacities, beside the scales."""
        wanted = None
        if self.target is not None:
            wanted = self.target.opacities(self.planes[Attribute.SCALE])
        self.columns(Attribute.OPACITY, weights, Earlier(), wanted)

    def colours(self, attribute: Attribute, weights: Int64, earlier: Earlier) -> None:
        """Code colours, with the help of `earlier` ones."""
        wanted = None if self.target is None else self.target.planes[attribute]
        self.columns(attribute, weights, earlier, wanted)

    def columns(self, attribute: Attribute, weights: Int64, earlier: Earlier, plane: Int64 | None) -> None:
        """Code the columns of an attribute, each with the help of `earlier` ones and those before it.

        `plane` (N, C): what they are to be, None when reading.
        """
        coder, target, grading = self.next_coder(), self.target, self.shape.grading
        steps = steps_of(self.shape.steps[attribute], grading.levels[attribute], weights)
        found = []
        for column in range(STATE_COLUMNS[attribute]):
            wanted = None
            if target is not None and plane is not None:
                wanted = Target(plane[:, column], target.quantise[attribute])
            graded = GradedColumn(steps, self.lod, earlier, attribute in grading.alternating)
            found.append(graded.code(coder, wanted))
        self.planes[attribute] = np.stack(found, axis=1)

    def scales(self, weights: Int64) -> None:
        """Code the scales: axis 2 by how thin it is beside axis 1, which is there by then (spec 9.7)."""
        coder, target, shape = self.next_coder(), self.target, self.shape
        steps = steps_of(shape.steps[Attribute.SCALE], shape.grading.levels[Attribute.SCALE], weights)
        octaves, exponent = shape.grading.thin_octaves, shape.units.scale
        earlier = Earlier()
        found: list[Int64] = []
        for column in range(STATE_COLUMNS[Attribute.SCALE]):
            is_thin = octaves > 0 and column == _THIN_AXIS
            wanted = None
            if target is not None:
                values = target.planes[Attribute.SCALE][:, column]
                if is_thin:
                    values = compress_thinness(found[-1] - values, exponent, octaves)
                wanted = Target(values, target.quantise[Attribute.SCALE])
                if is_thin:
                    wanted = Target(values, target.thinness, target.least_thinness)
            alternating = Attribute.SCALE in shape.grading.alternating and not is_thin
            coded = GradedColumn(steps, self.lod, earlier, alternating).code(coder, wanted)
            if is_thin:
                coded = found[-1] - expand_thinness(coded, exponent, octaves)
                if np.abs(coded).max() > STATE_LIMIT:
                    raise CorruptBitstream("a reconstructed value leaves the range of the state")
            found.append(coded)
        self.planes[Attribute.SCALE] = np.stack(found, axis=1)

    def cover(self) -> Int64:
        """Code the cover classes."""
        given = None if self.target is None else self.target.cover
        count = self.shape.intra.num_gaussians
        cover = code_component(self.next_coder(), given, self.lod, EarlierPasses(count))
        if cover.min() < 0 or cover.max() > MAX_COVER:
            raise CorruptBitstream("a cover class is out of range")
        return cover

    def positions(self, coarse: Int64, weights: Int64) -> None:
        """Code the low bits of positions; `coarse` (N, 3) is what is known of them."""
        shape, coder = self.shape, self.next_coder()
        most, step = shape.grading.coarse_log2, shape.steps[Attribute.POSITION]
        octaves = coarse_octaves(shape.grading.levels[Attribute.POSITION], weights, most)
        indices = coarse.copy()
        for bits in range(1, most + 1):
            rows = np.flatnonzero(octaves == most - bits)
            low = None
            if self.target is not None:
                shifted = self.target.positions[rows] >> (most - bits)
                low = (shifted & ((1 << bits) - 1)).ravel()
            found = code_bits(coder, low, bits, 3 * len(rows)).reshape(-1, 3)
            indices[rows] = (coarse[rows] << bits) | found
        if np.abs(indices).max() > 2 * STATE_LIMIT // step:
            raise CorruptBitstream("a symbol is too large for its step")
        # the middle of the cells of the finest steps that a coarse one spans
        width = np.left_shift(np.int64(1), octaves)[:, None]
        values = indices * width * step + ((width - 1) * step >> 1)
        if np.abs(values).max() > STATE_LIMIT:
            raise CorruptBitstream("a reconstructed value leaves the range of the state")
        self.planes[Attribute.POSITION] = values

    def rotations(self, coder: SymbolCoder, weights: IntraWeights) -> None:
        """Code the rotations, in a stream that is open."""
        shape, target = self.shape, self.target
        step, level = shape.steps[Attribute.ROTATION], shape.grading.levels[Attribute.ROTATION]
        tilt, spin = weights.turns()
        tilts = np.minimum(steps_of(step, level, tilt), MAX_TURN_STEP)
        spins = np.minimum(steps_of(step, level, spin), MAX_TURN_STEP)
        alternating = Attribute.ROTATION in shape.grading.alternating
        rotation = GradedRotation(tilts, spins, weights.is_needle, self.lod, alternating)
        choose = None if target is None else target.turns(rotation)
        keeps_names = target is not None and target.keeps_names
        found = rotation.code(coder, choose, keeps_names=keeps_names)
        self.planes[Attribute.ROTATION] = found


def code_graded(
    next_coder: Callable[[], SymbolCoder], target: GradedTarget | None, shape: GradedShape
) -> FrameState:
    """All streams of a graded I-frame; `next_coder` opens each one in turn; returns the state."""
    intra, grading = shape.intra, shape.grading
    count = intra.num_gaussians
    known = None if target is None else target.positions >> grading.coarse_log2
    coarse = code_positions(next_coder(), known, intra.sort_grid, count)
    if np.abs(coarse).max() > 2 * STATE_LIMIT // shape.steps[Attribute.POSITION]:
        raise CorruptBitstream("a symbol is too large for its step")
    walk = _Walk(next_coder, target, shape, build_levels(coarse))
    order = None
    if intra.has_permutation:
        places = None if target is None else target.permutation
        order = Plane(code_permutation(next_coder(), places, walk.lod, count)[:, None])
    cover = walk.cover()
    walk.scales(IntraWeights.of_cover(cover))
    axes = axes_of(walk.planes[Attribute.SCALE], shape.units.scale)
    walk.opacities((IntraWeights.area(axes) >> 1) + IntraWeights.of_cover(cover))
    alpha = alpha_weights(walk.planes[Attribute.OPACITY][:, 0], shape.units.opacity)
    weights = IntraWeights(cover, axes, alpha)
    walk.positions(coarse, weights.of(Attribute.POSITION))
    # rotations and colours know nothing of each other; a reader ends a stream before it opens the next
    with ThreadPoolExecutor(1) as beside:
        turned = beside.submit(walk.rotations, next_coder(), weights)
        if target is None:
            turned.result()
        colours = Earlier()
        for attribute in intra.attributes:
            if attribute >= Attribute.SH_DC:
                walk.colours(attribute, weights.of(attribute), colours)
        turned.result()
    planes = {attribute: Plane(walk.planes[attribute]) for attribute in intra.attributes}
    return FrameState(planes, order, cover=cover)

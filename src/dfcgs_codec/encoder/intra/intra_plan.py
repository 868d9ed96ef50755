"""What an encoder chooses for I-frames: cover, levels of steps, symbols of columns."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np

from dfcgs_codec.array_types import Int64, UInt8
from dfcgs_codec.bitstream.constants import STATE_LIMIT, Attribute
from dfcgs_codec.bitstream.frame_headers import IntraSteps, SortGrid
from dfcgs_codec.bitstream.sequence_header import UnitExponents
from dfcgs_codec.codec.columns.column import ColumnGoal
from dfcgs_codec.codec.intra.steps import IntraWeights, column_steps, position_octaves, turn_steps
from dfcgs_codec.codec.intra.turns import ChooseTurns, TurnWalk
from dfcgs_codec.codec.intra.walk import THIN_AXIS
from dfcgs_codec.codec.state.planes import FrameState
from dfcgs_codec.codec.state.visibility import Visibility
from dfcgs_codec.encoder.images.joint_quantisation import opacities_beside
from dfcgs_codec.encoder.intra.trellis_search import best_path
from dfcgs_codec.encoder.intra.turn_choice import TurnChooser
from dfcgs_codec.encoder.plan.quantiser_steps import Quantisation
from dfcgs_codec.encoder.residual.quantise import Planes, ZeroBin, order_of, plan_grid
from dfcgs_codec.transform.companding import compress_thinness, thin_octaves
from dfcgs_codec.transform.rotation import round_divide
from dfcgs_codec.transform.trellis import takes_turns

#: share of the Gaussians whose steps are coarser than given
_RANK = 0.9
#: the same in P-frames; with 0.9 whole files are 1 % smaller at equal PSNR, but P-frames more than 1 dB below
#: I-frames of the same QP
_INTER_RANK = 0.8
#: octaves over which thin axes count less and less
_THIN_OCTAVES = 6
#: by how much the third axis may come out longer than the second, logarithm
_MOST_LONGER = 0.35
#: positions are coarser by up to the octaves of this share of the Gaussians, and this many
_COARSE_RANK = 0.98
_MOST_COARSE = 4


@dataclass(frozen=True)
class ColumnQuantiser:
    """How symbols of a column are chosen: by `zero_bin`, or on the best path where two quantisers take turns.

    `least`: no value is decoded to less, in columns that do not alternate.
    """

    values: Int64
    zero_bin: ZeroBin
    alternating: bool = False
    least: int | None = None

    def choose(self, rows: slice, prediction: Int64, steps: Int64, contexts: UInt8) -> Int64:
        """Symbols of a pass."""
        residual = self.values[rows] - prediction
        if self.alternating and takes_turns(len(residual)):
            return best_path(residual / steps, contexts)
        symbols = self.zero_bin.quantise(residual, steps)
        if self.least is None:
            return symbols
        raised: Int64 = np.maximum(symbols, -((prediction - self.least) // steps))
        return raised


@dataclass(frozen=True)
class IntraTarget:
    """An I-frame, or births, as they are to be: planes (N, C) and classes (N,) in canonical order.

    `positions` (N, 3): in units of the position step; `keeps_names`: see `IntraGoal`.
    """

    planes: Mapping[Attribute, Int64]
    positions: Int64
    cover: Int64
    steps: IntraSteps
    grid: SortGrid
    quantisation: Quantisation
    zero_bin: float
    permutation: Int64 | None = None
    keeps_names: bool = False

    def column(
        self, attribute: Attribute, column: int, decoded: Mapping[Attribute, Int64], before: list[Int64]
    ) -> ColumnGoal:
        """See IntraGoal."""
        units, is_bounded = self.quantisation.units, attribute in self.quantisation.bounded
        alternating, least = attribute in self.steps.alternating, None
        values = self.planes[attribute][:, column]
        if attribute == Attribute.OPACITY and not is_bounded:
            values = opacities_beside(decoded[Attribute.SCALE], self.planes, units)[:, 0]
        if attribute == Attribute.SCALE and column == THIN_AXIS and self.steps.thin_octaves:
            values = compress_thinness(before[-1] - values, units.scale, self.steps.thin_octaves)
            alternating, least = False, -int(_MOST_LONGER * 2.0**-units.scale)
        zero_bin = ZeroBin(0.5 if is_bounded else self.zero_bin)
        return ColumnGoal(values, ColumnQuantiser(values, zero_bin, alternating, least).choose)

    def turns(self, walk: TurnWalk) -> ChooseTurns:
        """See IntraGoal."""
        return TurnChooser(self.planes[Attribute.ROTATION], walk).choose

    def beside(self, work: Callable[[], None]) -> Callable[[], None]:
        """See IntraGoal: in a thread of its own."""
        pool = ThreadPoolExecutor(1)
        begun = pool.submit(work)
        pool.shutdown(wait=False)
        return begun.result


@dataclass(frozen=True)
class IntraPlan:
    """How I-frames of a run are coded: `cover` classes (N,) in input order; steps and what they follow."""

    cover: Int64
    steps: IntraSteps

    @staticmethod
    def of(planes: Planes, cover: Int64 | None, quantisation: Quantisation) -> IntraPlan:
        """From planes (N, C) under their final axis names and cover, None: all 0, both in input order."""
        units, uniform = quantisation.units, quantisation.uniform
        if cover is None or not quantisation.follows_visibility:
            cover = np.zeros(len(planes[Attribute.POSITION]), np.int64)
        weights = IntraWeights(cover).with_scales(planes[Attribute.SCALE], units)
        weights = weights.with_opacities(planes[Attribute.OPACITY], units)
        known = dict.fromkeys(planes, np.maximum(*weights.turns()))
        known |= {a: weights.of(a) for a in planes if a != Attribute.ROTATION}
        levels = {a: int(np.quantile(w, _RANK, method="lower")) for a, w in sorted(known.items())}
        levels |= dict.fromkeys(uniform & levels.keys(), -STATE_LIMIT)
        used = {attribute: quantisation.intra_steps[attribute] for attribute in levels}
        alternating = planes.keys() - quantisation.bounded - {Attribute.POSITION}
        thin = 0 if Attribute.SCALE in uniform else _THIN_OCTAVES
        steps = IntraSteps(used, _MOST_COARSE, levels, thin, frozenset(alternating))
        coarse = int(np.quantile(position_octaves(steps, weights), _COARSE_RANK, method="lower"))
        return IntraPlan(cover, replace(steps, coarse_log2=coarse))

    def order(self, positions: Int64) -> tuple[Int64, SortGrid]:
        """Canonical order of `positions` (N, 3) in grid units, and the sort grid."""
        step = self.steps.steps[Attribute.POSITION]
        coarse = round_divide(positions, step) >> self.steps.coarse_log2
        grid = plan_grid(coarse)
        return order_of(coarse, grid), grid

    def target(
        self,
        planes: Mapping[Attribute, Int64],
        ordered: tuple[Int64, SortGrid],
        quantisation: Quantisation,
        zero_bin: float,
    ) -> IntraTarget:
        """What is to be coded; `planes` in canonical order: `ordered` is what `order` gave."""
        positions = round_divide(planes[Attribute.POSITION], self.steps.steps[Attribute.POSITION])
        cover = self.cover[ordered[0]]
        return IntraTarget(planes, positions, cover, self.steps, ordered[1], quantisation, zero_bin)


def steps_in_intra_frame(frame: FrameState, units: UnitExponents, rule: IntraSteps) -> dict[Attribute, Int64]:
    """Steps (N, 1) that Gaussians like those of `frame` have in an I-frame.

    Of axes, and of turns about them, (N, 3).
    """
    planes = frame.planes
    weights = IntraWeights(frame.covers()).with_scales(planes[Attribute.SCALE].values, units)
    weights = weights.with_opacities(planes[Attribute.OPACITY].wide(), units)
    columns = planes.keys() - {Attribute.POSITION, Attribute.ROTATION}
    found = {a: column_steps(rule, a, weights)[:, None] for a in columns}
    if rule.thin_octaves:
        scales = planes[Attribute.SCALE].wide()
        by = thin_octaves(scales[:, 1] - scales[:, 2], units.scale, rule.thin_octaves)
        found[Attribute.SCALE] = found[Attribute.SCALE] << (by[:, None] * np.array([0, 0, 1]))
    octaves = position_octaves(rule, weights)
    found[Attribute.POSITION] = (rule.steps[Attribute.POSITION] << octaves)[:, None]
    tilt, spin = turn_steps(rule, weights)
    needle = weights.is_needle
    turns = [np.where(needle, spin, tilt), tilt, np.where(needle, tilt, spin)]
    found[Attribute.ROTATION] = np.stack(turns, axis=1)
    return found


def inter_levels(
    visibility: Visibility, attributes: Iterable[Attribute], bounded: frozenset[Attribute]
) -> dict[Attribute, int]:
    """Weights at which steps of P-frames are as given: few Gaussians show more; if bounded, for all."""
    levels = {}
    for attribute in attributes:
        level = int(np.quantile(visibility.weights(attribute), _INTER_RANK, method="lower"))
        levels[attribute] = -STATE_LIMIT if attribute in bounded else level
    return levels

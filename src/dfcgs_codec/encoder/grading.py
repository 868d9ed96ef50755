"""What an encoder chooses for graded I-frames: cover, levels, symbols of turns."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from dfcgs_codec.bitstream.constants import STATE_LIMIT, Attribute
from dfcgs_codec.bitstream.frame_headers import Grading, SortGrid
from dfcgs_codec.bitstream.sequence_header import UnitExponents
from dfcgs_codec.codec.dpb import FrameState
from dfcgs_codec.codec.graded_component import Quantise
from dfcgs_codec.codec.graded_intra import GradedTarget
from dfcgs_codec.codec.graded_rotation import (
    ChooseTurns,
    GradedRotation,
    TurnContexts,
    Turns,
    pole_turns,
)
from dfcgs_codec.codec.visibility import (
    IntraWeights,
    Visibility,
    alpha_weights,
    axes_of,
    coarse_octaves,
    steps_of,
)
from dfcgs_codec.encoder.analysis import Planes, ZeroBin, order_of, plan_grid
from dfcgs_codec.encoder.canonical import AxisNames
from dfcgs_codec.encoder.joint_quantisation import opacities_beside
from dfcgs_codec.encoder.rate_control import Quantisation
from dfcgs_codec.encoder.trellis_search import AlternatingQuantiser, best_path
from dfcgs_codec.transform.companding import thin_octaves
from dfcgs_codec.transform.rotation import CELLS, ONE, STEREO_ONE, multiply, round_divide
from dfcgs_codec.transform.trellis import takes_turns

Int64 = npt.NDArray[np.int64]
UInt8 = npt.NDArray[np.uint8]
Float64 = npt.NDArray[np.float64]

#: share of the Gaussians whose steps are coarser than given
GRADED_RANK = 0.9
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


def nearest_by(alone: ZeroBin) -> Quantise:
    """How symbols are chosen where one quantiser is alone."""

    def nearest(residual: Int64, steps: Int64, _: UInt8) -> Int64:
        return alone.quantise(residual, steps)

    return nearest


def quantise_by(alone: ZeroBin, grading: Grading, attribute: Attribute) -> Quantise:
    """How symbols of an attribute are chosen: by `alone`, but where two quantisers take turns."""
    if attribute in grading.alternating:
        return AlternatingQuantiser(alone).quantise
    return nearest_by(alone)


@dataclass(frozen=True)
class GradedPlan:
    """How I-frames of a run are graded: `cover` classes (N,) in input order; the header's fields."""

    cover: Int64
    grading: Grading

    @staticmethod
    def of(planes: Planes, cover: Int64, quantisation: Quantisation) -> GradedPlan:
        """From planes (N, C) under their final axis names and cover, both in input order."""
        axes = axes_of(planes[Attribute.SCALE], quantisation.units.scale)
        alpha = alpha_weights(planes[Attribute.OPACITY][:, 0], quantisation.units.opacity)
        weights = IntraWeights(cover, axes, alpha)
        of_cover = IntraWeights.of_cover(cover)
        known = {attribute: weights.of(attribute) for attribute in planes}
        known[Attribute.SCALE] = of_cover
        known[Attribute.OPACITY] = (IntraWeights.area(axes) >> 1) + of_cover
        known[Attribute.ROTATION] = np.maximum(*weights.turns())
        levels = {a: int(np.quantile(w, GRADED_RANK, method="lower")) for a, w in sorted(known.items())}
        levels |= dict.fromkeys(quantisation.bounded & levels.keys(), -STATE_LIMIT)
        octaves = coarse_octaves(levels[Attribute.POSITION], known[Attribute.POSITION], _MOST_COARSE)
        coarse = int(np.quantile(octaves, _COARSE_RANK, method="lower"))
        thin = 0 if Attribute.SCALE in quantisation.bounded else _THIN_OCTAVES
        alternating = planes.keys() - quantisation.bounded - {Attribute.POSITION}
        return GradedPlan(cover, Grading(coarse, levels, thin, frozenset(alternating)))

    def order(self, positions: Int64, quantisation: Quantisation) -> tuple[Int64, SortGrid]:
        """Canonical order of `positions` (N, 3) in grid units, and the sort grid."""
        step = quantisation.graded_steps[Attribute.POSITION]
        coarse = round_divide(positions, step) >> self.grading.coarse_log2
        grid = plan_grid(coarse)
        return order_of(coarse, grid), grid

    def target(
        self, planes: Mapping[Attribute, Int64], order: Int64, quantisation: Quantisation, zero_bin: float
    ) -> GradedTarget:
        """What is to be coded; `planes` in canonical order, which is `order` of the input's."""
        step = quantisation.graded_steps[Attribute.POSITION]
        indices = round_divide(planes[Attribute.POSITION], step)
        bins = {a: ZeroBin(0.5 if a in quantisation.bounded else zero_bin) for a in planes}
        quantise = {a: quantise_by(alone, self.grading, a) for a, alone in bins.items()}
        thinness = nearest_by(bins[Attribute.SCALE])
        least = -int(_MOST_LONGER * 2.0**-quantisation.units.scale)

        def turns(rotation: GradedRotation) -> ChooseTurns:
            return TurnChooser(planes[Attribute.ROTATION], rotation).choose

        classes = self.cover[order]

        def opacities(decoded: Int64) -> Int64:
            if Attribute.OPACITY in quantisation.bounded:
                return planes[Attribute.OPACITY]
            return opacities_beside(decoded, planes, quantisation.units)

        return GradedTarget(planes, indices, classes, None, quantise, thinness, least, opacities, turns)


def steps_in_intra_frame(
    frame: FrameState, units: UnitExponents, grading: Grading, steps: Mapping[Attribute, int]
) -> dict[Attribute, Int64]:
    """Steps (N, 1) that Gaussians like those of `frame` have in an I-frame.

    Of axes, and of turns about them, (N, 3).
    """
    planes, levels, cover = frame.planes, grading.levels, frame.covers()
    axes = axes_of(planes[Attribute.SCALE].values, units.scale)
    weights = IntraWeights(cover, axes, alpha_weights(planes[Attribute.OPACITY].wide()[:, 0], units.opacity))
    known = {attribute: weights.of(attribute) for attribute in planes if attribute >= Attribute.SH_DC}
    known[Attribute.SCALE] = weights.of_cover(cover)
    known[Attribute.OPACITY] = (weights.area(axes) >> 1) + weights.of_cover(cover)
    found = {a: steps_of(steps[a], levels[a], w)[:, None] for a, w in known.items()}
    if grading.thin_octaves:
        scales = planes[Attribute.SCALE].wide()
        by = thin_octaves(scales[:, 1] - scales[:, 2], units.scale, grading.thin_octaves)
        found[Attribute.SCALE] = found[Attribute.SCALE] << (by[:, None] * np.array([0, 0, 1]))
    shown = weights.of(Attribute.POSITION)
    octaves = coarse_octaves(levels[Attribute.POSITION], shown, grading.coarse_log2)
    found[Attribute.POSITION] = (steps[Attribute.POSITION] << octaves)[:, None]
    of_turn = (steps_of(steps[Attribute.ROTATION], levels[Attribute.ROTATION], w) for w in weights.turns())
    tilt, spin = of_turn
    columns = [np.where(weights.is_needle, spin, tilt), tilt, np.where(weights.is_needle, tilt, spin)]
    found[Attribute.ROTATION] = np.stack(columns, axis=1)
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


@dataclass(frozen=True)
class TurnChooser:
    """Chooses tilts and spins from where the frame is expected: to the nearest, or the best path."""

    quaternions: Int64
    rotation: GradedRotation

    def choose(self, rows: slice, frames: Int64, contexts: TurnContexts) -> Turns:
        """Symbols of the Gaussians `rows`."""
        is_needle = self.rotation.is_needle[rows]
        pole = np.where(is_needle, 1, 3)
        turn, flips = _unflipped(multiply(frames * np.array([1, -1, -1, -1]), self.quaternions[rows]), pole)
        swing = _times_conjugate(turn, _twist(turn, pole))
        swing[swing[:, 0] < 0] *= -1
        stereo = swing[:, 1:] / (1.0 + swing[:, :1]) * STEREO_ONE
        parts = np.where(is_needle[:, None], stereo[:, 1:], stereo[:, :2])
        steps = self.rotation.tilt_steps[rows]
        both = np.concatenate([contexts[0]] * 2)
        tilts = self._nearest((parts / steps[:, None]).T.ravel(), both).reshape(2, -1).T
        # what is left to turn once the tilt is rounded
        rounded = self.rotation.tilts_of(tilts, steps)
        tilted, _ = pole_turns(rounded, np.zeros(len(steps), np.int64), is_needle)
        conjugate = tilted * np.array([1, -1, -1, -1])
        left = _twist(multiply(conjugate, np.rint(turn * ONE).astype(np.int64)) / ONE, pole)
        spin = left[np.arange(len(left)), pole] / (1.0 + left[:, 0]) * STEREO_ONE
        return Turns(tilts, self._nearest(spin / self.rotation.spin_steps[rows], contexts[1]), flips)

    def _nearest(self, real: Float64, contexts: UInt8) -> Int64:
        """Symbols of turns (rows,), in steps."""
        if not (self.rotation.alternating and takes_turns(len(real))):
            return np.rint(real).astype(np.int64)
        return best_path(real, contexts)


def _twist(turns: Float64, pole: Int64) -> Float64:
    """The part of each turn (rows, 4) that is about the pole's axis, w >= 0, of length 1."""
    rows = np.arange(len(turns))
    result = np.zeros_like(turns)
    w, p = turns[:, 0], turns[rows, pole]
    length = np.maximum(np.hypot(w, p), 1e-12)
    sign = np.where(w < 0, -1.0, 1.0)
    result[:, 0], result[rows, pole] = np.abs(w) / length, sign * p / length
    return result


def _times_conjugate(a: Float64, b: Float64) -> Float64:
    """a times the conjugate of b."""
    w, x, y, z = a.T
    s, i, j, k = b[:, 0], -b[:, 1], -b[:, 2], -b[:, 3]
    product = [
        w * s - x * i - y * j - z * k,
        w * i + x * s + y * k - z * j,
        w * j - x * k + y * s + z * i,
        w * k + x * j - y * i + z * s,
    ]
    return np.stack(product, axis=1)


def _unflipped(turns: Int64, pole: Int64) -> tuple[Float64, Int64]:
    """Of the four names of each Gaussian the one with the smallest tilt, then the smallest turn about it.

    And the flips that lead back.
    """
    real = turns / ONE
    rows = np.arange(len(real))
    # a half turn about axis 1 turns the pole around
    upright = real[:, 0] ** 2 + real[rows, pole] ** 2 >= 0.5
    real = np.where(upright[:, None], real, _times_conjugate(real, np.array([[0.0, 0.0, 1.0, 0.0]])))
    about = np.zeros_like(real)
    about[rows, pole] = 1.0
    near = np.abs(real[:, 0]) >= np.abs(real[rows, pole])
    # about the pole first, then about axis 1: i j = k, and k j is i but for its sign
    both = np.where(pole == 1, 3, 1)
    flips = np.where(upright, np.where(near, 0, pole), np.where(near, 2, both))
    return np.where(near[:, None], real, _times_conjugate(real, about)), flips


def settled_names(names: AxisNames, target: Int64, decoded: Int64) -> AxisNames:
    """The names under which `target` quaternions (N, 4) lie near the `decoded` ones: flipped where needed."""
    turn = np.abs(multiply(decoded * np.array([1, -1, -1, -1]), target))
    flips = turn.argmax(axis=1)
    flipped = np.flatnonzero(flips)
    turns = names.turns.copy()
    turns[flipped] = multiply(turns[flipped], CELLS[flips[flipped]] * ONE)
    return AxisNames(names.order, turns)

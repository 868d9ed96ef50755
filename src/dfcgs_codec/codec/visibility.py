"""Steps that follow what can be seen of each Gaussian (spec sections 9.5 and 9.6).

A step's effect on the image falls with the Gaussian's opacity and area, the turn of a round Gaussian shows
nothing, and what lies behind others shows less, by its cover class. What is known of scale, opacity and cover
makes the steps of the rest coarser, never finer. All in integers: log-scales are linear in the state, and two
small tables hold what is not.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from dfcgs_codec.bitstream.constants import Attribute
from dfcgs_codec.bitstream.sequence_header import UnitExponents
from dfcgs_codec.codec.dpb import FrameState, Plane
from dfcgs_codec.transform.companding import expand

Int64 = npt.NDArray[np.int64]

#: sixteenths of an octave to a unit of natural logarithm: round(16 * 2**10 / ln 2)
OCTAVES_PER_LOG = 23637
OCTAVES_PER_LOG_BITS = 10
#: sixteenths of an octave of alpha**2, by quarters of a logit from -8: round(32 * log2(sigmoid))
#: in the middle of each
ALPHA_WEIGHTS = (
    -364, -352, -341, -329, -317, -306, -294, -283, -271, -260, -248, -237, -225, -214, -203, -191,
    -180, -169, -157, -146, -135, -124, -114, -103, -93, -83, -74, -65, -56, -49, -41, -35,
    -29, -24, -20, -16, -13, -10, -8, -7, -5, -4, -3, -3, -2, -2, -1, -1,
    -1, -1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0,
)  # fmt: skip
#: sixteenths of an octave of (r - 1/r)**2, by quarter octaves of the ratio r of the two longest axes:
#: round(32 * log2(r - 1/r)) in the middle of each
ROUNDNESS_WEIGHTS = (-81, -30, -5, 12, 25, 37, 47, 56, 66, 74, 83, 91, 99, 108, 116, 124)
#: steps are at most 2**(MAX_COARSENESS / 4) times as coarse
MAX_COARSENESS = 16
#: by quarter octaves, in 256ths: round(256 * 2**(k / 4))
MULTIPLIERS = (
    256, 304, 362, 431, 512, 609, 724, 861, 1024, 1218, 1448, 1722, 2048, 2435, 2896, 3444, 4096,
)  # fmt: skip
MULTIPLIER_BITS = 8

#: what a cover class takes from a weight: half an octave of the step
COVER_WEIGHT = 16
#: turns about the longest axis, and tilts of discs, weigh no more than this
MAX_TURN_WEIGHT = 64
#: what a turn about a Gaussian's own pole weighs less than a tilt of it
SPIN_WEIGHT = 16

_ALPHA_WEIGHTS = np.array(ALPHA_WEIGHTS, np.int64)
_ROUNDNESS_WEIGHTS = np.array(ROUNDNESS_WEIGHTS, np.int64)
_MULTIPLIERS = np.array(MULTIPLIERS, np.int64)
#: the widest shift that 64 bits know
_MAX_SHIFT = 63


def alpha_weights(opacity: Int64, exponent: int) -> Int64:
    """log2(alpha**2) (N,), in sixteenths, of companded opacities (N,) in units of 2**exponent."""
    quarters = expand(opacity, exponent) >> (-2 - exponent)
    half = len(ALPHA_WEIGHTS) // 2
    weights: Int64 = _ALPHA_WEIGHTS[np.clip(quarters + half, 0, 2 * half - 1)]
    return weights


def longest_axes(scales: npt.NDArray[np.integer], exponent: int) -> tuple[Int64, Int64]:
    """log2, in sixteenths, of the longest and the middle axis (N,) of log-scales (N, 3)."""
    x, y, z = (column.astype(np.int64) for column in scales.T)
    low, high = np.minimum(x, y), np.maximum(x, y)
    longest, middle = np.maximum(high, z), np.maximum(low, np.minimum(high, z))
    shift = min(max(OCTAVES_PER_LOG_BITS - exponent, 0), _MAX_SHIFT)
    return longest * OCTAVES_PER_LOG >> shift, middle * OCTAVES_PER_LOG >> shift


def _roundness_weights(ratio: Int64) -> Int64:
    ratio = np.maximum(ratio, 0)
    known = _ROUNDNESS_WEIGHTS[np.minimum(ratio >> 2, len(ROUNDNESS_WEIGHTS) - 1)]
    weights: Int64 = np.where(ratio >> 2 < len(ROUNDNESS_WEIGHTS), known, 2 * ratio)
    return weights


def coarseness_of(level: int, weights: Int64) -> Int64:
    """Quarter octaves by which steps of Gaussians with `weights` (N,) are coarser."""
    coarseness: Int64 = np.clip((level - weights) >> 3, 0, MAX_COARSENESS)
    return coarseness


def steps_of(step: int, level: int, weights: Int64) -> Int64:
    """Steps (N,) of Gaussians with `weights` (N,): `step` for those of weight `level` (spec section 9.6)."""
    multipliers = _MULTIPLIERS[coarseness_of(level, weights)]
    steps: Int64 = (step * multipliers + (1 << (MULTIPLIER_BITS - 1))) >> MULTIPLIER_BITS
    return steps


def coarse_octaves(level: int, weights: Int64, most: int) -> Int64:
    """By how many whole octaves, 0 to `most`, steps of Gaussians with `weights` are coarser, (N,)."""
    octaves: Int64 = np.clip((level - weights) >> 5, 0, most)
    return octaves


@dataclass(frozen=True)
class IntraWeights:
    """How much errors show of Gaussians of an I-frame, (N,) each, as far as they are decoded.

    `cover` int64 (N,); `axes`: log2, in sixteenths, of the three axes as they come; `alpha`: see
    `alpha_weights`.
    """

    cover: Int64
    axes: tuple[Int64, Int64, Int64]
    alpha: Int64

    @staticmethod
    def of_cover(cover: Int64) -> Int64:
        """Before anything else is known: of scales."""
        return -COVER_WEIGHT * cover

    @staticmethod
    def area(axes: tuple[Int64, Int64, Int64]) -> Int64:
        """log2, in sixteenths, of the area of the two longest axes."""
        x, y, z = axes
        total: Int64 = x + y + z - np.minimum(np.minimum(x, y), z)
        return total

    def of(self, attribute: Attribute) -> Int64:
        """Of positions and colours."""
        shown = self.alpha
        if attribute != Attribute.POSITION:
            shown = shown + self.area(self.axes)
        return (shown >> 1) + self.of_cover(self.cover)

    @property
    def is_needle(self) -> npt.NDArray[np.bool_]:
        """Whether the pole is axis 0, not axis 2: the one that differs most from the two others."""
        x, y, z = self.axes
        needles: npt.NDArray[np.bool_] = x - y > y - z
        return needles

    def turns(self) -> tuple[Int64, Int64]:
        """Of tilts of the pole, and of turns about it."""
        x, y, z = self.axes
        flat = np.minimum(_roundness_weights(np.where(self.is_needle, y - z, x - z)), MAX_TURN_WEIGHT)
        long = _roundness_weights(x - y)
        shown = self.of(Attribute.SH_DC)
        tilt, spin = np.where(self.is_needle, long, flat), np.where(self.is_needle, flat, long)
        return shown + tilt, shown + spin - SPIN_WEIGHT


def axes_of(scales: npt.NDArray[np.integer], exponent: int) -> tuple[Int64, Int64, Int64]:
    """log2, in sixteenths, of the three axes (N,) of log-scales (N, 3), as they come."""
    shift = min(max(OCTAVES_PER_LOG_BITS - exponent, 0), _MAX_SHIFT)
    x, y, z = (column.astype(np.int64) * OCTAVES_PER_LOG >> shift for column in scales.T)
    return x, y, z


class Visibility:
    """What scale, opacity and cover of a reference frame say of each Gaussian; found when first asked for."""

    def __init__(self, frame: FrameState, units: UnitExponents) -> None:
        self._planes = self._planes_of(frame)
        self._cover = frame.cover
        self.units = units
        self._parts: tuple[Int64, Int64, Int64, Int64] | None = None
        self._multipliers: dict[Attribute, tuple[int, Int64]] = {}

    @staticmethod
    def _planes_of(frame: FrameState) -> tuple[Plane, Plane]:
        return frame.planes[Attribute.SCALE], frame.planes[Attribute.OPACITY]

    def of(self, frame: FrameState) -> Visibility:
        """That of another frame; the same where its scales and opacities are the same planes."""
        same = all(old is new for old, new in zip(self._planes, self._planes_of(frame), strict=True))
        return self if same else Visibility(frame, self.units)

    def weights(self, attribute: Attribute) -> Int64:
        """How much an error of `attribute` shows in the image, (N,) in sixteenths of an octave."""
        if self._parts is None:
            scale, opacity = self._planes
            longest, middle = longest_axes(scale.values, self.units.scale)
            alpha = alpha_weights(opacity.wide()[:, 0], self.units.opacity)
            hidden = np.int64(0) if self._cover is None else COVER_WEIGHT * self._cover
            self._parts = (alpha - hidden, longest + middle - hidden, longest - middle, longest + middle)
        alpha, covered_area, ratio, area = self._parts
        if attribute == Attribute.POSITION:
            return alpha
        if attribute == Attribute.OPACITY:
            return covered_area
        if attribute == Attribute.ROTATION:
            return alpha + area + _roundness_weights(ratio)
        return alpha + area

    def multipliers(self, attribute: Attribute, level: int) -> Int64:
        """By what 256ths the step of each Gaussian is coarser, (N, 1): those of weight `level` have 256."""
        known = self._multipliers.get(attribute)
        if known is None or known[0] != level:
            coarser = _MULTIPLIERS[self.coarseness(attribute, level)][:, None]
            known = self._multipliers[attribute] = (level, coarser)
        return known[1]

    def coarseness(self, attribute: Attribute, level: int) -> Int64:
        """The same in quarter octaves, (N,)."""
        return coarseness_of(level, self.weights(attribute))

    def all_multipliers(self, levels: Mapping[Attribute, int]) -> dict[Attribute, Int64]:
        """`multipliers` of each attribute that has a level."""
        return {attribute: self.multipliers(attribute, level) for attribute, level in levels.items()}

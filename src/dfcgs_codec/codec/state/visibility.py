"""Steps that follow what can be seen of each Gaussian (spec section 9.5).

A step's effect on the image falls with the Gaussian's opacity and area, the turn of a round Gaussian shows
nothing, and what lies behind others shows less, by its cover class. What is known of scale, opacity and cover
makes the steps of the rest coarser, never finer. All in integers: log-scales are linear in the state, and two
small tables hold what is not.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from dfcgs_codec.array_types import Int64, Integers
from dfcgs_codec.bitstream.constants import Attribute
from dfcgs_codec.bitstream.sequence_header import UnitExponents
from dfcgs_codec.codec.state.planes import FrameState, Plane
from dfcgs_codec.transform.companding import expand

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


def roundness_weights(ratio: Int64) -> Int64:
    """log2((r - 1/r)**2) of axes whose ratio r has the log2 `ratio`; both (N,), in sixteenths."""
    ratio = np.maximum(ratio, 0)
    known = _ROUNDNESS_WEIGHTS[np.minimum(ratio >> 2, len(ROUNDNESS_WEIGHTS) - 1)]
    weights: Int64 = np.where(ratio >> 2 < len(ROUNDNESS_WEIGHTS), known, 2 * ratio)
    return weights


def coarseness_of(level: int, weights: Int64) -> Int64:
    """Quarter octaves by which steps of Gaussians with `weights` (N,) are coarser."""
    coarseness: Int64 = np.clip((level - weights) >> 3, 0, MAX_COARSENESS)
    return coarseness


def coarser_steps(step: int, level: int, weights: Int64) -> Int64:
    """Steps (N,) of Gaussians with `weights` (N,): `step` for those of weight `level` and more."""
    multipliers = _MULTIPLIERS[coarseness_of(level, weights)]
    steps: Int64 = (step * multipliers + (1 << (MULTIPLIER_BITS - 1))) >> MULTIPLIER_BITS
    return steps


def axes_of(scales: Integers, exponent: int) -> tuple[Int64, Int64, Int64]:
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
            x, y, z = axes_of(scale.values, self.units.scale)
            low, high = np.minimum(x, y), np.maximum(x, y)
            longest, middle = np.maximum(high, z), np.maximum(low, np.minimum(high, z))
            alpha = alpha_weights(opacity.wide()[:, 0], self.units.opacity)
            hidden = np.int64(0) if self._cover is None else COVER_WEIGHT * self._cover
            self._parts = (alpha - hidden, longest + middle - hidden, longest - middle, longest + middle)
        alpha, covered_area, ratio, area = self._parts
        if attribute == Attribute.POSITION:
            return alpha
        if attribute == Attribute.OPACITY:
            return covered_area
        if attribute == Attribute.ROTATION:
            return alpha + area + roundness_weights(ratio)
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

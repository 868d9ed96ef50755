"""Steps of the Gaussians of an I-frame, which follow what is decoded of each by then (spec section 9.6)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dfcgs_codec.array_types import Bool, Int64, Integers
from dfcgs_codec.bitstream.constants import Attribute
from dfcgs_codec.bitstream.frame_headers import IntraSteps
from dfcgs_codec.bitstream.sequence_header import UnitExponents
from dfcgs_codec.codec.state.visibility import (
    COVER_WEIGHT,
    alpha_weights,
    axes_of,
    coarser_steps,
    roundness_weights,
)

Axes = tuple[Int64, Int64, Int64]

#: turns about the longest axis, and tilts of discs, weigh no more than this
MAX_TURN_WEIGHT = 64
#: what a turn about a Gaussian's own pole weighs less than a tilt of it
SPIN_WEIGHT = 16


@dataclass(frozen=True)
class IntraWeights:
    """How much errors show of Gaussians of an I-frame, as far as they are decoded.

    `cover` classes (N,); then `axes`: log2, in sixteenths, of the three axes (N,) as they come; then `alpha`
    (N,), see `alpha_weights`.
    """

    cover: Int64
    axes: Axes | None = None
    alpha: Int64 | None = None

    def with_scales(self, scales: Integers, units: UnitExponents) -> IntraWeights:
        """When log-scales (N, 3) are there."""
        return replace(self, axes=axes_of(scales, units.scale))

    def with_opacities(self, opacities: Int64, units: UnitExponents) -> IntraWeights:
        """When companded opacities (N, 1) are there, too."""
        return replace(self, alpha=alpha_weights(opacities[:, 0], units.opacity))

    def of(self, attribute: Attribute) -> Int64:
        """Of any attribute but ROTATION, (N,) in sixteenths of an octave."""
        hidden = COVER_WEIGHT * self.cover
        if attribute == Attribute.SCALE:
            return -hidden
        if attribute == Attribute.OPACITY:
            return (self._area >> 1) - hidden
        assert self.alpha is not None
        if attribute == Attribute.POSITION:
            return (self.alpha >> 1) - hidden
        return ((self.alpha + self._area) >> 1) - hidden

    def turns(self) -> tuple[Int64, Int64]:
        """Of tilts of the pole, and of turns about it."""
        x, y, z = self._axes
        flat = np.minimum(roundness_weights(np.where(self.is_needle, y - z, x - z)), MAX_TURN_WEIGHT)
        long = roundness_weights(x - y)
        shown = self.of(Attribute.SH_DC)
        tilt, spin = np.where(self.is_needle, long, flat), np.where(self.is_needle, flat, long)
        return shown + tilt, shown + spin - SPIN_WEIGHT

    @property
    def is_needle(self) -> Bool:
        """Whether the pole is axis 0, not axis 2: the one that differs most from the two others."""
        x, y, z = self._axes
        needles: Bool = x - y > y - z
        return needles

    @property
    def _axes(self) -> Axes:
        assert self.axes is not None
        return self.axes

    @property
    def _area(self) -> Int64:
        """log2, in sixteenths, of the area of the two longest axes."""
        x, y, z = self._axes
        area: Int64 = x + y + z - np.minimum(np.minimum(x, y), z)
        return area


def column_steps(rule: IntraSteps, attribute: Attribute, weights: IntraWeights) -> Int64:
    """Steps (N,) of the columns of an attribute other than POSITION and ROTATION."""
    return coarser_steps(rule.steps[attribute], rule.levels[attribute], weights.of(attribute))


def position_octaves(rule: IntraSteps, weights: IntraWeights) -> Int64:
    """By how many whole octaves steps of positions are coarser, (N,)."""
    level = rule.levels[Attribute.POSITION]
    octaves: Int64 = np.clip((level - weights.of(Attribute.POSITION)) >> 5, 0, rule.coarse_log2)
    return octaves


def turn_steps(rule: IntraSteps, weights: IntraWeights) -> tuple[Int64, Int64]:
    """Steps (N,) of tilts and of spins, in stereographic units, before they are limited."""
    step, level = rule.steps[Attribute.ROTATION], rule.levels[Attribute.ROTATION]
    tilt, spin = weights.turns()
    return coarser_steps(step, level, tilt), coarser_steps(step, level, spin)

"""P-frames checked in the image: are they as good as I-frames in their place would be?

A few patches of each frame are drawn as the input has them, as they were decoded and as an I-frame would
quantise them. The same patches say both errors, so that a few suffice. An encoder's choice; floats are
welcome here.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from dfcgs_codec.array_types import Float64, Int64
from dfcgs_codec.bitstream.constants import Attribute
from dfcgs_codec.bitstream.frame_headers import IntraSteps
from dfcgs_codec.codec.state.planes import FrameState
from dfcgs_codec.encoder.images.balance import Quantised
from dfcgs_codec.encoder.images.patches import NEARBY_BIAS, Surroundings, patches_among
from dfcgs_codec.encoder.images.sensitivity import squared
from dfcgs_codec.encoder.images.splats import Splats, alpha_of, deviations
from dfcgs_codec.encoder.intra.intra_plan import steps_in_intra_frame
from dfcgs_codec.encoder.plan.plan import SequencePlan
from dfcgs_codec.transform.companding import expand

Planes = Mapping[Attribute, Int64]

#: groups of patches, and patches of each: in turn, a frame is looked at in one of them
_GROUPS, _PATCHES = 4, 8
#: a few patches say little: those of the frames before count this much less with each frame
_REMEMBERED = 0.7
#: what a frame alone says counts where it is worse than with those before by so many dB
_UNSURE = 1.5
#: and that it is worse than the quality asked for, where it is by so many dB: patches differ from images
_SURE = 1.5
#: errors of I-frames, to those expected of them; other figures come from frames that show too little
_USUAL = 0.2, 1.5
#: squared errors below this show nowhere
_LEAST_ERROR = 1e-9


class Watch:
    """Compares frames of a GoF with what its I-frame was.

    `level`: by how many dB the last frames were worse than I-frames in their place.
    """

    def __init__(self, plan: SequencePlan) -> None:
        self._plan = plan
        self._rule: IntraSteps | None = None
        self._usual = [1.0] * _GROUPS
        self._before = self._now = np.zeros(3)
        self.level = 0.0

    def begin(self, target: Planes, state: FrameState, rule: IntraSteps | None) -> None:
        """A GoF begins: how far its I-frame is from what is expected of I-frames."""
        self._rule, self.level = rule, 0.0
        if rule is None:
            return
        self._before = np.zeros(3)
        for group in range(_GROUPS):
            decoded, expected = self._errors(target, state, _PATCHES, group)
            # each group is compared with itself: a few patches have most of the error
            usual = min(max(decoded / expected, _USUAL[0]), _USUAL[1])
            self._usual[group] = usual
            self._before += np.array([decoded, usual * expected, _PATCHES]) / _GROUPS
        self._now = np.zeros(3)

    def go_on(self) -> None:
        """The frame that was looked at is kept."""
        if self._rule is None:
            return
        self._before = _REMEMBERED * self._before + self._now
        self.level = self._decibels(self._before)

    def behind(self, target: Planes, state: FrameState, index: int) -> float:
        """By how many dB a frame is worse than an I-frame in its place."""
        if self._rule is None:
            return 0.0
        group = index % _GROUPS
        decoded, expected = self._errors(target, state, _PATCHES, group)
        self._now = np.array([decoded, self._usual[group] * expected, _PATCHES])
        together = _REMEMBERED * self._before + self._now
        return max(self._decibels(together), self._decibels(self._now) - _UNSURE)

    def short(self) -> float:
        """By how many dB the frame that was looked at is surely worse than the sequence is to be."""
        error, _, count = _REMEMBERED * self._before + self._now
        wanted = self._plan.estimate
        if wanted is None or self._rule is None:
            return 0.0
        return wanted + 10.0 * float(np.log10(error / count)) - NEARBY_BIAS - _SURE

    def _decibels(self, errors: Float64) -> float:
        return 10.0 * float(np.log10(errors[0] / errors[1]))

    @np.errstate(all="ignore")
    def _errors(self, target: Planes, state: FrameState, count: int, seed: int) -> tuple[float, float]:
        """Squared errors of a frame as it was decoded, and as I-frames have them."""
        assert self._rule is not None
        units, zero_bin = self._plan.quantisation.units, self._plan.options.tuning.intra_zero_bin
        wanted = Quantised(target, {}, units, zero_bin)
        errors: list[tuple[float, float]] = []
        for patch in patches_among(_surroundings(wanted, state), count, seed):
            if not len(patch.rows):
                continue
            there, everyone = state.take(patch.rows), np.arange(len(patch.rows))
            steps = steps_in_intra_frame(there, units, self._rule)
            real = {attribute: step.astype(np.float64) for attribute, step in steps.items()}
            here = {attribute: plane[patch.rows] for attribute, plane in target.items()}
            image = patch.draw(wanted.splats(patch.rows)).image()
            coded = {attribute: plane.wide() for attribute, plane in there.planes.items()}
            drawn = patch.draw(Quantised(coded, {}, units, zero_bin).splats(everyone)).image()
            intra = Quantised(here, real, units, zero_bin, self._rule.thin_octaves).quantised(everyone)
            errors.append((squared(drawn, image), squared(patch.draw(intra).image(), image)))
        return summed_errors(errors)


def summed_errors(patches: Sequence[tuple[float, float]]) -> tuple[float, float]:
    """Squared errors of `patches`, as decoded and as expected, summed over all but the one that is worst.

    Where two Gaussians swap places in depth, one patch can have more error than all others together.
    """
    kept = sorted(patches, key=lambda errors: errors[0] - errors[1])[:-1]
    decoded, expected = np.sum([(_LEAST_ERROR, _LEAST_ERROR), *kept], axis=0)
    return float(decoded), float(expected)


def _surroundings(wanted: Quantised, state: FrameState) -> Surroundings:
    """What patches are chosen from: Gaussians that show as they should, or as they were decoded."""
    planes, units = wanted.planes, wanted.units

    def shapes(rows: Int64) -> Splats:
        return replace(wanted.shapes(rows), alpha=alpha[rows])

    scales = planes[Attribute.SCALE] * 2.0**units.scale
    opacities = np.maximum(planes[Attribute.OPACITY][:, 0], state.planes[Attribute.OPACITY].values[:, 0])
    alpha = alpha_of(expand(opacities, units.opacity) * 2.0**units.opacity)
    middle = 0.5 * (scales.sum(axis=1) - scales.min(axis=1))
    positions = wanted.positions(planes[Attribute.POSITION])
    return Surroundings(positions, deviations(middle), deviations(scales.max(axis=1)), alpha, shapes)

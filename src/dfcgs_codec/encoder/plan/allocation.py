"""Axis names of a frame's Gaussians, how I-frames code them, and steps that the first frame balances."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dfcgs_codec.array_types import Int64
from dfcgs_codec.bitstream.constants import Attribute
from dfcgs_codec.bitstream.frame_headers import IntraSteps
from dfcgs_codec.codec.state.planes import FrameState, Plane
from dfcgs_codec.codec.state.visibility import MULTIPLIER_BITS, Visibility
from dfcgs_codec.encoder.images.balance import Quantised, balanced_octaves, no_worse, total_error
from dfcgs_codec.encoder.images.patches import Patch
from dfcgs_codec.encoder.images.sensitivity import ImageError, image_errors
from dfcgs_codec.encoder.intra.intra_plan import IntraPlan, inter_levels, steps_in_intra_frame
from dfcgs_codec.encoder.intra.trellis_search import ALTERNATING_ERROR
from dfcgs_codec.encoder.matching.canonical import AxisNames, choose_axis_names
from dfcgs_codec.encoder.plan.plan import SequencePlan
from dfcgs_codec.encoder.residual.quantise import Planes

#: share of what the first frame says that is believed of P-frames: errors there are not larger than what
#: changes, and nobody knows yet what will
_INTER_SHARE = 0.5
#: of errors of positions in P-frames, as much counts: what motion leaves of them is mostly less than a step.
#: From 0.15 to 0.35 three of four sequences take the same bytes within 0.2 %, and 2 to 4 % more at 1
_INTER_POSITION = 0.25
#: errors of P-frames, if everything changed by more than its step, to those of I-frames, at most: 4.5 dB.
#: Where everything trembles, P-frames are then 1.9 to 2.2 dB below I-frames in the mean
_INTER_ERROR = 2.8
#: frames whose error is less than this share of the largest show too little to count
_SHOWN_SHARE = 0.3


@dataclass(frozen=True)
class Placing:
    """Axis names, and how I-frames are coded; rows as those of the input."""

    names: AxisNames
    intra: IntraPlan

    @staticmethod
    def of(planes: Planes, plan: SequencePlan, cover: Int64 | None = None) -> Placing:
        """Those of an untracked frame, or of the first of a run; `cover` (N,): cover classes."""
        names = choose_axis_names(planes)
        return Placing(names, IntraPlan.of(names.rename(planes), cover, plan.quantisation))


@dataclass(frozen=True)
class Balance:
    """Errors of the pixels of I-frames by attribute; `error` of all in the frames that show, 0: in none."""

    errors: dict[Attribute, ImageError]
    error: float


@dataclass(frozen=True)
class Look:
    """A frame that is looked at: `planes` (N, C), `cover` classes (N,), None: all 0, and `patches` of it."""

    planes: Planes
    cover: Int64 | None
    patches: Sequence[Patch]

    def placed(self, plan: SequencePlan) -> tuple[FrameState, IntraSteps]:
        """The Gaussians as they are coded."""
        placing = Placing.of(self.planes, plan, self.cover)
        planes = {a: Plane(p) for a, p in placing.names.rename(self.planes).items()}
        return FrameState(planes, cover=placing.intra.cover), placing.intra.steps


def _together(looks: Sequence[dict[Attribute, ImageError]]) -> tuple[dict[Attribute, ImageError], float]:
    """Mean errors by attribute; and of all, in the frames in which these show."""
    totals = [total_error(errors, {}) for errors in looks]
    shown = [total for total in totals if total > 0.0 and total >= _SHOWN_SHARE * max(totals)]
    summed: dict[Attribute, ImageError] = {}
    for errors in looks:
        for attribute, error in errors.items():
            summed[attribute] = summed.get(attribute, ImageError(0.0)) + error
    mean = {attribute: error.scaled(1.0 / len(looks)) for attribute, error in summed.items()}
    return mean, sum(shown) / max(len(shown), 1)


def _looked(
    looks: Sequence[Look], drawn: Sequence[Quantised], scales: Sequence[Mapping[Attribute, float]]
) -> Balance:
    found = []
    for look, quantised, scale in zip(looks, drawn, scales, strict=True):
        errors = image_errors(look.patches, quantised.draw)
        found.append({a: error.scaled(scale.get(a, 1.0)) for a, error in errors.items()})
    return Balance(*_together(found))


def intra_errors(plan: SequencePlan, looks: Sequence[Look]) -> Balance:
    """What patches show of frames that are quantised as I-frames of `plan` are."""
    placed = [look.placed(plan) for look in looks]
    scales = [dict.fromkeys(steps.alternating, ALTERNATING_ERROR) for _, steps in placed]
    drawn = [_in_intra_frames(state, plan, steps) for state, steps in placed]
    return _looked(looks, drawn, scales)


def balanced_plan(plan: SequencePlan, looks: Sequence[Look], intra: Balance) -> SequencePlan:
    """With steps in proportion to what they show; `intra`: errors of its I-frames."""
    if not plan.quantisation.follows_visibility:
        return plan
    bounded = plan.quantisation.bounded
    state, steps = looks[0].placed(plan)
    intra_octaves = balanced_octaves(intra.errors, _in_intra_frames(state, plan, steps), bounded)
    octaves: dict[Attribute, float] = {}
    if plan.header.num_frames > 1:
        drawn = [_in_inter_frames(look.placed(plan)[0], plan) for look in looks]
        inter = _looked(looks, drawn, [{}] * len(looks))
        shares = {Attribute.POSITION: _INTER_POSITION}
        counted = {a: error.scaled(shares.get(a, 1.0)) for a, error in inter.errors.items()}
        octaves = {a: _INTER_SHARE * o for a, o in balanced_octaves(counted, drawn[0], bounded).items()}
        octaves = no_worse(octaves, inter.errors, _INTER_ERROR * total_error(intra.errors, {}))
    return replace(plan, quantisation=plan.quantisation.balanced(intra_octaves, octaves))


def _wide(state: FrameState) -> dict[Attribute, Int64]:
    return {attribute: plane.wide() for attribute, plane in state.planes.items()}


def _in_intra_frames(state: FrameState, plan: SequencePlan, rule: IntraSteps) -> Quantised:
    units = plan.quantisation.units
    steps = steps_in_intra_frame(state, units, rule)
    real = {attribute: step.astype(np.float64) for attribute, step in steps.items()}
    zero_bin = plan.options.tuning.intra_zero_bin
    return Quantised(_wide(state), real, units, zero_bin, rule.thin_octaves)


def _in_inter_frames(state: FrameState, plan: SequencePlan) -> Quantised:
    quantisation = plan.quantisation
    visibility = Visibility(state, quantisation.units)
    coarser = visibility.all_multipliers(inter_levels(visibility, state.planes, quantisation.bounded))
    real = {
        a: by.astype(np.float64) * (quantisation.steps[a] / (1 << MULTIPLIER_BITS))
        for a, by in coarser.items()
    }
    return Quantised(_wide(state), real, quantisation.units, plan.options.tuning.zero_bin)

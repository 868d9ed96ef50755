"""Axis names, canonical order and grading of a frame's Gaussians, and steps that the first frame balances."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from dfcgs_codec.bitstream.constants import Attribute
from dfcgs_codec.bitstream.escapes import Escapes
from dfcgs_codec.bitstream.frame_headers import Grading, SortGrid
from dfcgs_codec.codec.dpb import FrameState, Plane
from dfcgs_codec.codec.visibility import MULTIPLIER_BITS, Visibility
from dfcgs_codec.encoder.analysis import Planes, order_of, plan_grid
from dfcgs_codec.encoder.balance import Quantised, balanced_octaves, no_worse, total_error
from dfcgs_codec.encoder.canonical import AxisNames, choose_axis_names
from dfcgs_codec.encoder.cover import cover_of, light
from dfcgs_codec.encoder.grading import GradedPlan, inter_levels, steps_in_intra_frame
from dfcgs_codec.encoder.plan import SequencePlan
from dfcgs_codec.encoder.sensitivity import image_errors
from dfcgs_codec.encoder.targets import Targets
from dfcgs_codec.encoder.trellis_search import ALTERNATING_ERROR
from dfcgs_codec.gaussians import GaussianCloud
from dfcgs_codec.transform.rotation import round_divide

Int64 = npt.NDArray[np.int64]
Float64 = npt.NDArray[np.float64]

#: share of what the first frame says that is believed of P-frames: errors there are not larger than what
#: changes, and nobody knows yet what will
_INTER_SHARE = 0.5
#: of errors of positions in P-frames, as much counts: what motion leaves of them is mostly less than a step.
#: From 0.15 to 0.35 three of four sequences take the same bytes within 0.2 %, and 2 to 4 % more at 1
_INTER_POSITION = 0.25
#: errors of P-frames, if everything changed by more than its step, to those of I-frames, at most: 4.5 dB.
#: Where everything trembles, P-frames are then 1.9 to 2.2 dB below I-frames in the mean
_INTER_ERROR = 2.8
#: the same with `--steady`: zero bins and errors of the I-frame that are never mended add to it
_STEADY_ERROR = 1.1


@dataclass(frozen=True)
class Placing:
    """Axis names and grading, where Gaussians have any; rows as those of the input."""

    names: AxisNames | None
    graded: GradedPlan | None

    @staticmethod
    def of(cloud: GaussianCloud, planes: Planes, plan: SequencePlan, known: Float64 | None = None) -> Placing:
        """Those of an untracked frame, or of the first of a run; `known` (N,): its light, if it was found."""
        if plan.options.keep_axes:
            return Placing(None, None)
        names = choose_axis_names(planes)
        if not plan.is_graded:
            return Placing(names, None)
        cover = np.zeros(cloud.num_gaussians)
        if plan.options.cover:
            cover = cover_of(light(cloud) if known is None else known)
        return Placing(names, GradedPlan.of(names.rename(planes), cover, plan.quantisation))

    def order(self, positions: Int64, plan: SequencePlan) -> tuple[Int64, SortGrid]:
        """Canonical order of `positions` (N, 3) in grid units, and the sort grid."""
        if self.graded is not None:
            return self.graded.order(positions, plan.quantisation)
        indices = round_divide(positions, plan.steps[Attribute.POSITION])
        grid = plan_grid(indices)
        return order_of(indices, grid), grid


def balanced_plan(plan: SequencePlan, first: GaussianCloud, escapes: Escapes | None = None) -> SequencePlan:
    """With steps in proportion to what they show in the `first` frame; `escapes`: its own."""
    if not (plan.is_graded and plan.options.balance):
        return plan
    everyone = np.ones(first.num_gaussians)
    near = np.arange(first.num_gaussians)
    if escapes is not None:
        # who lies apart from all others has no say in how these are coded
        near = np.setdiff1d(near, escapes.rows)
    if not len(near):
        return plan
    first = first.take(near) if len(near) < len(everyone) else first
    found, planes = light(first), Targets(plan.header.unit_exponents.from_origin).planes(first)
    placing = Placing.of(first, planes, plan, found)
    assert placing.names is not None
    assert placing.graded is not None
    planes = placing.names.rename(planes)
    bounded, grading = plan.quantisation.bounded, placing.graded.grading
    cover = np.rint(placing.graded.cover).astype(np.int64)
    state = FrameState({a: Plane(plane) for a, plane in planes.items()}, cover=cover)
    intra, inter = _in_intra_frames(state, plan, grading), None
    with ThreadPoolExecutor(2) as beside:
        looked = beside.submit(image_errors, first, found, intra.draw)
        if plan.header.num_frames > 1:
            inter = _in_inter_frames(state, plan)
            looked_inter = beside.submit(image_errors, first, found, inter.draw)
    errors = looked.result()
    for attribute in grading.alternating & errors.keys():
        errors[attribute] = errors[attribute].scaled(ALTERNATING_ERROR)
    graded = balanced_octaves(errors, intra, bounded)
    octaves: dict[Attribute, float] = {}
    if inter is not None:
        most = _STEADY_ERROR if plan.options.steady else _INTER_ERROR
        limit = most * total_error(errors, {})
        errors = looked_inter.result()
        shares = {Attribute.POSITION: _INTER_POSITION}
        counted = {a: error.scaled(shares.get(a, 1.0)) for a, error in errors.items()}
        octaves = {a: _INTER_SHARE * o for a, o in balanced_octaves(counted, inter, bounded).items()}
        octaves = no_worse(octaves, errors, limit)
    everyone[near] = found
    return replace(plan, quantisation=plan.quantisation.balanced(graded, octaves), first_light=everyone)


def _wide(state: FrameState) -> dict[Attribute, Int64]:
    return {attribute: plane.wide() for attribute, plane in state.planes.items()}


def _in_intra_frames(state: FrameState, plan: SequencePlan, grading: Grading) -> Quantised:
    """The Gaussians of `state` as I-frames quantise them."""
    quantisation = plan.quantisation
    steps = steps_in_intra_frame(state, quantisation.units, grading, quantisation.graded_steps)
    real = {attribute: step.astype(np.float64) for attribute, step in steps.items()}
    zero_bin = plan.options.intra_zero_bin
    return Quantised(_wide(state), real, quantisation.units, zero_bin, grading.thin_octaves)


def _in_inter_frames(state: FrameState, plan: SequencePlan) -> Quantised:
    """As P-frames quantise what changes."""
    quantisation = plan.quantisation
    visibility = Visibility(state, quantisation.units)
    coarser = visibility.all_multipliers(inter_levels(visibility, state.planes, quantisation.bounded))
    real = {
        a: by.astype(np.float64) * (quantisation.steps[a] / (1 << MULTIPLIER_BITS))
        for a, by in coarser.items()
    }
    return Quantised(_wide(state), real, quantisation.units, plan.options.zero_bin)

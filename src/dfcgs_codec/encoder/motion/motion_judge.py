"""What a motion would leave to the residual, estimated on a sample of the Gaussians."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from dfcgs_codec.array_types import Bool, Float64, Int64
from dfcgs_codec.bitstream.constants import Attribute
from dfcgs_codec.codec.motion.compensation import GofMotion, turned
from dfcgs_codec.codec.state.planes import FrameState
from dfcgs_codec.encoder.motion.motion_estimation import chosen_moves
from dfcgs_codec.encoder.residual.quantise import Planes, relative_rotation
from dfcgs_codec.model.context_model import ContextModel
from dfcgs_codec.transform.rigid import RigidMotion

#: Gaussians that are looked at
_SAMPLE = 6144
#: steps above which a residual is not zero, and what such a one costs besides its octave
_SIGNIFICANT = 0.6
_VALUE_BITS = 1.6
#: bits that a squared error of one step is worth
_ERROR_BITS = 6.0
#: steps beyond which an error does no more harm
_WORST_ERROR = 16.0


def residual_bits(errors: Float64) -> float:
    """About the bits of residuals (rows, C) in steps: which are not zero, their signs, their octaves.

    And what their errors are worth.
    """
    symbols = np.abs(errors)
    significant = symbols >= _SIGNIFICANT
    share = np.clip(significant.mean(axis=0), 1e-9, 1 - 1e-9)
    flags = -(share * np.log2(share) + (1 - share) * np.log2(1 - share)).sum() * len(errors)
    values = symbols[significant]
    bits = flags + _VALUE_BITS * len(values) + np.log2(np.maximum(values, 1.0)).sum()
    # what is not coded stays as an error
    small = symbols[~significant]
    return float(bits + _ERROR_BITS * ((small * small).sum() + len(values) / 12))


def lasting_bits(errors: Float64) -> float:
    """What errors (rows, C) in steps are worth that no residual will mend."""
    size = np.minimum(np.abs(errors), _WORST_ERROR)
    return float(_ERROR_BITS * (size * size).sum())


@dataclass(frozen=True)
class MotionTask:
    """A frame to be moved to: the GoF's motion so far, reference, target, who `changed` (N,), the steps.

    `multipliers`: by what 256ths the steps of each Gaussian are coarser, (N, 1), where they are not one;
    `has_residual`: whether one follows, else the frame moves in any case; `model`: the frozen prior of the
    sequence; `has_turns`: whether control points turn what they carry.
    """

    motion: GofMotion
    reference: FrameState
    target: Planes
    changed: Bool
    steps: dict[Attribute, int]
    multipliers: Mapping[Attribute, Int64] = field(default_factory=dict)
    has_residual: bool = True
    model: ContextModel | None = None
    has_turns: bool = True


class MotionJudge:
    """Positions and rotations of the Gaussians that changed, against where motions would bring them."""

    def __init__(self, task: MotionTask) -> None:
        reference, target, multipliers = task.reference, task.target, task.multipliers
        rows = np.flatnonzero(task.changed)
        sample = rows[:: max(1, len(rows) // _SAMPLE)]
        self._scale = len(rows) / len(sample)
        self._cost = residual_bits if task.has_residual else lasting_bits
        self._binding = task.motion.binding.of_rows(sample)
        self._steps = {
            a: task.steps[a] * (multipliers[a][sample] / 256.0 if a in multipliers else np.ones((1, 1)))
            for a in (Attribute.POSITION, Attribute.ROTATION)
        }
        self._positions = reference.planes[Attribute.POSITION].values[sample].T.astype(np.float64)
        self._rotations = reference.planes[Attribute.ROTATION].values[sample].astype(np.int64)
        self._goal = target[Attribute.POSITION][sample].T - self._positions
        self._turned_goal = target[Attribute.ROTATION][sample]

    def bits(self, motion: RigidMotion | None, *, is_rigid: bool) -> float:
        """Estimated bits of the residuals of positions and rotations after `motion`, or without any."""
        error, rotations = self._goal, self._rotations
        if motion is not None:
            error = error - chosen_moves(self._binding, motion, self._positions)
        if motion is not None and is_rigid:
            rotations = turned(rotations, self._binding.turns(motion))
        turns = relative_rotation(self._turned_goal, rotations, 1) / self._steps[Attribute.ROTATION]
        bits = self._cost(error.T / self._steps[Attribute.POSITION]) + self._cost(turns)
        return bits * self._scale

"""Motion that control points spread, as the paper's codec sees it: each one's own displacement, as it is."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from dfcgs_codec.bitstream.constants import (
    MAX_DECAY_EXPONENT,
    ROTATION_FRACTION_BITS,
    STEREO_FRACTION_BITS,
    Attribute,
)
from dfcgs_codec.bitstream.motion_header import MotionHeader, SpreadHeader
from dfcgs_codec.codec.motion import NUM_CONTROL_COLUMNS, MotionSymbols, classify_modes
from dfcgs_codec.encoder.motion_choice import TRANSLATION_SHARE, MotionTask, MotionTrial
from dfcgs_codec.encoder.plan import SequencePlan

Int64 = npt.NDArray[np.int64]


def spread_header(plan: SequencePlan, num_points: int) -> MotionHeader:
    """All control points are coded; motion fades by e over one scene unit."""
    exponent = plan.gof_setup.control.shift + plan.header.unit_exponents.position
    spread = SpreadHeader(
        plan.options.tuning.num_neighbours, int(np.clip(exponent, -MAX_DECAY_EXPONENT, MAX_DECAY_EXPONENT))
    )
    shift = max(1, int(plan.steps[Attribute.POSITION] * TRANSLATION_SHARE))
    # a quaternion changes by about twice its stereographic vector
    one = 2 << (ROTATION_FRACTION_BITS - STEREO_FRACTION_BITS)
    turn = int(plan.steps[Attribute.ROTATION] * TRANSLATION_SHARE * one)
    return MotionHeader(num_points, 0, shift, min(max(1, turn), 1 << ROTATION_FRACTION_BITS), spread)


def _displacements(task: MotionTask) -> Int64:
    """How control points' Gaussians go from the reference to the target (n, 7); 0 of those that went."""
    motion = task.motion
    found = np.zeros((motion.field.num_points, NUM_CONTROL_COLUMNS), np.int64)
    rows = motion.control_rows()
    alive = rows >= 0
    rows = rows[alive]
    for attribute, columns in ((Attribute.POSITION, slice(0, 3)), (Attribute.ROTATION, slice(3, 7))):
        target = task.target[attribute][rows]
        reference = task.reference.planes[attribute].values[rows].astype(np.int64)
        if attribute == Attribute.ROTATION:
            # q and -q are the same rotation
            target = np.where((target * reference).sum(axis=1, keepdims=True) < 0, -target, target)
        found[alive, columns] = target - reference
    return found


def spread_motion(task: MotionTask, header: MotionHeader) -> MotionTrial:
    """The motion of a frame; whether it pays is found by coding the frame."""
    steps = np.repeat([header.translation_step, header.turn_step], [3, 4])
    control = np.rint(_displacements(task) / steps).astype(np.int64)
    everyone = np.ones(len(task.changed), np.bool_)
    symbols = MotionSymbols(control, classify_modes(everyone, task.block_log2), everyone)
    return MotionTrial(header, symbols, task.motion.carry(header, symbols, task.reference), 0.0)

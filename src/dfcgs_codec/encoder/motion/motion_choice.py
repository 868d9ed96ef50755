"""The motion that a frame is worth, chosen by the bits that it seems to save."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dfcgs_codec.array_types import Bool, Float64, Int64
from dfcgs_codec.bitstream.constants import Attribute
from dfcgs_codec.bitstream.motion_header import MotionHeader
from dfcgs_codec.codec.frame.walk import MotionGoal
from dfcgs_codec.codec.motion.compensation import Carried
from dfcgs_codec.codec.motion.followers import Binding
from dfcgs_codec.codec.motion.walk import MotionSymbols, code_motion
from dfcgs_codec.codec.residual.classes import BLOCK_LOG2
from dfcgs_codec.codec.state.planes import FrameState, Plane
from dfcgs_codec.encoder.columns.writer import SymbolWriter
from dfcgs_codec.encoder.motion.motion_estimation import (
    Moments,
    MotionQuantiser,
    chosen_moves,
    measure,
    trusted,
)
from dfcgs_codec.encoder.motion.motion_judge import MotionJudge, MotionTask
from dfcgs_codec.encoder.plan.position_grid import far_ones
from dfcgs_codec.encoder.residual.block_classes import classify_modes
from dfcgs_codec.encoder.residual.quantise import moved_rows
from dfcgs_codec.transform.rotation import STEREO_ONE

#: translations are this share of the position step, so that their rounding does not show
TRANSLATION_SHARE = 1 / 8
#: motion symbols of less than this many steps are zero
_ZERO_BIN = 0.55
#: Gaussians that motion is measured on at first, about, to see who goes elsewhere
_FIRST_MEASURED = 49_152
#: bits of motion count by this much: what is learnt from it makes that of later frames cheaper
_MOTION_SHARE = 0.6
#: bits that a Gaussian costs which stands still, but is carried along and has to be brought back
_BRING_BACK_BITS = 8.0


@dataclass(frozen=True)
class _Candidate:
    header: MotionHeader
    control: Int64
    bits: float


def motion_steps(task: MotionTask) -> tuple[int, int]:
    """Steps of translations, and of turn vectors that displace a Gaussian at the usual distance as much.

    0 of turn vectors: nothing turns.
    """
    step = max(1, int(task.steps[Attribute.POSITION] * TRANSLATION_SHARE))
    if not task.has_turns:
        return step, 0
    pivots, ranks = task.motion.field.pivots, task.motion.binding.gathering.ranks
    apart = np.linalg.norm(pivots[ranks[0, ::16]] - pivots[ranks[3, ::16]], axis=1)
    # a turn vector of length v turns by about 4 v
    turn = step / (4 * (np.median(apart) + 1.0))
    return step, max(1, int(min(turn, 1 / 16) * STEREO_ONE))


def _control_bytes(task: MotionTask, header: MotionHeader, control: Int64) -> int:
    motion, writers = task.motion, [SymbolWriter(), SymbolWriter()]
    symbols, shape = replace(motion.symbols, control=control), motion.shape(header, task.model)
    code_motion(iter(writers).__next__, symbols, motion.symbols, shape)
    return len(writers[1].getvalue())


class _Search:
    """Tries motions of a frame: real bytes of the motion, estimated bits of the residual."""

    def __init__(self, task: MotionTask) -> None:
        self._task = task
        self._judge = MotionJudge(task)
        self._moments = self._measure()
        self.rest = self._judge.bits(None, is_rigid=False)

    def _measure(self) -> Moments:
        """Where everything goes, those that do not go with the others counting less."""
        task, field = self._task, self._task.motion.field
        rows = np.flatnonzero(task.changed)
        _, source, target = self._paths(rows)
        # one that lies, or flies, apart from all others says nothing of how these move
        rows = rows[~(far_ones(source) | far_ones(target - source))]
        some = rows[:: max(1, len(rows) // _FIRST_MEASURED)]
        header = MotionHeader(*motion_steps(task))
        first = MotionQuantiser(field, measure(*self._paths(some), field.num_points), header, 0.0)
        motion = field.move(header, first).motion
        binding, source, target = self._paths(rows)
        carried = chosen_moves(binding, motion, np.ascontiguousarray(source.T))
        trust = trusted(target - source - carried.T, task.steps[Attribute.POSITION])
        return measure(binding, source, target, field.num_points, trust)

    def _paths(self, rows: Int64) -> tuple[Binding, Float64, Float64]:
        """Whom the Gaussians `rows` follow, where they are and where they go, (rows, 3)."""
        reference = self._task.reference.planes[Attribute.POSITION].values[rows].astype(np.float64)
        target = self._task.target[Attribute.POSITION][rows].astype(np.float64)
        return self._task.motion.binding.of_rows(rows), reference, target

    def attempt(self, header: MotionHeader) -> _Candidate:
        """The motion that `header` allows."""
        field = self._task.motion.field
        quantiser = MotionQuantiser(field, self._moments, header, _ZERO_BIN)
        moved = field.move(header, quantiser)
        num_bytes = _control_bytes(self._task, header, quantiser.symbols)
        bits = self._judge.bits(moved.motion, is_rigid=header.is_rigid) + _MOTION_SHARE * 8 * num_bytes
        return _Candidate(header, quantiser.symbols, bits)

    def candidates(self) -> list[_Candidate]:
        """With turns and without."""
        step, turn = motion_steps(self._task)
        return [self.attempt(MotionHeader(step, turn_step)) for turn_step in (turn, 0)]


def choose_motion(task: MotionTask) -> MotionGoal | None:
    """The motion that saves most bits, or None where none does; somebody must have changed."""
    search = _Search(task)
    best = min(search.candidates(), key=lambda candidate: candidate.bits)
    if best.bits >= search.rest and task.has_residual:
        return None
    everyone = np.ones(len(task.changed), np.bool_)
    carried = task.motion.carry(best.header, _symbols(task, best.control, everyone), task.reference)
    follows = _followers(task, carried)
    symbols = _symbols(task, best.control, follows)
    return MotionGoal(best.header, symbols, _only(carried, follows, task.reference))


def _only(carried: Carried, follows: Bool, reference: FrameState) -> Carried:
    """As if only some of those who followed did."""
    gathered = carried.gathered
    kept = np.flatnonzero(follows[gathered.rows])
    if len(kept) == len(gathered.rows):
        return carried
    planes = dict(reference.planes)
    for attribute in (Attribute.POSITION, Attribute.ROTATION):
        moved = carried.state.planes[attribute]
        if moved is not reference.planes[attribute]:
            planes[attribute] = Plane(
                np.where(follows[:, None], moved.values, reference.planes[attribute].values)
            )
    binding = gathered.binding.of_rows(kept)
    gathered = replace(gathered, rows=gathered.rows[kept], moves=gathered.moves[:, :, kept], binding=binding)
    return Carried(replace(carried.state, planes=planes), gathered)


def _symbols(task: MotionTask, control: Int64, follows: Bool) -> MotionSymbols:
    return MotionSymbols(control, classify_modes(follows), follows)


def _followers(task: MotionTask, carried: Carried) -> Bool:
    """Who follows: what changed, and of the rest whatever is not worth a flag."""
    moved = np.zeros(len(task.changed), np.bool_)
    for attribute in (Attribute.POSITION, Attribute.ROTATION):
        rows = moved_rows(attribute, task.reference, carried.state)
        if rows is not None:
            moved |= rows
    starts = np.arange(0, len(moved), 1 << BLOCK_LOG2)
    size = np.diff(np.append(starts, len(moved)))
    astray = np.add.reduceat((moved & ~task.changed).astype(np.int64), starts)
    changed = np.add.reduceat(task.changed.astype(np.int64), starts)
    share = np.clip(changed / size, 1e-3, 1 - 1e-3)
    flags = -size * (share * np.log2(share) + (1 - share) * np.log2(1 - share))
    is_mixed = (astray * _BRING_BACK_BITS > flags) & (changed > 0)
    block = np.arange(len(moved)) >> BLOCK_LOG2
    return np.where(is_mixed[block], task.changed, (changed > 0)[block])

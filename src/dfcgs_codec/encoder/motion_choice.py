"""How much motion a frame is worth: control points, order and symbols chosen by the bits they save."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from dfcgs_codec.bitstream.constants import Attribute
from dfcgs_codec.bitstream.motion_header import MotionHeader
from dfcgs_codec.codec.binding import Binding
from dfcgs_codec.codec.compensation import Carried, GofMotion
from dfcgs_codec.codec.dpb import FrameState
from dfcgs_codec.codec.motion import MotionSymbols, classify_modes, code_motion
from dfcgs_codec.codec.motion_field import level_starts
from dfcgs_codec.encoder.analysis import Planes, moved_rows
from dfcgs_codec.encoder.motion_estimation import Moments, MotionQuantiser, ancestors_of, measure, trusted
from dfcgs_codec.encoder.motion_judge import MotionJudge
from dfcgs_codec.encoder.position_grid import far_ones
from dfcgs_codec.encoder.streams import Streams
from dfcgs_codec.model.context_model import ContextModel
from dfcgs_codec.transform.rotation import STEREO_ONE

Int64 = npt.NDArray[np.int64]
Float64 = npt.NDArray[np.float64]
Bool = npt.NDArray[np.bool_]

#: translations are this share of the position step, so that their rounding does not show
TRANSLATION_SHARE = 1 / 8
#: motion symbols of less than this many steps are zero
_ZERO_BIN = 0.55
#: quarters of the last habits that are tried
_TEMPORAL_WEIGHTS = (0, 3)
#: Gaussians that motion is measured on at first, about, to see who goes elsewhere
_FIRST_MEASURED = 49_152
#: fewer control points are tried until they cost this much more than the best
_GIVE_UP = 1.02
#: frames after which all is tried again
_SEARCH_PERIOD = 8
#: and when what was best costs this many times what it did
_MUCH_WORSE = 1.3
#: bits of motion count by this much: what is learnt from it makes that of later frames cheaper
_MOTION_SHARE = 0.6
#: bits that a Gaussian costs which stands still, but is carried along and has to be brought back
_BRING_BACK_BITS = 8.0


@dataclass(frozen=True)
class MotionHint:
    """The header that was best in the frame before, its bits, and how many frames ago all was tried."""

    header: MotionHeader
    bits: float
    age: int


@dataclass(frozen=True)
class MotionTask:
    """A frame to be moved to: the GoF's motion so far, reference, target, who `changed` (N,), the steps.

    `multipliers`: by what 256ths the steps of each Gaussian are coarser, (N, 1), where they are not one;
    `is_forced`: whether it moves, even where that does not pay; `hint`: what was best in the frame before;
    `has_residual`: whether one follows; `model`: the frozen prior of the sequence.
    """

    motion: GofMotion
    reference: FrameState
    target: Planes
    changed: Bool
    steps: dict[Attribute, int]
    block_log2: int
    multipliers: Mapping[Attribute, Int64] = field(default_factory=dict)
    is_forced: bool = False
    hint: MotionHint | None = None
    has_residual: bool = True
    model: ContextModel | None = None


@dataclass(frozen=True)
class MotionTrial:
    """A frame's motion as it would be coded; `saved` is the share of bits that it seems to save."""

    header: MotionHeader
    symbols: MotionSymbols
    carried: Carried
    saved: float
    hint: MotionHint | None = None


@dataclass(frozen=True)
class _Candidate:
    header: MotionHeader
    control: Int64
    bits: float


def motion_steps(task: MotionTask) -> tuple[int, int]:
    """Steps of translations, and of turn vectors that displace a Gaussian at the usual distance as much."""
    step = max(1, int(task.steps[Attribute.POSITION] * TRANSLATION_SHARE))
    pivots, ranks = task.motion.field.pivots, task.motion.binding.gathering.ranks
    apart = np.linalg.norm(pivots[ranks[0, ::16]] - pivots[ranks[3, ::16]], axis=1)
    # a turn vector of length v turns by about 4 v
    turn = step / (4 * (np.median(apart) + 1.0))
    return step, max(1, int(min(turn, 1 / 16) * STEREO_ONE))


def _control_bytes(task: MotionTask, header: MotionHeader, control: Int64) -> int:
    """Bytes of the control points' symbols."""
    streams, motion = Streams(), task.motion
    symbols = replace(motion.history(task.block_log2), control=control)
    code_motion(
        streams.next,
        symbols,
        motion.history(task.block_log2),
        motion.shape(header, task.block_log2, task.model),
    )
    return len(streams.finish()[1])


class _Search:
    """Tries motions of a frame: real bytes of the motion, estimated bits of the residual."""

    def __init__(self, task: MotionTask) -> None:
        self._task = task
        #: frames since all was tried; before any motion not all could be
        self.age = 0 if task.motion.symbols.control.any() else _SEARCH_PERIOD
        self._judge = MotionJudge(
            task.motion,
            task.reference,
            task.target,
            task.changed,
            task.steps,
            task.multipliers,
            has_residual=task.has_residual,
        )
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
        header = MotionHeader(field.num_points, 0, *motion_steps(task))
        first = MotionQuantiser(field, measure(*self._paths(some), field.num_points), header, 0.0)
        motion = field.move(header, first).motion
        binding, source, target = self._paths(rows)
        carried = binding.chosen_moves(motion, np.ascontiguousarray(source.T))
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
        ancestors = ancestors_of(field, max(1, header.num_coded))
        moments = self._moments.of_prefix(ancestors, max(1, header.num_coded))
        quantiser = MotionQuantiser(field, moments, header, _ZERO_BIN)
        moved = field.move(header, quantiser)
        num_bytes = _control_bytes(self._task, header, quantiser.symbols)
        bits = self._judge.bits(moved.motion, is_rigid=header.is_rigid) + _MOTION_SHARE * 8 * num_bytes
        return _Candidate(header, quantiser.symbols, bits)

    def candidates(self) -> Iterator[_Candidate]:
        """What was best in the frame before and one thing else, another one each time.

        All, now and then and where that does much worse than it did.
        """
        hint = self._task.hint
        if hint is None or hint.age >= _SEARCH_PERIOD:
            yield from self._search()
            return
        step, turn = motion_steps(self._task)
        last = replace(hint.header, translation_step=step, turn_step=turn if hint.header.is_rigid else 0)
        led = self.attempt(last)
        yield led
        if led.bits > _MUCH_WORSE * hint.bits:
            yield from self._search()
            return
        self.age = hint.age + 1
        starts = level_starts(self._task.motion.field.num_points)[1:]
        coarser = [count for count in starts if count < last.num_coded]
        finer = [count for count in starts if count > last.num_coded]
        others = [
            replace(last, turn_step=0 if last.is_rigid else turn),
            replace(last, temporal_weight=sum(_TEMPORAL_WEIGHTS) - last.temporal_weight),
            *(replace(last, num_coded=count) for count in (coarser[-1:] + finer[:1])),
        ]
        yield self.attempt(others[hint.age % len(others)])

    def _search(self) -> Iterator[_Candidate]:
        """Ever fewer control points, as long as that promises something; then without turns."""
        step, turn = motion_steps(self._task)
        best: _Candidate | None = None
        for count in reversed([0, *level_starts(self._task.motion.field.num_points)[1:]]):
            weights = _TEMPORAL_WEIGHTS if best is None else (best.header.temporal_weight,)
            tried = [self.attempt(MotionHeader(count, weight, step, turn)) for weight in weights]
            yield from tried
            found = min(tried, key=lambda candidate: candidate.bits)
            if best is not None and found.bits > _GIVE_UP * best.bits:
                break
            best = found if best is None or found.bits < best.bits else best
        if best is not None:
            yield self.attempt(replace(best.header, turn_step=0))


def choose_motion(task: MotionTask) -> MotionTrial | None:
    """The motion that saves most bits, or None where none does; somebody must have changed."""
    search = _Search(task)
    best = min(search.candidates(), key=lambda candidate: candidate.bits)
    if best.bits >= search.rest and not task.is_forced:
        return None
    everyone = np.ones(len(task.changed), np.bool_)
    carried = task.motion.carry(best.header, _symbols(task, best.control, everyone), task.reference)
    follows = _followers(task, carried)
    symbols = _symbols(task, best.control, follows)
    carried = carried.only(follows, task.reference)
    saved = 1 - best.bits / search.rest
    hint = MotionHint(best.header, best.bits, search.age)
    return MotionTrial(best.header, symbols, carried, saved, hint)


def _symbols(task: MotionTask, control: Int64, follows: Bool) -> MotionSymbols:
    return MotionSymbols(control, classify_modes(follows, task.block_log2), follows)


def _followers(task: MotionTask, carried: Carried) -> Bool:
    """Who follows: what changed, and of the rest whatever is not worth a flag."""
    moved = np.zeros(len(task.changed), np.bool_)
    for attribute in (Attribute.POSITION, Attribute.ROTATION):
        rows = moved_rows(attribute, task.reference, carried.state)
        if rows is not None:
            moved |= rows
    starts = np.arange(0, len(moved), 1 << task.block_log2)
    size = np.diff(np.append(starts, len(moved)))
    astray = np.add.reduceat((moved & ~task.changed).astype(np.int64), starts)
    changed = np.add.reduceat(task.changed.astype(np.int64), starts)
    share = np.clip(changed / size, 1e-3, 1 - 1e-3)
    flags = -size * (share * np.log2(share) + (1 - share) * np.log2(1 - share))
    is_mixed = (astray * _BRING_BACK_BITS > flags) & (changed > 0)
    block = np.arange(len(moved)) >> task.block_log2
    return np.where(is_mixed[block], task.changed, (changed > 0)[block])

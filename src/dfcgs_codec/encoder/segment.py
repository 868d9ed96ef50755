"""A run of frames to closed GoFs: the closed loop, and I or P by cost.

A segment starts with an I-frame, so segments can be coded in any order and by any process.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from dfcgs_codec.bitstream.constants import Attribute, IntraKind, OutputOrder
from dfcgs_codec.bitstream.frame_headers import ControlHeader
from dfcgs_codec.bitstream.sequence_header import SequenceHeader
from dfcgs_codec.codec.dpb import output
from dfcgs_codec.codec.inter import InterSymbols, nonzero_rows
from dfcgs_codec.codec.verbatim import state_of
from dfcgs_codec.encoder.analysis import (
    Planes,
    ZeroBin,
    inter_symbols,
    intra_symbols,
    order_of,
    plan_grid,
)
from dfcgs_codec.encoder.canonical import AxisNames, choose_axis_names
from dfcgs_codec.encoder.frame_coding import (
    CodedFrame,
    code_inter_frame,
    code_intra_frame,
    code_verbatim_frame,
)
from dfcgs_codec.encoder.motion_choice import MotionTask, MotionTrial, choose_motion
from dfcgs_codec.encoder.options import EncoderOptions, MotionMode
from dfcgs_codec.encoder.rate_control import Quantisation
from dfcgs_codec.encoder.report import EncodeReport, FrameRecord
from dfcgs_codec.encoder.targets import Targets, ordered, wide_planes
from dfcgs_codec.encoder.triage import is_tracked
from dfcgs_codec.gaussians import GaussianCloud
from dfcgs_codec.sequence import FrameSource
from dfcgs_codec.transform.rotation import round_divide

Int64 = npt.NDArray[np.int64]

#: log2 of the Gaussians in a significance block
BLOCK_LOG2 = 6
#: a P-frame that costs more than this share of the last I-frame has an I-frame tried beside it
_TRY_INTRA_SHARE = 0.7
#: motion that seems to save less than this share of the bits is compared with none for real
_SURE_SHARE = 0.15


@dataclass(frozen=True)
class SequencePlan:
    """What is settled before the first frame is coded; `anchors[i]` is the first frame of frame i's run."""

    header: SequenceHeader
    quantisation: Quantisation
    options: EncoderOptions
    anchors: list[int]


@dataclass(frozen=True)
class CodedGof:
    """A closed GoF: its first frame and the chunks of each of its frames."""

    first_frame: int
    frames: list[bytes] = field(default_factory=list)


@dataclass
class CodedSegment:
    """GoFs of a run of frames and what was measured on them."""

    gofs: list[CodedGof] = field(default_factory=list)
    report: EncodeReport = field(default_factory=EncodeReport)


@dataclass(frozen=True)
class _Anchor:
    """Where a tracked run got its order and axis names from."""

    cloud: GaussianCloud
    rank: Int64
    names: AxisNames | None


@dataclass(frozen=True)
class _Gof:
    """What holds for the GoF being coded: order of its Gaussians and their axis names."""

    order: Int64
    names: AxisNames | None


@dataclass(frozen=True)
class _Loop:
    """The closed loop after a frame: what was coded, what it should have been, and from which input."""

    coded: CodedFrame
    gof: _Gof
    target: Planes
    cloud: GaussianCloud
    intra_bytes: int


class SegmentEncoder:
    """Codes segments of one sequence; keeps the last anchor."""

    def __init__(self, source: FrameSource, plan: SequencePlan) -> None:
        self._source = source
        self._plan = plan
        self._targets = Targets(plan.header.unit_exponents)
        self._anchors: dict[int, _Anchor] = {}

    def encode(self, start: int, stop: int) -> CodedSegment:
        """Frames start..stop - 1."""
        segment = CodedSegment()
        loop: _Loop | None = None
        for index in range(start, stop):
            cloud, notes = self._source.read(index)
            segment.report.notes += notes
            loop = self._next(index, cloud, loop)
            if loop.coded.kind == "I":
                segment.gofs.append(CodedGof(index))
            segment.gofs[-1].frames.append(loop.coded.data)
            self._record(segment, index, loop)
        return segment

    def _next(self, index: int, cloud: GaussianCloud, before: _Loop | None) -> _Loop:
        """P or I, whichever is smaller; I is tried only where P is large or cannot be."""
        planes = self._targets.planes(cloud)
        inter = None
        if before is not None and is_tracked(before.cloud, cloud):
            inter = self._inter(index, (cloud, planes), before)
            if len(inter.coded.data) <= _TRY_INTRA_SHARE * before.intra_bytes:
                return inter
        intra = self._intra(index, cloud, planes)
        if inter is not None and len(inter.coded.data) <= len(intra.coded.data):
            return inter
        return intra

    def _target(self, planes: Planes, gof: _Gof) -> Planes:
        renamed = planes if gof.names is None else gof.names.rename(planes)
        return ordered(renamed, gof.order)

    def _inter(self, index: int, frame: tuple[GaussianCloud, Planes], before: _Loop) -> _Loop:
        cloud, planes = frame
        target = self._target(planes, before.gof)
        trial = self._motion(target, before)
        coded = self._code_inter(index, target, before, trial)
        if trial is not None and trial.saved < _SURE_SHARE and self._plan.options.motion == MotionMode.AUTO:
            rest = self._code_inter(index, target, before, None)
            coded = min(coded, rest, key=lambda found: len(found.data))
        return _Loop(coded, before.gof, target, cloud, before.intra_bytes)

    def _code_inter(self, index: int, target: Planes, before: _Loop, trial: MotionTrial | None) -> CodedFrame:
        quantisation, options = self._plan.quantisation, self._plan.options
        reference = before.coded.state
        coding = (quantisation, ZeroBin(options.zero_bin), BLOCK_LOG2)
        states = (reference, reference if trial is None else trial.carried.state)
        symbols = InterSymbols()
        if options.motion != MotionMode.ONLY:
            symbols = inter_symbols(target, before.target, states, coding)
        return code_inter_frame(index, symbols, before.coded, (quantisation.steps, BLOCK_LOG2), trial)

    def _motion(self, target: Planes, before: _Loop) -> MotionTrial | None:
        mode = self._plan.options.motion
        if mode == MotionMode.OFF:
            return None
        moving = (Attribute.POSITION, Attribute.ROTATION)
        changed = np.logical_or(*(nonzero_rows(target[a] - before.target[a]) for a in moving))
        if not changed.any():
            return None
        steps, forced = self._plan.quantisation.steps, mode in (MotionMode.ON, MotionMode.ONLY)
        coded = before.coded
        return choose_motion(
            MotionTask(coded.motion(), coded.state, target, changed, steps, BLOCK_LOG2, forced)
        )

    def _intra(self, index: int, cloud: GaussianCloud, planes: Planes) -> _Loop:
        options, steps = self._plan.options, self._plan.quantisation.steps
        anchor = self._anchor(index)
        tracked = is_tracked(anchor.cloud, cloud)
        indices = round_divide(planes[Attribute.POSITION], steps[Attribute.POSITION])
        grid = plan_grid(indices)
        order = order_of(indices, grid)
        permutation = self._permutation(order, anchor if tracked else None)
        if options.intra == IntraKind.PLY:
            state = state_of(cloud.take(order), self._plan.header.unit_exponents)
            coded = code_verbatim_frame(index, state, permutation, self._control())
            return _Loop(coded, _Gof(order, None), wide_planes(state), cloud, len(coded.data))
        names = None
        if not options.keep_axes:
            names = anchor.names if tracked else choose_axis_names(planes)
        gof = _Gof(order, names)
        target = self._target(planes, gof)
        coded = code_intra_frame(
            index, intra_symbols(target, steps, permutation), grid, steps, self._control()
        )
        return _Loop(coded, gof, target, cloud, len(coded.data))

    def _control(self) -> ControlHeader:
        options, step = self._plan.options, self._plan.quantisation.steps[Attribute.POSITION]
        return ControlHeader(options.control_rule, options.control_spacing, step.bit_length() - 1)

    def _permutation(self, order: Int64, anchor: _Anchor | None) -> Int64 | None:
        """Place in the output of each Gaussian in GoF order; None where that is the GoF order."""
        kind = self._plan.options.order
        if kind == OutputOrder.INPUT:
            places = order
        elif kind == OutputOrder.SEQUENCE and anchor is not None:
            places = anchor.rank[order]
        else:
            return None
        return None if np.array_equal(places, np.arange(len(places))) else places

    def _anchor(self, index: int) -> _Anchor:
        first = self._plan.anchors[index]
        if first not in self._anchors:
            cloud, _ = self._source.read(first)
            planes = self._targets.planes(cloud)
            step = self._plan.quantisation.steps[Attribute.POSITION]
            indices = round_divide(planes[Attribute.POSITION], step)
            rank = np.empty(len(indices), np.int64)
            rank[order_of(indices, plan_grid(indices))] = np.arange(len(indices))
            self._anchors = {first: _Anchor(cloud, rank, choose_axis_names(planes))}
        return self._anchors[first]

    def _record(self, segment: CodedSegment, index: int, loop: _Loop) -> None:
        """Measure the frame's errors as a decoder will have it, against the input under its axis names."""
        names, frame = loop.gof.names, loop.coded
        source = loop.cloud if names is None else names.rename_cloud(loop.cloud)
        decoded = output(replace(frame.state, order=None), self._plan.header.unit_exponents)
        number = self._source.numbers[index]
        record = FrameRecord(number, frame.kind, source.num_gaussians, len(frame.data))
        segment.report.add_frame(record, source.take(loop.gof.order), decoded)

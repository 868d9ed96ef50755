"""A run of frames to closed GoFs: the closed loop, and I or P by cost.

A segment starts with an I-frame, so segments can be coded in any order and by any process.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from dfcgs_codec.bitstream.constants import Attribute, IntraKind, OutputOrder
from dfcgs_codec.bitstream.sequence_header import SequenceHeader
from dfcgs_codec.codec.dpb import output
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
from dfcgs_codec.encoder.options import EncoderOptions
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


@dataclass(frozen=True)
class SequencePlan:
    """What is settled before the first frame is coded; `anchors[i]` is the first frame of frame i's run."""

    header: SequenceHeader
    quantisation: Quantisation
    options: EncoderOptions
    anchors: list[int]


@dataclass(frozen=True)
class CodedGof:
    """A closed GoF: its first frame, its frames, its chunks."""

    first_frame: int
    num_frames: int
    data: bytes


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
        frames: list[bytes] = []
        first = start
        cloud = before_cloud = None
        gof: _Gof | None = None
        coded: CodedFrame | None = None
        before: Planes = {}
        intra_bytes = 0
        for index in range(start, stop):
            cloud, notes = self._source.read(index)
            segment.report.notes += notes
            planes = self._targets.planes(cloud)
            attempt = None
            if (
                coded is not None
                and gof is not None
                and before_cloud is not None
                and is_tracked(before_cloud, cloud)
            ):
                target = self._target(planes, gof)
                attempt = self._inter(index, (target, before), coded)
                before = target
            if attempt is None or len(attempt.data) > _TRY_INTRA_SHARE * intra_bytes:
                fresh, fresh_gof, fresh_target = self._intra(index, cloud, planes)
                if attempt is None or len(fresh.data) < len(attempt.data):
                    if frames:
                        segment.gofs.append(CodedGof(first, len(frames), b"".join(frames)))
                    frames, first = [], index
                    attempt, gof, before = fresh, fresh_gof, fresh_target
                    intra_bytes = len(fresh.data)
            coded, before_cloud = attempt, cloud
            frames.append(coded.data)
            assert gof is not None
            self._record(segment, index, cloud, (coded, gof))
        segment.gofs.append(CodedGof(first, len(frames), b"".join(frames)))
        return segment

    def _target(self, planes: Planes, gof: _Gof) -> Planes:
        renamed = planes if gof.names is None else gof.names.rename(planes)
        return ordered(renamed, gof.order)

    def _inter(self, index: int, targets: tuple[Planes, Planes], before: CodedFrame) -> CodedFrame:
        quantisation = self._plan.quantisation
        coding = (quantisation, ZeroBin(self._plan.options.zero_bin), BLOCK_LOG2)
        symbols = inter_symbols(*targets, before.state, coding)
        return code_inter_frame(index, symbols, before, (quantisation.steps, BLOCK_LOG2))

    def _intra(self, index: int, cloud: GaussianCloud, planes: Planes) -> tuple[CodedFrame, _Gof, Planes]:
        options, steps = self._plan.options, self._plan.quantisation.steps
        anchor = self._anchor(index)
        tracked = is_tracked(anchor.cloud, cloud)
        indices = round_divide(planes[Attribute.POSITION], steps[Attribute.POSITION])
        grid = plan_grid(indices)
        order = order_of(indices, grid)
        permutation = self._permutation(order, anchor if tracked else None)
        if options.intra == IntraKind.PLY:
            gof = _Gof(order, None)
            state = state_of(cloud.take(order), self._plan.header.unit_exponents)
            return code_verbatim_frame(index, state, permutation), gof, wide_planes(state)
        names = None
        if not options.keep_axes:
            names = anchor.names if tracked else choose_axis_names(planes)
        gof = _Gof(order, names)
        target = self._target(planes, gof)
        symbols = intra_symbols(target, steps, permutation)
        return code_intra_frame(index, symbols, grid, steps), gof, target

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

    def _record(
        self, segment: CodedSegment, index: int, cloud: GaussianCloud, coded: tuple[CodedFrame, _Gof]
    ) -> None:
        """Measure the frame's errors as a decoder will have it, against the input under its axis names."""
        frame, gof = coded
        source = cloud if gof.names is None else gof.names.rename_cloud(cloud)
        decoded = output(replace(frame.state, order=None), self._plan.header.unit_exponents)
        number = self._source.numbers[index]
        record = FrameRecord(number, frame.kind, cloud.num_gaussians, len(frame.data))
        segment.report.add_frame(record, source.take(gof.order), decoded)

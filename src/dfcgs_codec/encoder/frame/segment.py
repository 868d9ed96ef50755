"""A run of frames to closed GoFs: the closed loop, and I or P by cost.

A segment starts with an I-frame, so segments can be coded in any order and by any process.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from functools import partial

import numpy as np

from dfcgs_codec.array_types import Float64, Int64
from dfcgs_codec.bitstream.constants import Attribute, IntraKind, OutputOrder, Profile
from dfcgs_codec.bitstream.escapes import Escapes
from dfcgs_codec.codec.frame.gof_state import GofState
from dfcgs_codec.codec.residual.classes import InterSymbols
from dfcgs_codec.encoder.frame.error_meter import ErrorMeter
from dfcgs_codec.encoder.frame.finer_steps import FinerSteps
from dfcgs_codec.encoder.frame.frame_coding import (
    coded_empty,
    coded_inter,
    coded_intra,
    coded_verbatim,
)
from dfcgs_codec.encoder.frame.off_grid import Grids, in_gof_order
from dfcgs_codec.encoder.frame.reference import (
    CodedGof,
    CodedReference,
    CodedSegment,
    InputFrame,
    RunStart,
    check_announced,
)
from dfcgs_codec.encoder.frame.report import FrameRecord
from dfcgs_codec.encoder.frame.targets import Targets, ordered, wide_planes
from dfcgs_codec.encoder.images.shown import Shown
from dfcgs_codec.encoder.intra.turn_choice import settled_names
from dfcgs_codec.encoder.matching.canonical import AxisNames
from dfcgs_codec.encoder.matching.identity import Members, Succession, found_members, is_tracked, same_members
from dfcgs_codec.encoder.paper.latent_coding import CARRIED, LatentCoder
from dfcgs_codec.encoder.plan.allocation import Placing
from dfcgs_codec.encoder.plan.plan import SequencePlan
from dfcgs_codec.encoder.plan.tuning import MotionMode
from dfcgs_codec.encoder.residual.appearing import ColourSteps, differing_rows
from dfcgs_codec.encoder.residual.inter_coding import Births, InterCoder, InterTask
from dfcgs_codec.encoder.residual.quantise import Planes
from dfcgs_codec.gaussians import GaussianCloud
from dfcgs_codec.model.registry import latent_model
from dfcgs_codec.sequence import FrameSource

#: a P-frame that costs more than this share of the last I-frame has an I-frame tried beside it
_TRY_INTRA_SHARE = 0.7


class SegmentEncoder:
    """Codes segments of one sequence; keeps the last anchor."""

    def __init__(self, source: FrameSource, plan: SequencePlan) -> None:
        self._source = source
        self._plan = plan
        self._shown = Shown(source, plan.region, plan.anchors, plan.seen)
        self._grids = Grids(plan.header.unit_exponents)
        self._targets = Targets(plan.header.unit_exponents.from_origin)
        self._inter_coder = InterCoder(plan)
        self._latent_coder: LatentCoder | None = None
        if plan.header.profile == Profile.PAPER:
            self._latent_coder = LatentCoder(plan, latent_model(plan.header.model_id))
        self._finer = FinerSteps(plan)
        self._meter = ErrorMeter(plan.header.unit_exponents)
        self._before: GaussianCloud | None = None
        self._anchors: dict[int, RunStart] = {}
        self._names: dict[int, AxisNames] = {}

    def encode(self, start: int, stop: int, on_frame: Callable[[], None] | None = None) -> CodedSegment:
        """Frames start..stop - 1; calls `on_frame` after each."""
        # what is remembered from frame to frame begins anew: bytes do not depend on who coded what
        self._inter_coder, self._before = InterCoder(self._plan), None
        self._finer = FinerSteps(self._plan)
        segment = CodedSegment()
        loop: CodedReference | None = None
        measured: Future[None] | None = None
        # a frame is read while the one before is coded, and the one before that is measured
        with ThreadPoolExecutor(2) as beside:
            ahead = beside.submit(self._read, start)
            for index in range(start, stop):
                frame = ahead.result()
                if index + 1 < stop:
                    ahead = beside.submit(self._read, index + 1)
                segment.report.notes += frame.notes
                loop = self._escaped(self._next(index, frame, loop), frame.escapes)
                segment.report.held_frames += loop.is_held
                if frame.escapes is not None:
                    segment.report.num_escapes += len(frame.escapes)
                    segment.report.escaped_frames += 1
                if loop.coded.kind == "I":
                    self._finer.begin(loop)
                    segment.gofs.append(CodedGof(index))
                segment.report.behind.append(self._finer.level)
                segment.gofs[-1].frames.append(loop.coded.data)
                if measured is not None:
                    measured.result()
                measured = beside.submit(self._record, segment, index, frame.original, loop)
                if on_frame is not None:
                    on_frame()
            if measured is not None:
                measured.result()
        return segment

    def _read(self, index: int) -> InputFrame:
        original, notes = self._source.read(index)
        check_announced(self._source, index, original, self._plan.header.sh_degree)
        seen = self._shown.of(index, original)
        original = seen.of(original)
        cloud, escapes = self._grids.split(original, self._before)
        self._before = cloud
        return InputFrame(original, cloud, self._targets.planes(cloud), escapes, notes, seen.cover)

    def _next(self, index: int, frame: InputFrame, before: CodedReference | None) -> CodedReference:
        """P or I, whichever is smallest; I is tried only where P is large or cannot be."""
        cloud, planes = frame.cloud, frame.planes
        if not cloud.num_gaussians:
            return self._empty(index, cloud, planes, before)
        found: list[CodedReference] = []
        limit = 0.0
        if before is not None and before.cloud.num_gaussians:
            limit = _TRY_INTRA_SHARE * before.intra_bytes
            if is_tracked(before.cloud, cloud):
                found.append(self._inter(index, frame, before, same_members(before.members)))
            if self._latent_coder is None and (not found or len(found[0].coded.data) > limit):
                succession = found_members(before.members, before.cloud, cloud, before.moved)
                if succession is not None:
                    found.append(self._inter(index, frame, before, succession))
        if not found or min(len(loop.coded.data) for loop in found) > limit:
            found.append(self._intra(index, frame))
        best = min(found, key=lambda loop: len(loop.coded.data))
        free = self._plan.options.tuning.motion in (MotionMode.AUTO, MotionMode.OFF)
        if before is None or best.succession is None or best.coded.kind != "P" or not free:
            return best
        fresh = None if best.colours is None else self._fresh(best.coded.state)
        if (
            fresh is not None
            and best.colours is not None
            and best.colours.are_behind(best.coded.state, fresh)
        ):
            return self._intra(index, frame)
        again = partial(self._inter, index, frame, before, best.succession)
        return self._finer.good_enough(index, best, again, before.intra_bytes) or self._intra(index, frame)

    def _fresh(self, state: GofState) -> Int64 | None:
        """Steps (N,) of colours in an I-frame in place of the frame that left `state`, if they follow it."""
        steps = self._inter_coder.slack(state).get(Attribute.SH_DC)
        return None if steps is None else steps[:, 0]

    def _inter(
        self, index: int, frame: InputFrame, before: CodedReference, succession: Succession
    ) -> CodedReference:
        cloud, planes = frame.cloud, frame.planes
        members, kept = succession.members, succession.kept
        state = before.coded.state
        births = self._inter_coder.births(succession, frame, state)
        if births is not None:
            state = state.survivors(kept)
        target_before = before.target if succession.all_survive else ordered(before.target, kept)
        same = (before.planes, before.target) if members is before.members else None
        target = members.target(planes, same)
        task = InterTask(index, target, target_before, state, before.coded.state, births)
        held = False
        if self._latent_coder is not None:
            coded = self._latent_coder.code(index, task.target, task.before, state)
            held = any((task.target[a] != task.before[a]).any() for a in task.target if a not in CARRIED)
        else:
            coded = self._inter_coder.code(task, self._finer.octaves)
        unit = 2.0**self._plan.header.unit_exponents.position
        went = task.target[Attribute.POSITION] - task.before[Attribute.POSITION]
        moved: Float64 = went.astype(np.float64) * unit
        if births is not None and coded.source is not None:
            source = coded.source
            born = self._settled_births(births, coded.state, source)
            members = members.merge(born, source)
            came = births.target if born is births.members else born.target(planes)
            target = {a: np.concatenate([v, came[a]])[source] for a, v in target.items()}
            unknown = np.full((len(births), 3), np.nan)
            moved = np.concatenate([moved, unknown])[source]
        found = CodedReference(coded, members, target, cloud, planes, before.intra_bytes, moved, held)
        if self._latent_coder is not None:
            return found
        found = replace(found, succession=succession)
        fresh = None if before.colours is None else self._fresh(coded.state)
        if fresh is None or before.colours is None:
            return found
        differs = differing_rows(task.target[Attribute.SH_DC], task.before[Attribute.SH_DC])
        return replace(found, colours=before.colours.after(kept, differs, fresh, coded.source))

    def _settled_births(self, births: Births, state: GofState, source: Int64) -> Members:
        """Those that came, under the axis names that their coding gives them."""
        names = births.members.names
        if names is None:
            return births.members
        count = len(births)
        places = np.argsort(source, kind="stable")[len(source) - count :]
        decoded = state.frame.planes[Attribute.ROTATION].wide()[places]
        names = settled_names(names, births.target[Attribute.ROTATION], decoded)
        return Members(births.members.rows, names)

    def _empty(
        self, index: int, cloud: GaussianCloud, planes: Planes, before: CodedReference | None
    ) -> CodedReference:
        if before is not None and not before.cloud.num_gaussians:
            repeated = coded_inter(self._plan.writer(index), InterSymbols(), before.coded.state, ({}, {}))
            return replace(before, coded=repeated)
        coded = coded_empty(self._plan.writer(index))
        return CodedReference(
            coded, Members(np.zeros(0, np.int64), None), planes, cloud, planes, len(coded.data)
        )

    def _escaped(self, loop: CodedReference, escapes: Escapes | None) -> CodedReference:
        if loop.coded.state.frame.verbatim is not None:
            return loop
        if escapes is not None:
            escapes = in_gof_order(escapes, loop.members.rows)
        return replace(loop, coded=loop.coded.with_escapes(escapes))

    def _intra(self, index: int, frame: InputFrame) -> CodedReference:
        cloud, planes = frame.cloud, frame.planes
        anchor, first = self._anchor(index), self._plan.anchors[index]
        tracked = is_tracked(anchor.cloud, cloud)
        placing = anchor.placing if tracked else Placing.of(planes, self._plan, frame.cover)
        order, grid = placing.intra.order(planes[Attribute.POSITION])
        permutation = self._permutation(order, anchor if tracked else None)
        if self._plan.options.intra == IntraKind.PLY:
            exact = frame.original.take(order).as_float32()
            coded = coded_verbatim(self._plan.writer(index), exact, permutation, self._plan.control)
            target = wide_planes(coded.state.frame)
            return CodedReference(coded, Members(order, None), target, cloud, planes, len(coded.data))
        is_first = not tracked or index == first
        names = (placing.names if is_first else self._settled(first, anchor)).take(order)
        target = Members(order, names).target(planes)
        zero_bin = self._plan.options.tuning.intra_zero_bin
        wanted = placing.intra.target(target, (order, grid), self._plan.quantisation, zero_bin)
        wanted = replace(wanted, permutation=permutation, keeps_names=not is_first)
        coded = coded_intra(self._plan.writer(index), wanted, self._plan.control)
        self._inter_coder.begin(placing.intra.steps)
        decoded = coded.state.frame.planes[Attribute.ROTATION].wide()
        names = settled_names(names, target[Attribute.ROTATION], decoded)
        if index == first:
            self._names = {first: names.take(np.argsort(order))}
        members = Members(order, names)
        found = CodedReference(coded, members, members.target(planes), cloud, planes, len(coded.data))
        if self._latent_coder is not None:
            return found
        fresh = self._fresh(coded.state)
        colours = None if fresh is None else ColourSteps(fresh)
        return replace(found, colours=colours, intra_steps=placing.intra.steps)

    def _settled(self, first: int, anchor: RunStart) -> AxisNames:
        """Axis names, in input order, of the first frame of a run: those that its I-frame gives them."""
        if first not in self._names:
            planes = Targets(self._plan.header.unit_exponents.from_origin).planes(anchor.cloud)
            self._intra(first, InputFrame(anchor.cloud, anchor.cloud, planes, None, []))
        return self._names[first]

    def _permutation(self, order: Int64, anchor: RunStart | None) -> Int64 | None:
        """Place in the output of each Gaussian in GoF order; None where that is the GoF order."""
        kind = self._plan.options.order
        if kind == OutputOrder.INPUT:
            places = order
        elif kind == OutputOrder.SEQUENCE and anchor is not None:
            places = anchor.rank[order]
        else:
            return None
        return None if np.array_equal(places, np.arange(len(places))) else places

    def _anchor(self, index: int) -> RunStart:
        first = self._plan.anchors[index]
        if first not in self._anchors:
            start = self._source.read(first)[0]
            seen = self._shown.of(first, start)
            cloud, _ = self._grids.split(seen.of(start))
            planes = Targets(self._plan.header.unit_exponents.from_origin).planes(cloud)
            placing = Placing.of(planes, self._plan, seen.cover)
            rank = np.empty(cloud.num_gaussians, np.int64)
            rank[placing.intra.order(planes[Attribute.POSITION])[0]] = np.arange(len(rank))
            self._anchors = {first: RunStart(cloud, rank, placing)}
        return self._anchors[first]

    def _record(
        self, segment: CodedSegment, index: int, original: GaussianCloud, loop: CodedReference
    ) -> None:
        frame, number = loop.coded, self._source.numbers[index]
        record = FrameRecord(number, frame.kind, loop.cloud.num_gaussians, len(frame.data))
        errors = self._meter.measure(original, loop.members, loop.target, frame.state.frame)
        segment.report.add_frame(record, errors)

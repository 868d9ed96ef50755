"""What is settled before the first frame is coded: grids, steps, who shows, the QP of a quality."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from dfcgs_codec.bitstream.constants import LEVELS, MAX_CONTROL_POINTS, MODEL_HASH_BYTES, IntraKind, Profile
from dfcgs_codec.bitstream.sequence_header import FrameNumbers, SequenceHeader
from dfcgs_codec.codec.dpb import columns_of
from dfcgs_codec.encoder.lattice import keep_exactly
from dfcgs_codec.encoder.off_grid import Grids
from dfcgs_codec.encoder.options import EncoderOptions
from dfcgs_codec.encoder.patches import patches_nearby
from dfcgs_codec.encoder.placing import balance
from dfcgs_codec.encoder.plan import SequencePlan
from dfcgs_codec.encoder.rate_control import MAX_QP, MIN_QP, expected_qp, plan_quantisation
from dfcgs_codec.encoder.shown import ALL, Region, Seen
from dfcgs_codec.encoder.splats import Splats
from dfcgs_codec.encoder.targets import Targets
from dfcgs_codec.encoder.triage import is_tracked
from dfcgs_codec.errors import InputError
from dfcgs_codec.gaussians import SH_REST_COEFFICIENTS, GaussianCloud
from dfcgs_codec.model.registry import installed
from dfcgs_codec.ply import display_comments
from dfcgs_codec.sequence import FrameSource, sequence_sh_degree

Float64 = npt.NDArray[np.float64]

#: a QP is near enough when the estimate is so near the quality asked for, dB
_NEAR_ENOUGH = 0.25
#: QPs that are tried
_MOST_TRIALS = 4
#: images without cameras are estimated too low, dB: their pixels are as small as the details of the scene
_NEARBY_BIAS = 1.0
#: the share of the error that leaving out Gaussians may make
_LEFT_OUT_SHARE = 0.25
#: a tracked run is looked at in every so many frames
_EVERY = 12


def _level(max_gaussians: int, num_frames: int, control_spacing: int) -> int:
    points = min(max_gaussians // control_spacing, MAX_CONTROL_POINTS)
    for level, limits in LEVELS.items():
        if (
            max_gaussians <= limits.max_gaussians
            and num_frames <= limits.max_frames
            and points <= limits.max_control_points
        ):
            return level
    largest = max(LEVELS.values())
    raise InputError(
        f"{max_gaussians} Gaussians in {num_frames} frames: at most {largest.max_gaussians} in "
        f"{largest.max_frames} can be coded; split the sequence"
    )


def _anchors(counts: list[int]) -> list[int]:
    """First frame of each frame's run of equal counts."""
    anchors: list[int] = []
    for index, count in enumerate(counts):
        anchors.append(anchors[-1] if index and counts[index - 1] == count else index)
    return anchors


def _any_cloud(sh_degree: int) -> GaussianCloud:
    """What a sequence is planned from that has no Gaussians."""
    shapes = ((1, 3), (1, 4), (1, 3), (1,), (1, 3), (1, 3, SH_REST_COEFFICIENTS[sh_degree]))
    return GaussianCloud(*(np.ones(shape, np.float32) for shape in shapes))


def _finite(cloud: GaussianCloud) -> GaussianCloud:
    """The Gaussians all of whose values are finite; any one where there is none."""
    finite = np.ones(cloud.num_gaussians, np.bool_)
    for _, _, values in columns_of(cloud):
        finite &= np.isfinite(values).all(axis=1)
    if finite.all():
        return cloud
    return cloud.take(np.flatnonzero(finite)) if finite.any() else _any_cloud(cloud.sh_degree)


@dataclass(frozen=True)
class _Subject:
    """What is planned from: the `first` frame with Gaussians, as it is read; and what is `seen` of it."""

    source: FrameSource
    options: EncoderOptions
    anchors: list[int]
    first_frame: int
    first: GaussianCloud
    seen: Seen = ALL

    @property
    def cloud(self) -> GaussianCloud:
        """What is coded of the first frame."""
        return self.seen.of(self.first)

    def plan(self, qp: float) -> SequencePlan:
        """With the steps of a QP, not balanced."""
        options, headers = self.options, self.source.headers
        quantisation = plan_quantisation(qp, options.bounds, _finite(self.cloud))
        if options.intra == IntraKind.PLY:
            quantisation = quantisation.with_float32_positions()
        if options.exact and options.profile == Profile.MAIN and options.intra == IntraKind.CODED:
            quantisation = keep_exactly(quantisation, self.source, self.first)
        model = installed(options.model) if options.model else None
        most = max(header.num_gaussians for header in headers)
        header = SequenceHeader(
            profile=options.profile,
            level=_level(most, len(headers), options.control_spacing),
            sh_degree=sequence_sh_degree(headers),
            output_order=options.order,
            frame_rate=(options.frame_rate.numerator, options.frame_rate.denominator),
            frame_numbers=FrameNumbers.of(self.source.numbers),
            unit_exponents=quantisation.units,
            model_id="" if model is None else model.model_id,
            model_hash=b"" if model is None else model.digest[:MODEL_HASH_BYTES],
        )
        comments = display_comments(headers[0].comments)
        return SequencePlan(header, quantisation, options, qp, self.anchors, comments=comments)


def _subject(source: FrameSource, options: EncoderOptions) -> _Subject:
    headers = source.headers
    if not headers:
        raise InputError("no frames to encode")
    counts = [header.num_gaussians for header in headers]
    first_frame = next((index for index, count in enumerate(counts) if count), 0)
    first = source.read(first_frame)[0] if any(counts) else _any_cloud(sequence_sh_degree(headers))
    return _Subject(source, options, _anchors(counts), first_frame, first)


class _Estimator:
    """Estimates the error of a subject's first I-frame at different QPs, in one choice of patches."""

    def __init__(self, subject: _Subject, region: Region | None) -> None:
        self._subject = subject
        self._near, self._patches = np.zeros(0, np.int64), []
        cloud = subject.cloud
        _, escapes = Grids(
            subject.plan(expected_qp(subject.options.qp, subject.options.quality)).header.unit_exponents
        ).split(cloud)
        near = np.arange(cloud.num_gaussians)
        # who lies apart from all others has no say in how these are coded
        self._near = near if escapes is None else np.setdiff1d(near, escapes.rows)
        self._bias = _NEARBY_BIAS if region is None else 0.0
        self._left_out = 0.0 if region is None else region.error
        if len(self._near):
            splats = Splats.of(cloud.take(self._near))
            with np.errstate(all="ignore"):
                self._patches = patches_nearby(splats) if region is None else region.patches(splats)

    def balanced(self, qp: float) -> SequencePlan:
        """Planned with that QP, steps in proportion to what they show, and the PSNR estimated."""
        subject = self._subject
        plan = subject.plan(qp)
        if not self._patches:
            return plan
        on_grid, _ = Grids(plan.header.unit_exponents).split(subject.cloud)
        planes = Targets(plan.header.unit_exponents.from_origin).planes(on_grid.take(self._near))
        cover = None if subject.seen.cover is None else subject.seen.cover[self._near]
        found = balance(plan, planes, self._patches, cover)
        error = found.error + self._left_out
        if error > 0.0:
            plan = replace(plan, estimate=self._bias - 10.0 * float(np.log10(error)))
        if not subject.options.balance:
            return plan
        return replace(plan, quantisation=plan.quantisation.balanced(found.graded, found.inter))

    def planned(self) -> SequencePlan:
        """With the QP asked for, or the one that gives the quality asked for."""
        options = self._subject.options
        qp = expected_qp(options.qp, options.quality)
        plan = self.balanced(qp)
        if options.qp is not None:
            return plan
        for _ in range(_MOST_TRIALS - 1):
            if plan.estimate is None or abs(plan.estimate - options.quality) < _NEAR_ENOUGH:
                break
            better = float(np.clip(qp + (plan.estimate - options.quality), MIN_QP, MAX_QP))
            if better == qp:
                break
            qp, plan = better, self.balanced(better)
        return plan


def _sampled(subject: _Subject) -> Iterator[tuple[int, list[int]]]:
    """Of runs of two frames or more the first frame, and frames in which they are looked at."""
    anchors = subject.anchors
    for first in sorted(set(anchors)):
        run = [index for index, anchor in enumerate(anchors) if anchor == first]
        if len(run) > 1 and subject.source.headers[first].num_gaussians:
            yield first, sorted({*run[::_EVERY], run[-1]})


def _weights(subject: _Subject, region: Region) -> dict[int, tuple[Splats, Float64]]:
    """Of each run: its first frame, and what Gaussians add to images, in its frames the most."""
    found = {}
    for first, frames in _sampled(subject):
        start = subject.source.read(first)[0]
        splats = Splats.of(start)
        weights = region.weights(splats)
        for index in frames[1:]:
            cloud = subject.source.read(index)[0]
            if is_tracked(start, cloud):
                weights = np.maximum(weights, region.later(index).weights(Splats.of(cloud)))
        found[first] = splats, weights
    if subject.first_frame not in found and subject.first.num_gaussians:
        splats = Splats.of(subject.first)
        found[subject.first_frame] = splats, region.weights(splats)
    return found


def _seen_from(subject: _Subject, region: Region) -> tuple[Region, dict[int, Seen]]:
    """The region with the least weight of what is coded, and what of each run is seen."""
    weights = _weights(subject, region)
    options, psnr = subject.options, subject.options.quality
    if options.qp is not None:
        psnr = _Estimator(subject, region).balanced(options.qp).estimate or psnr
    region = region.leaving_out(*weights[subject.first_frame], _LEFT_OUT_SHARE * 10.0 ** (-psnr / 10.0))
    return region, {index: region.seen(found) for index, (_, found) in weights.items()}


def plan_sequence(source: FrameSource, options: EncoderOptions) -> SequencePlan:
    """Header, grids and steps, from the input's headers and its first frame."""
    subject = _subject(source, options)
    if options.views is None or not subject.first.num_gaussians:
        return _Estimator(subject, None).planned()
    positions = _finite(subject.first).positions.astype(np.float64)
    region = Region.of(options.views, options.views_margin, positions, options.keep_unseen)
    region, seen = _seen_from(subject, region)
    subject = replace(subject, seen=seen[subject.first_frame])
    return replace(_Estimator(subject, region).planned(), region=region, seen=seen)

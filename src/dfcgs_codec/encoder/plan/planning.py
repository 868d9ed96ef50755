"""What is settled before the first frame is coded: grids, steps, who shows, the QP of a quality."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from dfcgs_codec.array_types import Float64, Int64
from dfcgs_codec.bitstream.constants import (
    LEVELS,
    MAX_CONTROL_POINTS,
    MODEL_HASH_BYTES,
    Attribute,
    IntraKind,
    Profile,
)
from dfcgs_codec.bitstream.sequence_header import FrameNumbers, SequenceHeader
from dfcgs_codec.codec.state.planes import columns_of
from dfcgs_codec.encoder.frame.off_grid import Grids
from dfcgs_codec.encoder.frame.targets import Targets
from dfcgs_codec.encoder.images.patches import NEARBY_BIAS, PATCHES, Patch, patches_nearby
from dfcgs_codec.encoder.images.shown import ALL, Region, Seen
from dfcgs_codec.encoder.images.splats import Splats, alpha_of
from dfcgs_codec.encoder.plan.allocation import Balance, Look, balanced_plan, intra_errors
from dfcgs_codec.encoder.plan.options import EncoderOptions
from dfcgs_codec.encoder.plan.plan import SequencePlan
from dfcgs_codec.encoder.plan.prequantised_input import keep_exactly, lattices
from dfcgs_codec.encoder.plan.quantiser_steps import (
    MAX_QP,
    MIN_QP,
    QUALITIES,
    REFERENCE_STEPS,
    TYPICAL_QP,
    expected_qp,
    plan_quantisation,
)
from dfcgs_codec.encoder.plan.triage import is_tracked
from dfcgs_codec.errors import InputError
from dfcgs_codec.gaussians import SH_REST_COEFFICIENTS, GaussianCloud
from dfcgs_codec.model.registry import installed
from dfcgs_codec.ply import display_comments
from dfcgs_codec.sequence import FrameSource, sequence_sh_degree

#: a QP is near enough when the estimate is so near the quality asked for, dB
_NEAR_ENOUGH = 0.4
#: a quality is a promise, and estimates are uncertain, the more so the finer: so many dB more are aimed at
#: up to 37 dB, and so many more with each dB beyond
_MARGIN, _MORE_MARGIN = 1.0, 0.1
#: QPs that are tried
_MOST_TRIALS = 4
#: the share of the error that leaving out Gaussians may make
_LEFT_OUT_SHARE = 0.25
#: others show in a frame whose opacities differ by this share of them
_OTHERS = 0.1
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

    @cached_property
    def _lattices(self) -> dict[Attribute, int]:
        return lattices(self.first)

    def looked_at(self) -> list[int]:
        """Frames in which errors are estimated: the first, and those of its run in which others show."""
        run = [index for index, anchor in enumerate(self.anchors) if anchor == self.first_frame]
        later = sorted({run[len(run) // 2], run[-1]} - {self.first_frame})
        return [self.first_frame, *(index for index in later if self._shows_others(index))]

    def frame(self, index: int) -> GaussianCloud:
        """A frame that is looked at."""
        return self.first if index == self.first_frame else self.source.read(index)[0]

    def _shows_others(self, index: int) -> bool:
        """Whether a frame is tracked from the first one and other Gaussians show there."""
        cloud = self.frame(index)
        if not is_tracked(self.first, cloud) or cloud.opacities is self.first.opacities:
            return False
        before, now = alpha_of(self.first.opacities), alpha_of(cloud.opacities)
        return float(np.abs(now - before).sum()) > _OTHERS * float(np.maximum(before.sum(), now.sum()))

    def plan(self, qp: float) -> SequencePlan:
        """With the steps of a QP, not balanced."""
        options, headers = self.options, self.source.headers
        tuning = options.tuning
        codes_main = options.profile == Profile.MAIN and options.intra == IntraKind.CODED
        steps = tuning.reference_steps or REFERENCE_STEPS
        visibility = tuning.visibility and codes_main
        quantisation = plan_quantisation(
            qp, options.bounds, _finite(self.cloud), steps, visibility=visibility
        )
        if options.intra == IntraKind.PLY:
            quantisation = quantisation.with_float32_positions()
        if tuning.exact and codes_main:
            quantisation = keep_exactly(quantisation, self.source, self._lattices, self.first.sh_degree)
        model = installed(options.model)
        most = max(header.num_gaussians for header in headers)
        header = SequenceHeader(
            profile=options.profile,
            level=_level(most, len(headers), options.tuning.control_spacing),
            sh_degree=sequence_sh_degree(headers),
            output_order=options.order,
            frame_rate=(options.frame_rate.numerator, options.frame_rate.denominator),
            frame_numbers=FrameNumbers.of(self.source.numbers),
            unit_exponents=quantisation.units,
            model_id=model.model_id,
            model_hash=model.digest[:MODEL_HASH_BYTES],
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


@dataclass(frozen=True)
class _Trial:
    """A plan that is not balanced yet, and what was `found` of its errors when it was looked at."""

    plan: SequencePlan
    looks: list[Look]
    found: Balance


@dataclass(frozen=True)
class _View:
    """A frame as it is looked at: the Gaussians that are coded and lie near others, and patches of them."""

    cloud: GaussianCloud
    cover: Int64 | None
    patches: list[Patch]


class _Estimator:
    """Estimates the error of I-frames at different QPs, in one choice of patches of some frames."""

    def __init__(self, subject: _Subject, region: Region | None) -> None:
        self._subject, self._region = subject, region
        self._left_out = 0.0 if region is None or region.keeps_unseen else region.error
        units = subject.plan(expected_qp(subject.options.qp, subject.options.quality)).header.unit_exponents
        indices = subject.looked_at()
        views = [self._view(index, Grids(units), (part, len(indices))) for part, index in enumerate(indices)]
        self._views = [view for view in views if view.patches]

    def _view(self, index: int, grids: Grids, part: tuple[int, int]) -> _View:
        seen = self._subject.seen
        cloud = seen.of(self._subject.frame(index))
        _, escapes = grids.split(cloud)
        near = np.arange(cloud.num_gaussians)
        # who lies apart from all others has no say in how these are coded
        near = near if escapes is None else np.setdiff1d(near, escapes.rows)
        cloud, patches = cloud.take(near), []
        cover = None if seen.cover is None else seen.cover[near]
        if len(near):
            splats = Splats.of(cloud)
            with np.errstate(all="ignore"):
                if self._region is None:
                    patches = patches_nearby(splats, -(-PATCHES // part[1]), part[0])
                else:
                    patches = self._region.patches(splats, *part)
        return _View(cloud, cover, patches)

    def tried(self, qp: float) -> _Trial:
        """Planned with that QP, and what it leads to."""
        plan = self._subject.plan(qp)
        units, looks = plan.header.unit_exponents, []
        for view in self._views:
            on_grid, _ = Grids(units).split(view.cloud)
            looks.append(Look(Targets(units.from_origin).planes(on_grid), view.cover, view.patches))
        if not looks:
            return _Trial(plan, [], Balance({}, 0.0))
        found = intra_errors(plan, looks)
        error = found.error + self._left_out
        if error > 0.0:
            bias = NEARBY_BIAS if self._region is None else 0.0
            plan = replace(plan, estimate=bias - 10.0 * float(np.log10(error)))
        if self._left_out > 0.0 and found.error > 0.0:
            plan = replace(plan, unseen_cost=10.0 * float(np.log10(error / found.error)))
        return _Trial(plan, looks, found)

    def planned(self) -> SequencePlan:
        """With the QP asked for, or the one that gives the quality asked for."""
        options = self._subject.options
        trial = self.tried(expected_qp(options.qp, options.quality))
        if options.qp is None:
            trial = self._searched(trial, aimed_at(options.quality))
        if not (trial.looks and options.tuning.balance):
            return trial.plan
        return balanced_plan(trial.plan, trial.looks, trial.found)

    def _searched(self, trial: _Trial, psnr: float) -> _Trial:
        """A trial whose estimate is near `psnr`, from the first one on."""
        tried: list[tuple[float, _Trial]] = []
        while trial.plan.estimate is not None:
            tried.append((trial.plan.estimate - psnr, trial))
            error, nearest = min(tried, key=lambda pair: abs(pair[0]))
            better = _better_qp([(more, before.plan.qp) for more, before in tried])
            if abs(error) < _NEAR_ENOUGH or len(tried) == _MOST_TRIALS or better == trial.plan.qp:
                return nearest
            trial = self.tried(better)
        return trial


def aimed_at(quality: float) -> float:
    """The estimate, dB, at which images are about as good as `quality`, or better."""
    return quality + _MARGIN + _MORE_MARGIN * max(quality - QUALITIES["medium"], 0.0)


def _better_qp(tried: Sequence[tuple[float, float]]) -> float:
    """The QP to try next; `tried`: by how many dB estimates are better than what is asked for, and QPs."""
    finer = min((trial for trial in tried if trial[0] >= 0.0), default=None)
    coarser = max((trial for trial in tried if trial[0] < 0.0), default=None)
    if finer is not None and coarser is not None:
        # a few Gaussians that swap places make steps in the curve: between the two it has to be
        return float(np.interp(0.0, [coarser[0], finer[0]], [coarser[1], finer[1]]))
    more, qp = min(tried, key=lambda trial: abs(trial[0]))
    return float(np.clip(qp + more, MIN_QP, MAX_QP))


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
        psnr = _Estimator(subject, region).tried(options.qp).plan.estimate or psnr
    region = region.leaving_out(*weights[subject.first_frame], _LEFT_OUT_SHARE * 10.0 ** (-psnr / 10.0))
    return region, {index: region.seen(found) for index, (_, found) in weights.items()}


def _lossless(subject: _Subject) -> SequencePlan:
    """With steps of P-frames, of which there are none, and a note where float32 is not all of the input."""
    plan, positions = subject.plan(TYPICAL_QP), subject.first.positions
    with np.errstate(over="ignore"):
        is_kept = np.array_equal(positions.astype(np.float32), positions, equal_nan=True)
    note = "positions have more digits than float32 holds: --quality lossless rounds them to float32"
    return replace(plan, quantisation=replace(plan.quantisation, notes=() if is_kept else (note,)))


def plan_sequence(source: FrameSource, options: EncoderOptions) -> SequencePlan:
    """Header, grids and steps, from the input's headers and its first frame."""
    subject = _subject(source, options)
    if options.is_lossless:
        return _lossless(subject)
    if options.views is None or not subject.first.num_gaussians:
        return _Estimator(subject, None).planned()
    positions = _finite(subject.first).positions.astype(np.float64)
    # whoever asks for float32 verbatim wants all of them
    keeps_unseen = options.keep_unseen or options.intra == IntraKind.PLY
    region = Region.of(options.views, options.views_margin, positions, keeps_unseen)
    region, seen = _seen_from(subject, region)
    subject = replace(subject, seen=seen[subject.first_frame])
    return replace(_Estimator(subject, region).planned(), region=region, seen=seen)

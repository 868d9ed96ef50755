"""What a sequence is planned from: its headers, and its first frame with Gaussians."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

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
from dfcgs_codec.encoder.images.shown import ALL, Seen
from dfcgs_codec.encoder.images.splats import alpha_of
from dfcgs_codec.encoder.matching.identity import is_tracked
from dfcgs_codec.encoder.plan.options import EncoderOptions
from dfcgs_codec.encoder.plan.plan import SequencePlan
from dfcgs_codec.encoder.plan.prequantised_input import keep_exactly, lattices
from dfcgs_codec.encoder.plan.quantiser_steps import REFERENCE_STEPS, plan_quantisation
from dfcgs_codec.errors import InputError
from dfcgs_codec.gaussians import SH_REST_COEFFICIENTS, GaussianCloud
from dfcgs_codec.model.registry import installed
from dfcgs_codec.ply import display_comments
from dfcgs_codec.sequence import FrameSource, sequence_sh_degree

#: others show in a frame whose opacities differ by this share of them
_OTHERS = 0.1


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
    anchors: list[int] = []
    for index, count in enumerate(counts):
        anchors.append(anchors[-1] if index and counts[index - 1] == count else index)
    return anchors


def _any_cloud(sh_degree: int) -> GaussianCloud:
    """What a sequence is planned from that has no Gaussians."""
    shapes = ((1, 3), (1, 4), (1, 3), (1,), (1, 3), (1, 3, SH_REST_COEFFICIENTS[sh_degree]))
    return GaussianCloud(*(np.ones(shape, np.float32) for shape in shapes))


def finite(cloud: GaussianCloud) -> GaussianCloud:
    """The Gaussians all of whose values are finite; any one where there is none."""
    finite = np.ones(cloud.num_gaussians, np.bool_)
    for _, _, values in columns_of(cloud):
        finite &= np.isfinite(values).all(axis=1)
    if finite.all():
        return cloud
    return cloud.take(np.flatnonzero(finite)) if finite.any() else _any_cloud(cloud.sh_degree)


@dataclass(frozen=True)
class Subject:
    """What is planned from: the `first` frame with Gaussians, as it is read; and what is `seen` of it."""

    source: FrameSource
    options: EncoderOptions
    anchors: list[int]
    first_frame: int
    first: GaussianCloud
    seen: Seen = ALL

    @staticmethod
    def of(source: FrameSource, options: EncoderOptions) -> Subject:
        """That of a sequence; InputError where there are no frames."""
        headers = source.headers
        if not headers:
            raise InputError("no frames to encode")
        counts = [header.num_gaussians for header in headers]
        first_frame = next((index for index, count in enumerate(counts) if count), 0)
        first = source.read(first_frame)[0] if any(counts) else _any_cloud(sequence_sh_degree(headers))
        return Subject(source, options, _anchors(counts), first_frame, first)

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
        quantisation = plan_quantisation(qp, options.bounds, finite(self.cloud), steps, visibility=visibility)
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

"""What is settled before the first frame is coded: grids, steps, who shows, the QP of a quality."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from dfcgs_codec.array_types import Float64
from dfcgs_codec.bitstream.constants import IntraKind
from dfcgs_codec.encoder.images.shown import Region, Seen
from dfcgs_codec.encoder.images.splats import Splats
from dfcgs_codec.encoder.matching.identity import is_tracked
from dfcgs_codec.encoder.plan.estimator import Estimator
from dfcgs_codec.encoder.plan.options import EncoderOptions
from dfcgs_codec.encoder.plan.plan import SequencePlan
from dfcgs_codec.encoder.plan.quantiser_steps import TYPICAL_QP
from dfcgs_codec.encoder.plan.subject import Subject, finite
from dfcgs_codec.sequence import FrameSource

#: the share of the error that leaving out Gaussians may make
_LEFT_OUT_SHARE = 0.25
#: a tracked run is looked at in every so many frames
_EVERY = 12


def _sampled(subject: Subject) -> Iterator[tuple[int, list[int]]]:
    """Of runs of two frames or more the first frame, and frames in which they are looked at."""
    anchors = subject.anchors
    for first in sorted(set(anchors)):
        run = [index for index, anchor in enumerate(anchors) if anchor == first]
        if len(run) > 1 and subject.source.headers[first].num_gaussians:
            yield first, sorted({*run[::_EVERY], run[-1]})


def _weights(subject: Subject, region: Region) -> dict[int, tuple[Splats, Float64]]:
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


def _seen_from(subject: Subject, region: Region) -> tuple[Region, dict[int, Seen]]:
    """The region with the least weight of what is coded, and what of each run is seen."""
    weights = _weights(subject, region)
    options, psnr = subject.options, subject.options.quality
    if options.qp is not None:
        psnr = Estimator(subject, region).tried(options.qp).plan.estimate or psnr
    region = region.leaving_out(*weights[subject.first_frame], _LEFT_OUT_SHARE * 10.0 ** (-psnr / 10.0))
    return region, {index: region.seen(found) for index, (_, found) in weights.items()}


def _lossless(subject: Subject) -> SequencePlan:
    """With steps of P-frames, of which there are none, and a note where float32 is not all of the input."""
    plan, positions = subject.plan(TYPICAL_QP), subject.first.positions
    with np.errstate(over="ignore"):
        is_kept = np.array_equal(positions.astype(np.float32), positions, equal_nan=True)
    note = "positions have more digits than float32 holds: --quality lossless rounds them to float32"
    return replace(plan, quantisation=replace(plan.quantisation, notes=() if is_kept else (note,)))


def plan_sequence(source: FrameSource, options: EncoderOptions) -> SequencePlan:
    """Header, grids and steps, from the input's headers and its first frame."""
    subject = Subject.of(source, options)
    if options.is_lossless:
        return _lossless(subject)
    if options.views is None or not subject.first.num_gaussians:
        return Estimator(subject, None).planned()
    positions = finite(subject.first).positions.astype(np.float64)
    # whoever asks for float32 verbatim wants all of them
    keeps_unseen = options.keep_unseen or options.intra == IntraKind.PLY
    region = Region.of(options.views, options.views_margin, positions, keeps_unseen)
    region, seen = _seen_from(subject, region)
    subject = replace(subject, seen=seen[subject.first_frame])
    return replace(Estimator(subject, region).planned(), region=region, seen=seen)

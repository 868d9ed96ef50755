"""Encoding a sequence of frames into one file."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path
from typing import BinaryIO

import numpy as np

from dfcgs_codec.bitstream.comments import PlyComments
from dfcgs_codec.bitstream.constants import (
    LEVELS,
    MAX_CONTROL_POINTS,
    MODEL_HASH_BYTES,
    ChunkType,
    IntraKind,
    Profile,
)
from dfcgs_codec.bitstream.container import ContainerWriter
from dfcgs_codec.bitstream.io import ByteWriter
from dfcgs_codec.bitstream.sequence_header import FrameNumbers, SequenceHeader
from dfcgs_codec.codec.dpb import columns_of
from dfcgs_codec.encoder.lattice import keep_exactly
from dfcgs_codec.encoder.off_grid import Grids
from dfcgs_codec.encoder.options import AUTO_GOF_SIZE, PAPER_GOF_SIZE, EncoderOptions
from dfcgs_codec.encoder.parallel import NoWorkers, code_in_parallel
from dfcgs_codec.encoder.placing import balanced_plan
from dfcgs_codec.encoder.plan import SequencePlan
from dfcgs_codec.encoder.proof import prove_written
from dfcgs_codec.encoder.rate_control import plan_quantisation
from dfcgs_codec.encoder.reference import CodedSegment
from dfcgs_codec.encoder.report import EncodeReport
from dfcgs_codec.encoder.segment import SegmentEncoder
from dfcgs_codec.errors import InputError
from dfcgs_codec.files import replace_when_whole
from dfcgs_codec.gaussians import SH_REST_COEFFICIENTS, GaussianCloud
from dfcgs_codec.model.registry import installed
from dfcgs_codec.ply import display_comments
from dfcgs_codec.sequence import FrameSource, notes_of, sequence_sh_degree

#: called with (frames done, frames in all)
Progress = Callable[[int, int], None]


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


def plan_sequence(source: FrameSource, options: EncoderOptions) -> SequencePlan:
    """Header, grids and steps, from the input's headers and its first frame."""
    headers = source.headers
    if not headers:
        raise InputError("no frames to encode")
    counts = [header.num_gaussians for header in headers]
    first_frame = next((index for index, count in enumerate(counts) if count), 0)
    first = source.read(first_frame)[0] if any(counts) else _any_cloud(sequence_sh_degree(headers))
    quantisation = plan_quantisation(options.qp, options.bounds, _finite(first))
    if options.intra == IntraKind.PLY:
        quantisation = quantisation.with_float32_positions()
    if options.exact and options.profile == Profile.MAIN and options.intra == IntraKind.CODED:
        quantisation = keep_exactly(quantisation, source, first)
    model = installed(options.model) if options.model else None
    header = SequenceHeader(
        profile=options.profile,
        level=_level(max(counts), len(counts), options.control_spacing),
        sh_degree=sequence_sh_degree(headers),
        output_order=options.order,
        frame_rate=(options.frame_rate.numerator, options.frame_rate.denominator),
        frame_numbers=FrameNumbers.of(source.numbers),
        unit_exponents=quantisation.units,
        model_id="" if model is None else model.model_id,
        model_hash=b"" if model is None else model.digest[:MODEL_HASH_BYTES],
    )
    comments = display_comments(headers[0].comments)
    plan = SequencePlan(header, quantisation, options, _anchors(counts), first_frame, comments=comments)
    return balanced_plan(plan, *Grids(quantisation.units).split(first))


def _segments(plan: SequencePlan) -> list[tuple[int, int]]:
    """First frame and end of each run that begins with an I-frame."""
    count, size = plan.header.num_frames, plan.options.gof_size
    if size is None and plan.header.profile == Profile.PAPER:
        size = PAPER_GOF_SIZE
    if size is None:
        # of about the same length, so that no I-frame serves a few frames only
        number = -(-count // AUTO_GOF_SIZE)
        bounds = [count * index // number for index in range(number + 1)]
        return list(pairwise(bounds))
    return [(start, min(start + size, count)) for start in range(0, count, size)]


def _coded_segments(
    source: FrameSource, plan: SequencePlan, on_frame: Callable[[], None], notes: list[str]
) -> Iterator[CodedSegment]:
    """Segments in order, coded by this process, which calls `on_frame`, or by `options.jobs` others."""
    segments = _segments(plan)
    if min(plan.options.jobs, len(segments)) > 1:
        try:
            yield from code_in_parallel(source, plan, segments)
        except NoWorkers as reason:
            notes.append(f"coded in one process: {reason}")
        else:
            return
    encoder = SegmentEncoder(source, plan)
    yield from (encoder.encode(*segment, on_frame) for segment in segments)


def _write(
    file: BinaryIO, source: FrameSource, plan: SequencePlan, progress: Progress | None
) -> EncodeReport:
    report = EncodeReport(notes=[*notes_of(source), *plan.quantisation.notes])
    others = {display_comments(header.comments) for header in source.headers} - {plan.comments}
    if others:
        report.notes.append(
            "comments that change how viewers show a frame differ between frames: those of the first are kept"
        )
    writer = ContainerWriter(file, plan.header)
    writer.chunk(ChunkType.ENCODER_INFO, 0, plan.options.describe().encode())
    if plan.comments:
        comments = ByteWriter()
        PlyComments(plan.comments).write(comments)
        writer.chunk(ChunkType.PLY_COMMENTS, 0, comments.getvalue())
    done = 0

    def advance(count: int) -> None:
        nonlocal done
        if progress and count > done:
            progress(count, plan.header.num_frames)
        done = max(done, count)

    for segment in _coded_segments(source, plan, lambda: advance(done + 1), report.notes):
        for gof in segment.gofs:
            writer.gof(gof.first_frame, gof.frames)
        report.merge(segment.report)
        advance(len(report.frames))
    writer.finish()
    if report.held_frames:
        report.notes.append(
            f"profile paper moves and turns Gaussians only: what else changed in {report.held_frames} frames "
            "was left as in the I-frame before"
        )
    if report.num_escapes:
        report.notes.append(
            f"{report.num_escapes} values in {report.escaped_frames} frames lie far from all others, "
            "outside the grids planned from the first frame, or are not finite: they are kept exactly"
        )
    report.num_bytes = writer.size
    return report


def _check_not_input(target: Path, source: FrameSource) -> None:
    """InputError where the output would take the place of a frame."""
    for path in getattr(source, "paths", ()):
        if target.exists() and target.samefile(path):
            raise InputError(f"{target} is one of the frames: name another output")


def encode_frames(
    source: FrameSource,
    target: Path,
    options: EncoderOptions | None = None,
    *,
    force: bool = False,
    progress: Progress | None = None,
) -> EncodeReport:
    """Encode all frames of `source` into the file `target`.

    The file appears under its name only when it is whole; an existing one is kept unless `force`.
    Raises InputError for input that cannot be coded and VerificationError where a bound was not kept.
    """
    _check_not_input(target, source)
    with replace_when_whole(target, force=force) as file:
        plan = plan_sequence(source, options or EncoderOptions())
        report = _write(file, source, plan, progress)
        report.check_bounds(plan.options.bounds)
        prove_written(file, plan.header, report)
    return report

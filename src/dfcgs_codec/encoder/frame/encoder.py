"""Encoding a sequence of frames into one file."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path
from typing import BinaryIO

import numpy as np

from dfcgs_codec.bitstream.comments import PlyComments
from dfcgs_codec.bitstream.constants import ChunkType
from dfcgs_codec.bitstream.container import ContainerWriter
from dfcgs_codec.bitstream.io import ByteWriter
from dfcgs_codec.encoder.frame.proof import prove_written
from dfcgs_codec.encoder.frame.reference import CodedSegment
from dfcgs_codec.encoder.frame.report import EncodeReport
from dfcgs_codec.encoder.frame.segment import SegmentEncoder
from dfcgs_codec.encoder.parallel import NoWorkers, code_in_parallel
from dfcgs_codec.encoder.plan.options import AUTO_GOF_SIZE, EncoderOptions
from dfcgs_codec.encoder.plan.plan import SequencePlan
from dfcgs_codec.encoder.plan.planning import plan_sequence
from dfcgs_codec.errors import InputError
from dfcgs_codec.files import replace_when_whole
from dfcgs_codec.ply import display_comments
from dfcgs_codec.sequence import FrameSource, notes_of

#: called with (frames done, frames in all)
Progress = Callable[[int, int], None]


def _segments(plan: SequencePlan) -> list[tuple[int, int]]:
    """First frame and end of each run that begins with an I-frame."""
    count, size = plan.header.num_frames, plan.options.fixed_gof_size
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
    writer.chunk(ChunkType.ENCODER_INFO, 0, plan.describe().encode())
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
    report.num_unseen, report.unseen_cost_db = plan.num_unseen, plan.unseen_cost
    report.qp = None if plan.options.is_lossless else plan.qp
    if plan.estimate is not None:
        errors = 10.0 ** (np.array(report.behind) / 10.0)
        report.estimated_psnr = plan.estimate - 10.0 * float(np.log10(errors.mean()))
    return report


def _check_not_input(target: Path, source: FrameSource) -> None:
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

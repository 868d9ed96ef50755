"""I or P, GoF borders, anchors: what the encoder decides frame by frame."""

from __future__ import annotations

import numpy as np

from dfcgs_codec import EncoderOptions, GaussianCloud
from dfcgs_codec.encoder.frame.segment import CodedSegment, SegmentEncoder
from dfcgs_codec.encoder.plan.planning import plan_sequence
from dfcgs_codec.sequence import MemorySource
from lab.small_clouds import all_changing, drifting, make_cloud, shuffled, still, untracked


def code(frames: list[GaussianCloud], options: EncoderOptions | None = None) -> CodedSegment:
    source = MemorySource(frames)
    plan = plan_sequence(source, options or EncoderOptions())
    return SegmentEncoder(source, plan).encode(0, len(frames))


def kinds(frames: list[GaussianCloud]) -> str:
    names = {"I": "I", "P": "P", "skip": "s"}
    return "".join(names[frame.kind] for frame in code(frames).report.frames)


def test_still_frames_are_skipped() -> None:
    assert kinds(still(make_cloud(100), 5)) == "Issss"


def test_motion_is_p_frames() -> None:
    assert kinds(drifting(make_cloud(100), 5)) == "IPPPP"
    assert kinds(all_changing(make_cloud(300), 4)) == "IPPP"


def test_a_scene_cut_is_an_i_frame() -> None:
    before, after = make_cloud(200, 0, 1), make_cloud(200, 0, 2)
    assert kinds(still(before, 2) + still(after, 3)) == "IsIss"
    assert kinds(still(before, 2) + still(make_cloud(150), 2)) == "IsIs"


def test_lost_order_is_found_again() -> None:
    cloud = make_cloud(200)
    assert kinds([cloud, cloud, shuffled(cloud), shuffled(cloud)]) == "Isss"


def test_nothing_in_common_is_all_i_frames() -> None:
    assert kinds(untracked(200, 4)) == "IIII"


def test_every_i_frame_begins_a_gof() -> None:
    segment = code(still(make_cloud(50), 2) + still(make_cloud(60, 0, 9), 3))
    assert [(gof.first_frame, len(gof.frames)) for gof in segment.gofs] == [(0, 2), (2, 3)]
    assert [f.num_bytes for f in segment.report.frames] == [
        len(f) for gof in segment.gofs for f in gof.frames
    ]


def test_a_segment_does_not_depend_on_what_was_coded_before() -> None:
    frames = all_changing(make_cloud(80), 8)
    source = MemorySource(frames)
    plan = plan_sequence(source, EncoderOptions(gof_size=4))
    fresh, used = SegmentEncoder(source, plan), SegmentEncoder(source, plan)
    used.encode(0, 4)
    assert [g.frames for g in fresh.encode(4, 8).gofs] == [g.frames for g in used.encode(4, 8).gofs]


def test_reported_errors_are_small_and_not_zero() -> None:
    errors = code(all_changing(make_cloud(200, 1), 4)).report.errors
    assert set(errors) == {"position", "rotation", "scale", "alpha", "colour", "sh"}
    for name, statistics in errors.items():
        # rotations in degrees, those of round Gaussians matter little; the others about one in their units
        assert 0 < statistics.mean <= statistics.maximum < (60 if name == "rotation" else 2)
    assert np.isfinite([s.maximum for s in errors.values()]).all()

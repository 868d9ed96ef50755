from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

from dfcgs_codec import EncoderOptions, encode_sequence
from dfcgs_codec.bitstream.constants import OutputOrder
from dfcgs_codec.encoder.plan.planning import plan_sequence
from dfcgs_codec.errors import InputError
from dfcgs_codec.model.registry import DEFAULT_PRIOR
from dfcgs_codec.ply import PlyHeader
from dfcgs_codec.sequence import MemorySource
from lab.small_clouds import make_cloud, still
from tests.helpers import QUICK


class FakeSource:
    """As many frames as you like, all of them the same."""

    def __init__(self, counts: list[int], numbers: list[int] | None = None) -> None:
        self.headers = [PlyHeader(count, 0) for count in counts]
        self.numbers = numbers or list(range(len(counts)))

    def read(self, index: int):
        return make_cloud(4), []


@pytest.mark.parametrize(
    ("count", "frames", "level"),
    [(4, 1, 1), (1 << 18, 1, 1), ((1 << 18) + 1, 1, 2), (4, (1 << 14) + 1, 2), ((1 << 21) + 1, 1, 3)],
)
def test_the_level_is_the_smallest_that_holds_the_sequence(count: int, frames: int, level: int) -> None:
    assert plan_sequence(FakeSource([count] * frames), EncoderOptions()).header.level == level


@pytest.mark.parametrize(("count", "frames"), [((1 << 24) + 1, 1), (4, (1 << 20) + 1)])
def test_a_sequence_beyond_all_levels_is_refused(count: int, frames: int) -> None:
    with pytest.raises(InputError, match="split the sequence"):
        plan_sequence(FakeSource([count] * frames), EncoderOptions())


def test_anchors_are_where_runs_of_equal_counts_begin() -> None:
    plan = plan_sequence(FakeSource([4, 4, 7, 7, 7, 4]), EncoderOptions())
    assert plan.anchors == [0, 0, 2, 2, 2, 5]


def test_the_header_says_what_was_asked_for() -> None:
    options = EncoderOptions(frame_rate=Fraction(30000, 1001), order=OutputOrder.INPUT)
    header = plan_sequence(FakeSource([4, 4, 4], [7, 8, 11]), options).header
    assert header.frame_rate == (30000, 1001)
    assert header.output_order == OutputOrder.INPUT
    assert header.frame_numbers.expand() == [7, 8, 11]
    assert header.model_id == DEFAULT_PRIOR


def test_no_frames_are_refused(tmp_path) -> None:
    with pytest.raises(InputError, match="no frames"):
        encode_sequence([], tmp_path / "a.dgs")


def test_progress_counts_up_to_the_end(tmp_path) -> None:
    calls: list[tuple[int, int]] = []
    frames = still(make_cloud(5), 7)
    options = replace(QUICK, gof_size=3)
    encode_sequence(frames, tmp_path / "a.dgs", options, progress=lambda *c: calls.append(c))
    assert [total for _, total in calls] == [7] * len(calls)
    assert [done for done, _ in calls] == sorted(done for done, _ in calls)
    assert calls[-1] == (7, 7)


def test_the_report_has_every_byte(tmp_path) -> None:
    report = encode_sequence(still(make_cloud(5), 4), tmp_path / "a.dgs", QUICK)
    assert report.num_bytes == (tmp_path / "a.dgs").stat().st_size
    assert sum(f.num_bytes for f in report.frames) < report.num_bytes


@pytest.mark.parametrize("where", [0, 2])
def test_a_frame_that_cannot_be_coded_leaves_nothing(tmp_path, where: int) -> None:
    class Broken(MemorySource):
        def read(self, index: int):
            if index == where:
                raise InputError("frame is broken")
            return super().read(index)

    with pytest.raises(InputError, match="broken"):
        encode_sequence(Broken(still(make_cloud(5), 4)), tmp_path / "a.dgs")
    assert list(tmp_path.iterdir()) == []


def test_frames_are_not_changed(tmp_path) -> None:
    cloud = make_cloud(40, 1)
    before = [getattr(cloud, f).copy() for f in ("positions", "rotations", "scales", "sh_rest")]
    encode_sequence(still(cloud, 3), tmp_path / "a.dgs", QUICK)
    after = [cloud.positions, cloud.rotations, cloud.scales, cloud.sh_rest]
    assert all(np.array_equal(a, b) for a, b in zip(before, after, strict=True))

"""Sequences in which somebody shows nowhere: what is left out of the file, frame by frame."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dfcgs_codec import GaussianCloud, decode_sequence, encode_sequence, probe
from dfcgs_codec.encoder.frame.report import EncodeReport
from lab.options import encoder_options
from lab.small_clouds import all_changing, same_cloud, shuffled, succeeding
from lab.small_room import NUM_WALLS, behind, inside, room, viewers
from tests.helpers import match, taking_turns

INSIDE = slice(NUM_WALLS, NUM_WALLS + 40)
BEHIND = slice(NUM_WALLS + 40, None)
#: of those behind the walls, these come in
COMING = slice(NUM_WALLS + 40, NUM_WALLS + 50)
#: attributes as they are, but for the quantiser, so that a decoded Gaussian is told by its position
QUICK: dict[str, Any] = {"views": viewers(), "qp": 24}


def coded(
    frames: list[GaussianCloud], path: Path, **options: Any
) -> tuple[EncodeReport, list[GaussianCloud]]:
    report = encode_sequence(frames, path, encoder_options(**{**QUICK, **options}), force=True)
    return report, [frame.cloud() for frame in decode_sequence(path)]


def kept_of(frame: GaussianCloud, decoded: GaussianCloud) -> np.ndarray:
    """Which Gaussians of a frame are in what was decoded, (N,): those next to a decoded one."""
    gaps = np.linalg.norm(frame.positions[:, None] - decoded.positions[None], axis=2)
    assert gaps.min(axis=0).max() < 0.03
    is_kept = np.zeros(frame.num_gaussians, bool)
    is_kept[gaps.argmin(axis=0)] = True
    assert np.count_nonzero(is_kept) == decoded.num_gaussians, "one for one"
    return is_kept


def coming_in(num_frames: int = 16) -> list[GaussianCloud]:
    """A tracked sequence: ten balls behind a wall go through it, and are in the room at the end."""
    frames = []
    for index in range(num_frames):
        cloud = room()
        start = cloud.positions[COMING].copy()
        end = np.random.default_rng(7).uniform(-0.5, 0.5, (10, 3)).astype(np.float32)
        share = np.float32(max(0.0, (index - num_frames / 2) / (num_frames / 2 - 1)))
        cloud.positions[COMING] = (1 - share) * start + share * end
        frames.append(cloud)
    return frames


def test_who_shows_in_a_later_frame_of_a_run_is_kept(tmp_path: Path) -> None:
    frames = coming_in()
    report, decoded = coded(frames, tmp_path / "a.dgs")
    assert "".join(frame.kind[0] for frame in report.frames).count("I") == 1
    assert len({cloud.num_gaussians for cloud in decoded}) == 1
    for index in (0, 15):
        is_kept = kept_of(frames[index], decoded[index])
        assert is_kept[COMING].all()
        assert is_kept[INSIDE].all()
        assert not is_kept[COMING.stop :].any()
    # in the first frame alone they do not show
    _, (alone,) = coded(frames[:1], tmp_path / "a.dgs")
    assert not kept_of(frames[0], alone)[BEHIND].any()


def test_later_gofs_of_a_run_have_the_same_gaussians(tmp_path: Path) -> None:
    frames = coming_in(8)
    report, decoded = coded(frames, tmp_path / "a.dgs", gof_size=3)
    assert [frame.kind[0] for frame in report.frames].count("I") == 3
    assert len({cloud.num_gaussians for cloud in decoded}) == 1
    last = kept_of(frames[7], decoded[7])
    assert last[COMING].all()
    assert np.array_equal(kept_of(frames[3], decoded[3]), last)


@pytest.mark.parametrize("order", ["sequence", "input", "free"])
def test_those_that_are_kept_keep_their_order(order: str, tmp_path: Path) -> None:
    frames = coming_in(4)
    _, decoded = coded(frames, tmp_path / "a.dgs", order=order, gof_size=2)
    rows = np.flatnonzero(kept_of(frames[0], decoded[0]))
    for frame, cloud in zip(frames, decoded, strict=True):
        found = match(frame.take(rows), cloud)
        if order == "input":
            assert np.array_equal(found, np.arange(len(rows)))
        if order == "sequence":
            assert np.array_equal(found, match(frames[0].take(rows), decoded[0]))
        assert np.abs(frame.take(rows[found]).positions - cloud.positions).max() < 0.03


def test_frames_without_an_order_are_looked_at_one_by_one(tmp_path: Path) -> None:
    frames = [shuffled(room(), seed) for seed in range(3)]
    _, decoded = coded(frames, tmp_path / "a.dgs")
    for frame, cloud in zip(frames, decoded, strict=True):
        is_kept = kept_of(frame, cloud)
        assert is_kept[np.abs(frame.positions).max(axis=1) < 0.9].all()
        assert not is_kept[np.linalg.norm(frame.positions, axis=1) > 2].any()


def test_frames_of_other_counts_are_looked_at_one_by_one(tmp_path: Path) -> None:
    def without(count: int) -> GaussianCloud:
        return room().take(np.arange(room().num_gaussians - count))

    frames = [room(), without(10), without(10), without(60), without(100)]
    frames[2] = replace(frames[2], sh_dc=frames[2].sh_dc + np.float32(0.1))
    report, decoded = coded(frames, tmp_path / "a.dgs", gof_size=2)
    for frame, cloud in zip(frames, decoded, strict=True):
        is_kept = kept_of(frame, cloud)
        assert is_kept[NUM_WALLS : NUM_WALLS + 40].all()
        assert not is_kept[NUM_WALLS + 40 :].any()
    assert report.num_unseen == room().num_gaussians - decoded[0].num_gaussians


@pytest.mark.parametrize(
    ("kind", "keep"), taking_turns(["tracked", "births and deaths", "lost order"], (False, True))
)
def test_the_number_of_processes_changes_no_byte(kind: str, keep: bool, tmp_path: Path) -> None:
    frames = {
        "tracked": lambda: all_changing(room(), 4),
        "births and deaths": lambda: succeeding(room(), 4, share=0.02),
        "lost order": lambda: [shuffled(cloud, seed) for seed, cloud in enumerate(coming_in(4))],
    }[kind]()
    for jobs in (1, 2):
        coded(frames, tmp_path / f"{jobs}.dgs", jobs=jobs, gof_size=2, keep_unseen=keep)
    assert (tmp_path / "1.dgs").read_bytes() == (tmp_path / "2.dgs").read_bytes()


def test_what_is_kept_though_unseen_takes_fewer_bytes(tmp_path: Path) -> None:
    sizes, errors = {}, {}
    for name, options in {
        "left out": {},
        "coarse": {"keep_unseen": True},
        "all": {"views": None},
    }.items():
        _, (cloud,) = coded([room()], tmp_path / "a.dgs", balance=False, order="input", **options)
        sizes[name] = (tmp_path / "a.dgs").stat().st_size
        if name != "left out":
            error = np.abs(cloud.sh_dc - room().sh_dc).mean(axis=1)
            errors[name] = [error[part].mean() for part in (INSIDE, BEHIND)]
    assert sizes["left out"] < sizes["coarse"] < 1.02 * sizes["all"]
    seen, unseen = np.array(errors["coarse"]) / np.array(errors["all"])
    assert seen < 1.5
    assert unseen > 4


def test_float32_verbatim_is_float32_of_all(tmp_path: Path) -> None:
    cloud = room()
    cloud.opacities[-1] = np.nan
    report, (decoded,) = coded([cloud], tmp_path / "a.dgs", intra="ply", order="input")
    assert report.num_unseen == 0
    assert same_cloud(decoded, cloud)


def test_a_note_of_cover_stands_in_the_file(tmp_path: Path) -> None:
    coded([room()], tmp_path / "a.dgs", keep_unseen=True)
    info = probe(tmp_path / "a.dgs")
    assert " keep_unseen " in info.encoder_info
    assert info.encoder_info.endswith("unseen=0")
    assert info.bytes_by("attribute")["COVER"] > 8


def test_scenes_have_what_these_tests_say() -> None:
    assert room().num_gaussians == NUM_WALLS + inside().num_gaussians + behind().num_gaussians
    assert np.abs(inside().positions).max() < 0.6
    assert np.linalg.norm(behind().positions, axis=1).min() > 2.5

"""Operating points in fresh processes: figures, cache, refusals, failures."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("numba")
pytest.importorskip("bjontegaard")

from dfcgs_codec.ply import write_ply
from evaluation import bench, measure
from evaluation.baselines.method import MethodUnavailable, SequenceFacts, frame_path
from evaluation.measure import Rated, Subject
from evaluation.points import Point, baseline_points, codec_point, codec_points
from evaluation.sequences import Sequence
from lab.render import orbit
from lab.scenes import SceneOptions, trained_sequence
from lab.scenes.stress import blob_cloud

NUM_FRAMES = 3
_COPY = "import shutil, sys; shutil.copytree(sys.argv[1], sys.argv[2], dirs_exist_ok=True)"


@pytest.fixture
def subject(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Subject:
    """Three frames of a swaying blob, two views."""
    folder = tmp_path / "frames"
    folder.mkdir()
    cloud = blob_cloud(300, 1, 0)
    for index, frame in enumerate(trained_sequence(cloud, SceneOptions(NUM_FRAMES), "sway")):
        write_ply(frame_path(folder, index), frame)
    views = [orbit((0, 0, 0), 4.0, (angle, 20.0), (64, 48)) for angle in (0.0, 120.0)]
    monkeypatch.setattr(measure, "cameras", lambda scene, which: [views[i] for i in which])
    monkeypatch.setattr(measure, "WORK", tmp_path / "work")
    monkeypatch.setattr(measure, "_CACHE", tmp_path / "cache")
    facts = SequenceFacts(NUM_FRAMES, (300,) * NUM_FRAMES, 1)
    return Subject(Sequence("blob", folder, facts, "digest"), Rated((0, 2), (0, 1)))


def point(program: str, **changes: Any) -> Point:
    """A method that is a Python program with two folders as arguments."""

    def command(source: Path, target: Path) -> list[str]:
        return [sys.executable, "-c", program, str(source), str(target)]

    made = Point("copy", "copy", "any", None, lambda: "1", lambda _: None, command, command)
    return replace(made, **changes)


def test_our_own_points_give_bytes_times_and_quality(subject: Subject) -> None:
    figures = measure.measure(subject, codec_point("dfcgs", "medium", {"quality": "medium"}, "medium"))
    assert 0 < figures["bytes"] < 300 * 25 * 4 * NUM_FRAMES
    assert figures["bytes_per_frame"] == figures["bytes"] / NUM_FRAMES
    assert 25 < figures["psnr"] < 60
    assert set(figures["psnr_by_frame"]) == {"0", "2"}
    assert figures["encode_s_per_frame"] > 0
    assert figures["encode_peak_mib"] > 10
    assert sum(figures["bytes_by_frame_type"].values()) <= figures["bytes"]
    assert figures["frame_types"][0] == "I"
    assert figures["attributes"]["matched_share"] > 0.9


def test_a_finer_point_is_larger_and_better(subject: Subject) -> None:
    coarse, fine = (
        measure.measure(subject, codec_point("dfcgs", name, {"quality": name})) for name in ("low", "high")
    )
    assert fine["bytes"] > coarse["bytes"]
    assert fine["psnr"] > coarse["psnr"] + 3


def test_a_copy_is_lossless(subject: Subject) -> None:
    figures = measure.measure(subject, point(_COPY))
    assert figures["psnr"] is None
    assert figures["bytes"] == sum(p.stat().st_size for p in subject.sequence.folder.iterdir())
    assert figures["attributes"]["position"]["max"] == 0.0


def test_figures_are_kept_by_what_they_depend_on(subject: Subject) -> None:
    runs = []

    def count(*_: Any) -> dict[str, Any]:
        runs.append(1)
        return {"bytes": 1}

    for _ in range(2):
        measure.measure(subject, point(_COPY), count)
    assert len(runs) == 1
    measure.measure(subject, point(_COPY, version=lambda: "2"), count)
    measure.measure(subject, point(_COPY, setting="other"), count)
    measure.measure(replace(subject, rated=Rated((0,), (0,))), point(_COPY), count)
    measure.measure(replace(subject, sequence=replace(subject.sequence, digest="else")), point(_COPY), count)
    assert len(runs) == 5


def test_refusals_are_said_and_not_kept(subject: Subject) -> None:
    def unavailable() -> str:
        raise MethodUnavailable("install it")

    refused = "import sys; print('cannot hold this', file=sys.stderr); sys.exit(5)"
    assert measure.measure(subject, point(refused)) == {"skipped": "cannot hold this"}
    assert measure.measure(subject, point(_COPY, accepts=lambda _: "SH")) == {"skipped": "SH"}
    assert measure.measure(subject, point(_COPY, version=unavailable)) == {"skipped": "install it"}
    assert not list(measure._CACHE.glob("*")) if measure._CACHE.exists() else True


def test_a_method_that_fails_or_loses_frames_is_reported(subject: Subject) -> None:
    broken = measure.measure(subject, point("raise ValueError('oh')"))
    assert "oh" in broken["failed"]
    losing = _COPY + "; import pathlib; pathlib.Path(sys.argv[2], 'frame_0001.ply').unlink(missing_ok=True)"
    assert measure.measure(subject, point(losing, setting="losing")) == {"failed": "decode: 2 of 3 frames"}


def test_points_have_names_of_their_own() -> None:
    names = [(p.method, p.setting) for p in [*codec_points(), *baseline_points()]]
    assert len(names) == len(set(names))
    assert {"low", "medium", "high", "transparent"} <= {p.preset for p in codec_points()}


def test_a_run_of_some_methods_keeps_the_figures_of_others() -> None:
    old = {"input_sha256": "a", "points": [{"method": "dfcgs", "bytes": 1}, {"method": "spz", "bytes": 2}]}
    old["points"].append({"method": "of_another_time", "bytes": 9})
    new = {"input_sha256": "a", "points": [{"method": "dfcgs", "bytes": 3}]}
    assert [p["bytes"] for p in bench.merged(old, new)["points"]] == [3, 2]
    assert bench.merged({**old, "input_sha256": "b"}, new) == new
    assert bench.merged(None, new) == new


def test_methods_keep_their_order() -> None:
    rows = [
        {"method": "dfcgs", "bytes": 1},
        {"method": "dfcgs_intra", "bytes": 2},
        {"method": "spz", "bytes": 3},
    ]
    old = {"input_sha256": "a", "points": rows}
    new = {"input_sha256": "a", "points": [{"method": "dfcgs_intra", "bytes": 4}]}
    assert [p["bytes"] for p in bench.merged(old, new)["points"]] == [1, 4, 3]


def test_every_scene_has_eight_views() -> None:
    from lab.scenes.catalogue import group
    from lab.views import cameras

    for scene in [*group("evaluation"), *group("long")]:
        views = cameras(scene.name)
        assert len(views) == 8
        assert {(view.width, view.height) for view in views} == {(640, 480)}


def test_views_fill_the_image() -> None:
    from lab.views import ANGLES, FILL, _fill, central_box, framing_camera

    box = central_box(blob_cloud(500, 0, 1)) * [1.0, 3.0, 1.0] + [5.0, 0.0, 0.0]
    corners = [[x, y, z] for x in box[:, 0] for y in box[:, 1] for z in box[:, 2]]
    for angles in ANGLES:
        assert _fill(framing_camera(box, angles, "+y"), corners) == pytest.approx(FILL, abs=1e-6)

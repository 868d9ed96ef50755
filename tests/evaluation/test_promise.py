"""What the presets promise: rows of a scene, and the captures' files that they need."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("numba", reason="the renderer is compiled by numba, from the eval extra")

from dfcgs_codec import EncoderOptions
from dfcgs_codec.ply import write_ply
from evaluation import measure, promise
from evaluation.baselines.method import SequenceFacts, frame_path
from evaluation.measure import Rated, Subject
from evaluation.sequences import Sequence
from lab import record
from lab.captures import keep
from lab.captures.files import cameras_file, true_images
from lab.render import orbit
from lab.scenes import SceneOptions, trained_sequence
from lab.scenes.catalogue import group, is_capture
from lab.scenes.stress import blob_cloud
from lab.views import cameras

VIEWS = [orbit((0, 0, 0), 4.0, (angle, 20.0), (64, 48)) for angle in (0.0, 120.0)]


@pytest.fixture
def subject(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Subject:
    """Three frames of a swaying blob, two views."""
    for index, frame in enumerate(trained_sequence(blob_cloud(300, 1, 0), SceneOptions(3), "sway")):
        write_ply(frame_path(tmp_path, index), frame)
    for module in (measure, promise):
        monkeypatch.setattr(module, "cameras", lambda scene, which: [VIEWS[i] for i in which])
    facts = SequenceFacts(3, (300,) * 3, 1)
    return Subject(Sequence("blob", tmp_path, facts, "digest"), Rated((0, 2), (0, 1)))


def test_a_row_says_how_far_below_the_worst_frame_is(subject: Subject) -> None:
    row = promise.rate(subject, EncoderOptions(quality="high"))
    assert set(row["psnr_by_frame"]) == {"0", "2"}
    assert row["worst_minus_mean"] == pytest.approx(min(row["psnr_by_frame"].values()) - row["psnr"])
    assert row["bytes_per_frame"] > 0
    assert len(row["kinds"]) == 3


def test_an_estimate_of_the_encoder_is_shown(subject: Subject, monkeypatch: pytest.MonkeyPatch) -> None:
    @dataclass
    class Told:
        report: Any
        estimated_psnr: float = 41.5

        def __getattr__(self, name: str) -> Any:
            return getattr(self.report, name)

    encode = promise.encode_sequence
    monkeypatch.setattr(promise, "encode_sequence", lambda *arguments: Told(encode(*arguments)))
    row = promise.rate(subject, EncoderOptions(quality="high"))
    assert row["estimated_psnr"] == 41.5
    assert f"expected 41.50 ({41.5 - row['psnr']:+5.2f})" in promise._line("blob", "high", row)


def test_rows_of_other_scenes_and_presets_stay(
    tmp_path: Path, subject: Subject, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(record, "RESULTS", tmp_path)
    monkeypatch.setattr(
        promise, "subject_of", lambda scene, _: replace(subject, sequence=replace(subject.sequence, name="b"))
    )
    name = group("captures")[0].name
    for preset in ("medium", "high"):
        assert promise.main([name, "--preset", preset]) == 0
    (found,) = json.loads((tmp_path / "promise.json").read_text())["results"].values()
    assert list(found) == ["medium", "high"]


def test_captures_have_true_images_of_the_frames_that_are_rendered() -> None:
    scene = group("captures")[0].name
    assert is_capture(scene)
    assert not is_capture("mage_fitted")
    assert cameras_file(scene).exists()
    views = dict(zip((0, 3), cameras(scene, (0, 3)), strict=True))
    found = true_images(scene, views, (0, 5, 6))
    assert list(found) == [0, 5]
    kept = keep.read_images(cameras_file(scene).parent, 3, views[3].height)
    assert np.array_equal(np.rint(255 * found[5][1]), kept[1])

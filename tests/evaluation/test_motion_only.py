"""The comparison of both rules of compensation, on a scene small enough for a test."""

from __future__ import annotations

from pathlib import Path

import pytest

pytest.importorskip("bjontegaard")
pytest.importorskip("numba")

from evaluation.experiments.paper import compensation
from evaluation.experiments.paper.compensation import measure, scenes
from lab.options import encoder_options
from lab.quality import image
from lab.render import look_at
from tests.helpers import real_cloud, waving


def test_settings_are_compared_frame_by_frame(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    settings = {
        name: encoder_options(options, control_spacing=20) for name, options in compensation.SETTINGS.items()
    }
    monkeypatch.setattr(compensation, "SETTINGS", settings)
    cloud = real_cloud(1500)
    frames = [waving(cloud, 0.04 * index) for index in range(3)]
    middle = cloud.positions.mean(axis=0)
    views = [look_at((middle - (0, 0, 3)).tolist(), middle.tolist(), (96, 64), 50.0, [0, -1, 0])]
    images = [[image(cloud, view) for view in views] for cloud in frames[1:]]
    found = measure(frames, images, views, 21, tmp_path)
    for name in ("main", "paper", "paper_best", "repeat"):
        assert len(found[name]["psnr_by_frame"]) == 2
    assert found["paper"]["control_points"] == [75, 75]
    assert found["repeat"]["psnr"] < found["paper_best"]["psnr"] < found["main"]["psnr"]
    against = found["against"]
    assert against["repeat"]["gain"] == pytest.approx(
        found["main"]["psnr"] - found["repeat"]["psnr"], abs=1e-3
    )
    assert against["repeat"]["least_gain"] <= against["repeat"]["gain"]
    assert against["bytes_ratio"] == pytest.approx(
        found["main"]["bytes_p"] / found["paper"]["bytes_p"], abs=1e-3
    )


def test_scenes_are_large() -> None:
    assert "knight_walk_200k" in scenes()
    assert all(scene.variant == "smooth" for scene in scenes().values())

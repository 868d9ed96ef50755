"""The comparison on captures: what is measured on them, and how it is put beside one another."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("numba")
pytest.importorskip("bjontegaard")

from evaluation import captures, measure, points
from evaluation.bench import PLANS, chosen_points, chosen_scenes
from evaluation.fresh import Run
from evaluation.measure import Rated, Subject
from evaluation.sequences import materialise
from lab.quality import Image, true_quality
from lab.scenes.catalogue import group, scene

NAME = group("captures")[0].name


def rows(method: str, label: str, scale: float, settings: tuple[str, ...] = ("",)) -> list[dict[str, Any]]:
    """A curve that doubles its bytes every 6 dB."""
    return [
        {
            "method": method,
            "label": label,
            "setting": f"qp{psnr}{setting}",
            "psnr": psnr,
            "bytes": 1,
            "bytes_per_frame": scale * 2 ** (psnr / 6),
        }
        for setting in settings
        for psnr in (30.0, 36.0, 44.0)
    ]


def test_curves_are_put_beside_uniform_steps_and_the_baseline() -> None:
    found = captures.against(
        [
            *rows("dfcgs", "dfcgs (default)", 2.0),
            *rows("dfcgs_uniform", "dfcgs, uniform steps", 4.0),
            *rows("delta_zstd", "delta", 8.0, ("_gof10", "_gof60")),
            *rows("spz", "SPZ", 80.0),
        ]
    )
    assert list(found) == ["dfcgs (default)", "dfcgs, uniform steps"]
    ratios = {anchor: figures["bytes_ratio"] for anchor, figures in found["dfcgs (default)"].items()}
    assert ratios == {"dfcgs, uniform steps": 0.5, "delta, GoF 10": 0.25, "delta, GoF 60": 0.25}
    assert set(found["dfcgs, uniform steps"]) == {"delta, GoF 10", "delta, GoF 60"}


def test_captures_are_asked_for_uniform_steps_and_objects_are_not() -> None:
    on_capture = {p.method for p in chosen_points(PLANS["captures"], [], scene(NAME))}
    assert on_capture - {"dfcgs_views"} == {"dfcgs", "dfcgs_uniform", "delta_zstd"}
    assert not {p.method for p in chosen_points(PLANS["bench"], [], scene("mage_fitted"))} & {
        "dfcgs_uniform",
        "dfcgs_views",
    }
    assert {p.method for p in chosen_points(PLANS["captures"], ["spz"], scene(NAME))} == {"spz"}
    assert {s.group for s in chosen_scenes(PLANS["captures"], [])} == {"captures"}


def test_other_cameras_are_other_points(tmp_path: Path) -> None:
    cameras = tmp_path / "cameras.json"
    versions = []
    for text in ("[]", "[{}]"):
        cameras.write_text(text)
        told = [p for p in points.capture_points(cameras) if p.method == "dfcgs_views"]
        assert all(str(cameras) in p.encode(tmp_path, tmp_path) for p in told)
        assert {p.preset for p in told} == {None}
        versions.append(told[0].version())
    assert versions[0] != versions[1]


def test_what_the_encoder_expects_is_taken_from_its_report() -> None:
    run = Run(0, 1.0, 1.0, "", json.dumps({"num_bytes": 1}))
    assert measure._expected(run) == {}
    told = replace(run, output=json.dumps({"estimated_psnr": 41.25}))
    assert measure._expected(told) == {"estimated_psnr": 41.25}


def test_true_images_are_compared_view_by_view() -> None:
    black = np.zeros((16, 16, 3), np.float32)
    seen = [Image(black + error, np.ones((16, 16), np.float32)) for error in (np.float32(0.1), np.float32(0))]
    psnr, ssim = true_quality({5: [black, black]}, {5: seen, 10: []})
    assert psnr == pytest.approx(20.0 + 10 * np.log10(2), abs=1e-4)
    assert 0.0 < ssim < 1.0


def test_figures_of_a_capture_have_the_truth_beside_the_input() -> None:
    subject = Subject(materialise(scene(NAME), 1), Rated((0,), (2,)))
    figures = measure._quality(subject, subject.sequence.folder)
    assert figures["psnr"] is figures["psnr_full_frame"] is None
    assert figures["psnr_true_input"] == figures["psnr_true_decoded"] > 27.0
    assert figures["ssim_true_decoded"] > 0.9

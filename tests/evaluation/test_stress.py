"""The stress list on tiny cases: what it measures, and that a missed bar shows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("numba", reason="the renderer is compiled by numba, from the eval extra")

from evaluation.stress import Case, all_cases, failures, row, run_case
from lab.scenes import STRESS, SceneOptions, stress_sequence


def tiny(name: str) -> Case:
    return Case(lambda: stress_sequence(name, SceneOptions(6, 300, 1)), quick=True)


@pytest.fixture(scope="module")
def scene_cut(tmp_path_factory):
    return run_case(tiny("scene-cut"), tmp_path_factory.mktemp("cut"))


def test_a_case_is_coded_measured_and_passes(scene_cut):
    assert scene_cut["outcome"] == "ok"
    assert scene_cut["hashes_checked_by_decode"]
    assert scene_cut["num_gaussians"] == [300] * 4 + [225] * 2
    # the Gaussians behind the cut are some of those before it, elsewhere: they are found again
    assert set(scene_cut["frame_types"][1:5]) <= {"P", "s"}
    assert scene_cut["frame_types"][4] == "P"
    assert scene_cut["all_intra"]["frame_types"] == "IIIIII"
    assert scene_cut["num_bytes"] < scene_cut["all_intra"]["num_bytes"]
    assert failures(tiny("scene-cut"), scene_cut) == []
    assert row("scene-cut", scene_cut, []).endswith(" ok")


def test_quality_is_that_of_the_same_gaussians(scene_cut):
    quality = scene_cut["quality"]["psnr"]
    assert 25 < quality < 70
    assert abs(quality - scene_cut["quality_all_intra"]["psnr"]) < 3


def test_missed_bars_are_named(scene_cut):
    slow = scene_cut | {"ratio_to_all_intra": 1.03, "encode_s": [700.0, 61.0], "decode_s": [11.9]}
    first, second = failures(tiny("scene-cut"), slow)
    assert "1.03" in first
    assert "encode: 10.2" in second
    assert len(failures(replace(tiny("scene-cut"), quick=False), slow)) == 1


def test_what_encode_refuses_is_a_failure(tmp_path):
    def broken():
        for frame in stress_sequence("static", SceneOptions(2, 50, 0)):
            yield replace(frame, positions=np.full_like(frame.positions, np.nan))

    result = run_case(Case(broken), tmp_path)
    (missed,) = failures(Case(broken), result)
    assert "encode ended with 1" in missed
    assert missed in row("nan", result, [missed])


def test_all_stress_cases_are_listed():
    cases = all_cases()
    assert {name.removeprefix("blob/") for name in cases} >= set(STRESS)
    assert cases["blob/coincident"].quick
    assert cases["blob/coincident-1-frame"].repeats >= 2

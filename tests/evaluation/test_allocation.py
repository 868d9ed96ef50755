"""The best steps, on curves whose best steps are known; drift's slope."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("numba")

from evaluation.allocation import _GRID, OCTAVES, codec_steps, compare
from evaluation.drift import VARIANTS, _slope
from evaluation.drift import compare as compare_drift


def curves(sensitivity: dict[str, float], values: dict[str, int]) -> tuple[dict, dict]:
    """Errors that grow with the square of the step; a bit per value and octave."""
    errors = {a: [c * 4.0**o for o in OCTAVES] for a, c in sensitivity.items()}
    rates = {a: [n * (10.0 - o) for o in OCTAVES] for a, n in values.items()}
    return errors, rates


def test_the_best_steps_share_the_error_by_the_number_of_values() -> None:
    sensitivity, values = {"SCALE": 1e-5, "OPACITY": 1e-6}, {"SCALE": 3, "OPACITY": 1}
    found = compare(*curves(sensitivity, values), (-42.0,))["-42.0"]
    shares = {a: sensitivity[a] * 4.0 ** found["best_octaves"][a] / values[a] for a in values}
    assert shares["SCALE"] == pytest.approx(shares["OPACITY"], rel=0.1)
    total = sum(shares[a] * values[a] for a in values)
    assert 10 * np.log10(total) == pytest.approx(-42.0, abs=0.2)


def test_steps_in_the_best_proportion_have_no_excess() -> None:
    balanced = compare(*curves({"SCALE": 3e-6, "OPACITY": 1e-6}, {"SCALE": 3, "OPACITY": 1}), (-42.0,))
    assert balanced["-42.0"]["excess"] == pytest.approx(0.0, abs=0.003)
    off = compare(*curves({"SCALE": 3e-5, "OPACITY": 1e-7}, {"SCALE": 3, "OPACITY": 1}), (-42.0,))
    assert off["-42.0"]["excess"] > 0.02


def test_fine_positions_follow_the_codec() -> None:
    steps = codec_steps(["POSITION", "SCALE"], -2.0)
    assert [_GRID[steps[a]] for a in ("POSITION", "SCALE")] == pytest.approx([-3.0, -2.0])


def test_the_slope_is_per_hundred_frames() -> None:
    assert _slope(-0.01 * np.arange(300)) == pytest.approx(-1.0)


def test_drift_is_the_difference_from_all_intra() -> None:
    def figures(*psnr: float) -> dict[str, object]:
        return {"bytes": 1, "psnr": list(psnr)}

    found = compare_drift({"steady60": figures(40, 41), "gof60": figures(39, 38), "intra": figures(40, 40)})
    assert list(found) == ["intra", "gof60", "steady60"]
    assert found["gof60"]["mean_difference"] == pytest.approx(-1.5)
    assert found["gof60"]["worst_difference"] == pytest.approx(-2.0)
    assert found["steady60"]["slope_per_100_frames"] == pytest.approx(100.0)
    assert "mean_difference" not in found["intra"]
    assert compare_drift(found) == found


def test_steady_variants_are_those_of_every_gof_size() -> None:
    for name, options in VARIANTS.items():
        if name.startswith("gof"):
            assert VARIANTS[name.replace("gof", "steady")] == [*options, "--steady"]

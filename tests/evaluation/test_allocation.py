"""The best steps, on curves whose best steps are known."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("numba")

from evaluation.experiments.i_frames.allocation import _GRID, OCTAVES, codec_steps, compare


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

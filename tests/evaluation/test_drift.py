"""Drift: the difference from all-intra coding, its slope, and what is measured."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("numba")

from evaluation.experiments.drift import _slope, compare


def test_the_slope_is_per_hundred_frames() -> None:
    assert _slope(-0.01 * np.arange(300)) == pytest.approx(-1.0)


def test_drift_is_the_difference_from_all_intra() -> None:
    def figures(*psnr: float) -> dict[str, object]:
        return {"bytes": 1, "psnr": list(psnr)}

    found = compare({"gof300": figures(40, 41), "gof60": figures(39, 38), "intra": figures(40, 40)})
    assert list(found) == ["intra", "gof60", "gof300"]
    assert found["gof60"]["mean_difference"] == pytest.approx(-1.5)
    assert found["gof60"]["worst_difference"] == pytest.approx(-2.0)
    assert found["gof300"]["slope_per_100_frames"] == pytest.approx(100.0)
    assert "mean_difference" not in found["intra"]
    assert compare(found) == found

from __future__ import annotations

import pytest

pytest.importorskip("bjontegaard")

from evaluation.experiments.since import gains


def scene(factor: float) -> dict:
    points = [(100.0, 30.0), (200.0, 35.0), (400.0, 40.0)]
    return {"points": [{"method": "dfcgs", "bytes": factor * b, "psnr": p} for b, p in points]}


def test_a_tenth_less_is_a_tenth_less() -> None:
    found = gains({"a": scene(1), "b": scene(1)}, {"a": scene(0.9), "b": scene(0.9)})
    assert found["dfcgs"]["a"] == pytest.approx(-10)
    assert found["dfcgs"]["mean"] == pytest.approx(-10)


def test_what_was_not_measured_again_is_left_out() -> None:
    assert gains({"a": scene(1)}, {"a": scene(1), "new": scene(1)}) == {}

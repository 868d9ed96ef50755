"""Bjontegaard deltas on published curves, against an integration of our own."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.interpolate import PchipInterpolator

pytest.importorskip("bjontegaard")

from evaluation.bd import bd_delta, psnr_at, rate_at, rising

# the example of the first widely used script for VCEG-M33, and the libx265 curves that the package publishes
M33 = (
    [(686.76, 40.28), (309.58, 37.18), (157.11, 34.24), (85.95, 31.42)],
    [(893.34, 40.39), (407.8, 37.21), (204.93, 34.17), (112.75, 31.24)],
)
X265 = (
    [(9487.76, 40.037), (4593.60, 38.615), (2486.44, 36.845), (1358.24, 34.851)],
    [(9787.80, 40.121), (4469.00, 38.651), (2451.52, 36.970), (1356.24, 34.987)],
)


def mean_gap(first: list[tuple[float, float]], second: list[tuple[float, float]]) -> float:
    """Mean of second(x) - first(x) over the common range of x; points are (x, y)."""
    curves = [PchipInterpolator(*zip(*sorted(points), strict=True)) for points in (first, second)]
    low = max(min(x for x, _ in p) for p in (first, second))
    high = min(max(x for x, _ in p) for p in (first, second))
    return quad(lambda x: curves[1](x) - curves[0](x), low, high, limit=200)[0] / (high - low)


@pytest.mark.parametrize("curves", [M33, X265])
def test_published_curves(curves: tuple[list[tuple[float, float]], list[tuple[float, float]]]) -> None:
    delta = bd_delta(*curves)
    logs = [[(np.log(r), p) for r, p in c] for c in curves]
    swapped = [[(p, r) for r, p in c] for c in logs]
    assert delta.bd_rate == pytest.approx(100 * np.expm1(mean_gap(*swapped)), abs=1e-3)
    assert delta.bd_psnr == pytest.approx(mean_gap(*logs), abs=1e-4)


def test_published_figures() -> None:
    """The cubic polynomials of VCEG-M33 give 31.4 % and -1.185 dB; Hermite pieces hardly differ."""
    delta = bd_delta(*M33)
    assert delta.bd_rate == pytest.approx(31.4, abs=0.1)
    assert delta.bd_psnr == pytest.approx(-1.185, abs=0.005)


def test_half_the_bytes_are_minus_fifty_percent() -> None:
    halved = [(rate / 2, psnr) for rate, psnr in M33[0]]
    assert bd_delta(M33[0], halved).bd_rate == pytest.approx(-50.0)
    assert bd_delta(halved, M33[0]).bd_rate == pytest.approx(100.0)


def test_curves_that_do_not_meet_have_no_delta() -> None:
    assert bd_delta(M33[0], [(rate, psnr + 20) for rate, psnr in M33[1]]) is None
    assert bd_delta(M33[0], M33[1][:1]) is None


def test_rates_that_do_not_meet_have_no_bd_psnr() -> None:
    delta = bd_delta(M33[0], [(rate / 100, psnr) for rate, psnr in M33[0]])
    assert delta.bd_psnr is None
    assert delta.bd_rate == pytest.approx(-99.0)


def test_points_that_a_cheaper_one_beats_are_left_out() -> None:
    assert rising([(3, 30), (1, 20), (2, 31), (4, 31)]) == [(1, 20), (2, 31)]


def test_interpolation() -> None:
    curve = [(100.0, 30.0), (400.0, 40.0)]
    assert rate_at(curve, 35.0) == pytest.approx(200.0)
    assert psnr_at(curve, 200.0) == pytest.approx(35.0)
    assert rate_at(curve, 41.0) is None
    assert psnr_at(curve, 99.0) is None

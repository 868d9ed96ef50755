"""Where a scene is and how large: integers only, and outliers do not count."""

from __future__ import annotations

import numpy as np
import pytest

from dfcgs_codec.transform.normalisation import NORMAL_BITS, Normalisation, shifted


def test_the_bulk_of_a_scene_is_within_one_unit() -> None:
    rng = np.random.default_rng(1)
    positions = rng.normal((1000, -70000, 3), 5000, (4000, 3)).astype(np.int64)
    found = Normalisation.of(positions)
    normal = found.of_positions(positions) / (1 << NORMAL_BITS)
    inside = (np.abs(normal) <= 1).mean(axis=0)
    assert (inside >= 0.9).all()
    # the extent was rounded up to a power of two, not further
    assert np.abs(np.quantile(normal, [0.05, 0.95], axis=0)).max() > 0.5
    assert np.abs(np.median(normal, axis=0)).max() < 0.01


def test_far_outliers_change_nothing() -> None:
    rng = np.random.default_rng(2)
    positions = rng.integers(-900, 900, (1000, 3))
    outliers = positions.copy()
    outliers[rng.permutation(1000)[:20]] = 1 << 28
    first, second = Normalisation.of(positions), Normalisation.of(outliers)
    assert first.exponent == second.exponent == 10
    assert np.abs(first.center - second.center).max() < 60
    assert second.of_positions(outliers).max() == 4 << NORMAL_BITS


@pytest.mark.parametrize("count", [1, 2, 3, 19, 20, 21])
def test_few_gaussians(count: int) -> None:
    positions = np.arange(3 * count).reshape(count, 3) * 7
    found = Normalisation.of(positions)
    ordered = np.sort(positions, axis=0)
    np.testing.assert_array_equal(found.center, ordered[count // 2])
    high = ordered[min(count - 1, count * 95 // 100)] - found.center
    extent = int(max(1, high.max(), (found.center - ordered[count * 5 // 100]).max()))
    assert 2**found.exponent >= extent > 2**found.exponent // 2 or extent == 1


def test_a_single_place_is_at_the_middle() -> None:
    positions = np.full((5, 3), 12345)
    found = Normalisation.of(positions)
    assert found.exponent == 0
    assert not found.of_positions(positions).any()
    assert found.of_positions(positions + 1).tolist()[0] == [1 << NORMAL_BITS] * 3


def test_shifts_round_down() -> None:
    values = np.array([-5, -4, -1, 0, 1, 5])
    np.testing.assert_array_equal(shifted(values, -2), np.floor(values / 4))
    np.testing.assert_array_equal(shifted(values, 3), values * 8)
    np.testing.assert_array_equal(shifted(values, -100), np.where(values < 0, -1, 0))

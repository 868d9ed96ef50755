from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dfcgs_codec.transform.lod import (
    MAX_LEVELS,
    MIN_BASE,
    LevelsOfDetail,
    build_levels,
    ladder,
    num_levels,
    order_levels,
)
from dfcgs_codec.transform.morton import canonical_order, morton_keys
from lab.small_clouds import make_cloud

COUNTS = [1, 2, 3, 31, 32, 63, 64, 65, 127, 128, 200, 1000, 4097]


def positions(count: int, seed: int = 0) -> np.ndarray:
    """Grid positions in canonical order."""
    indices = np.rint(make_cloud(count, 0, seed).positions * 1000).astype(np.int64)
    return indices[canonical_order(morton_keys(indices - indices.min(axis=0)), indices)]


def both(count: int) -> list[LevelsOfDetail]:
    return [build_levels(positions(count)), order_levels(count)]


@pytest.mark.parametrize("count", COUNTS)
def test_every_row_is_in_the_base_or_in_one_level(count: int) -> None:
    for lod in both(count):
        times = np.zeros(count, np.int64)
        for rows in (lod.base, *(level.rows for level in lod.levels)):
            times[rows] += 1
        assert (times == 1).all()


@pytest.mark.parametrize("count", COUNTS)
def test_weights_sum_to_256_and_are_not_negative(count: int) -> None:
    for lod in both(count):
        for level in lod.levels:
            assert (level.weights.sum(axis=0) == 256).all()
            assert (level.weights >= 0).all()
            assert level.weights.shape[1] in (1, len(np.arange(count)[level.rows]))


def test_coincident_and_far_positions_have_weights_too() -> None:
    same = np.zeros((100, 3), np.int64)
    far = np.array([[-(2**29), 2**29, 0]] * 50 + [[2**29, -(2**29), 2**29]] * 50)
    for rows in (same, far):
        for level in build_levels(rows).levels:
            assert (level.weights.sum(axis=0) == 256).all()
            assert (level.weights >= 0).all()


@pytest.mark.parametrize("count", [64, 200, 1000])
def test_only_coarser_rows_are_looked_at(count: int) -> None:
    rng = np.random.default_rng(0)
    values = rng.integers(-1000, 1000, count)
    for lod in both(count):
        for level in lod.levels:
            mean, deviation = level.statistics(values)
            changed = values.copy()
            hidden = np.ones(count, bool)
            hidden[:: level.step] = False
            changed[hidden] = 10**6
            other_mean, other_deviation = level.statistics(changed)
            assert np.array_equal(mean, other_mean)
            assert np.array_equal(deviation, other_deviation)


def test_coarser_rows_are_coded_before() -> None:
    for lod in both(1000):
        known = np.zeros(1000, bool)
        known[lod.base] = True
        for level in lod.levels:
            assert known[:: level.step].all()
            known[level.rows] = True
        assert known.all()


def test_statistics_are_the_weighted_mean_and_deviation() -> None:
    rows, values = positions(200), np.random.default_rng(1).integers(-500, 500, 200)
    level = build_levels(rows).levels[-1]
    mean, deviation = level.statistics(values)
    for target in range(0, len(mean), 7):
        coarse = np.clip(np.arange(target - 3, target + 5), 0, len(values[:: level.step]) - 1)
        neighbours = values[:: level.step][coarse]
        weights = level.weights[:, target]
        assert mean[target] == (neighbours * weights).sum()
        centre = (mean[target] + 128) // 256
        assert deviation[target] == (np.abs(neighbours - centre) * weights).sum()


def test_neighbours_weigh_by_inverse_distance() -> None:
    rows = positions(300)
    level = build_levels(rows).levels[-1]
    coarse, targets = rows[:: level.step], rows[level.rows]
    target = 60
    near = np.clip(np.arange(target - 3, target + 5), 0, len(coarse) - 1)
    distance = np.sqrt(((coarse[near] - targets[target]) ** 2).sum(axis=1)).astype(np.int64) + 1
    share = (1 / distance) / (1 / distance).sum()
    assert np.abs(level.weights[:, target] / 256 - share).max() < 10 / 256
    assert level.weights[:, target].argmax() == distance.argmin()


def test_a_constant_is_predicted_exactly() -> None:
    for lod in both(500):
        for level in lod.levels:
            mean, deviation = level.statistics(np.full(500, -77))
            assert (mean == -77 * 256).all()
            assert not deviation.any()


@given(st.integers(1, 2**24))
def test_the_base_keeps_32_gaussians(count: int) -> None:
    levels = num_levels(count)
    assert 0 <= levels <= MAX_LEVELS
    assert levels == 0 or count >> levels >= MIN_BASE
    assert levels == MAX_LEVELS or count >> (levels + 1) < MIN_BASE


def half_octave(value: int) -> int:
    """1 + floor(2 log2 value), the half octave beginning at 181/128."""
    if value == 0:
        return 0
    octave = value.bit_length() - 1
    return 1 + 2 * octave + (Fraction(value, 1 << octave) >= Fraction(181, 128))


@given(st.lists(st.integers(0, 2**53 - 1), min_size=1, max_size=50))
def test_ladder(values: list[int]) -> None:
    array = np.array(values, np.int64)
    assert ladder(array, 200).tolist() == [half_octave(v) for v in values]
    assert ladder(array, 5).tolist() == [min(half_octave(v), 4) for v in values]


def test_ladder_at_its_steps() -> None:
    assert ladder(np.array([0, 1, 2, 3, 4, 5, 6, 8, 180, 181, 182]), 100).tolist() == [
        0,
        1,
        3,
        4,
        5,
        5,
        6,
        7,
        15,
        16,
        16,
    ]

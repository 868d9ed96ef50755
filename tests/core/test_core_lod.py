"""Levels of detail of the core (spec section 9.2)."""

from __future__ import annotations

import numpy as np
import pytest

from dfcgs_codec.transform.lod import LevelsOfDetail, build_levels, order_levels
from tests.core.machines import CORRUPT, Arena, call, int32

pytestmark = pytest.mark.usefixtures("both_machines")

COUNTS = (0, 1, 31, 63, 64, 65, 127, 500, 4097, 20_000)


def _positions(count: int, reach: int, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    walk = rng.integers(-reach, reach + 1, (count, 3)) // (1 + rng.integers(0, 5, (count, 1)))
    walk[rng.random(count) < 0.3] = 7
    return walk


def _weights(positions: np.ndarray) -> np.ndarray:
    weights = np.zeros((len(positions), 8), np.int16)
    arena = Arena.of(12 * len(positions) + 1000)
    assert call("distance_weights", arena, int32(positions), len(positions), weights) == 0
    assert arena.used == 0
    return weights


def _first(count: int, step: int) -> int:
    return -(-count // step)


@pytest.mark.parametrize("reach", [0, 3, 1000, 1 << 20, 1 << 29, (1 << 30) - 1])
@pytest.mark.parametrize("count", COUNTS)
def test_distance_weights(count: int, reach: int) -> None:
    positions = _positions(count, reach, count)
    weights = _weights(positions)
    for level in build_levels(positions).levels:
        first, rows = _first(count, level.step), level.weights.shape[1]
        assert np.array_equal(weights[first : first + rows].T, level.weights)


def _held(lod: LevelsOfDetail, values: np.ndarray, weights: np.ndarray | None) -> None:
    column, count = int32(values), len(values)
    for number, level in zip(range(len(lod.levels) - 1, -1, -1), lod.levels, strict=True):
        window = np.zeros(_first(count, level.step) + 8, np.int32)
        size = call("window", column, count, number, window)
        own = None if weights is None else np.ascontiguousarray(weights[_first(count, level.step) :])
        rows = len(values[level.rows])
        mean, deviation, alone = np.zeros((3, rows), np.int64)
        call("statistics", window, size, own, rows, mean, deviation)
        call("means", window, size, own, rows, alone)
        wanted = level.statistics(values)
        assert np.array_equal(mean, wanted[0])
        assert np.array_equal(alone, wanted[0])
        assert np.array_equal(deviation, wanted[1])


@pytest.mark.parametrize("reach", [0, 1, 100, (1 << 14) - 1, 1 << 14, (1 << 21) - 1, 1 << 21, (1 << 30) - 2])
@pytest.mark.parametrize("count", COUNTS)
def test_statistics(count: int, reach: int) -> None:
    rng = np.random.default_rng(count)
    values = np.where(rng.random(count) < 0.1, reach, rng.integers(-reach, reach + 1, count))
    positions = _positions(count, 1000, count)
    _held(build_levels(positions), values, _weights(positions))
    _held(order_levels(count), values, None)


def test_no_memory_is_said() -> None:
    positions = np.zeros((100, 3), np.int32)
    assert call("distance_weights", Arena.of(64), positions, 100, np.zeros((100, 8), np.int16)) > CORRUPT

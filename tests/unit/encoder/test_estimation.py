from __future__ import annotations

import itertools

import numpy as np
import pytest

from dfcgs_codec.codec.columns.side_information import (
    ABSENT_LEVEL,
    code_tables,
    frequencies_from_levels,
)
from dfcgs_codec.encoder.columns.side_information import (
    fit_histogram_levels,
    fit_split_bias,
    fit_tables,
    fit_weights,
)
from dfcgs_codec.entropy.coder import RangeWriter
from dfcgs_codec.entropy.symbols import code_residuals
from dfcgs_codec.entropy.tables import NUM_SCALES, NUM_SHAPES, Shape


def cost(residuals: np.ndarray, contexts: np.ndarray, tables: np.ndarray) -> int:
    """Bytes of tables and residuals, really coded."""
    writer = RangeWriter()
    complete = code_tables(writer, tables, len(tables))
    code_residuals(writer, residuals, contexts, complete)
    return len(writer.getvalue())


def draw(shape: Shape, sigma: float, count: int, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    if shape == Shape.GAUSSIAN:
        values = rng.normal(size=count) * sigma
    else:
        spread = 1.0 if shape == Shape.LAPLACE else rng.choice([0.5, 2.0], count)
        values = rng.laplace(size=count) * sigma / np.sqrt(2) * spread
    return np.rint(values).astype(np.int64)


@pytest.mark.parametrize("shape", Shape)
@pytest.mark.parametrize("sigma", [0.1, 1.0, 7.0, 60.0, 1000.0, 1e5])
def test_one_table_is_near_the_best_of_all(shape: Shape, sigma: float) -> None:
    residuals = draw(shape, sigma, 400, 1)
    contexts = np.zeros(400, np.uint8)
    found = cost(residuals, contexts, fit_tables(residuals, contexts, 1))
    every = [cost(residuals, contexts, np.array([t])) for t in range(NUM_SHAPES * NUM_SCALES)]
    assert found <= 1.01 * min(every) + 4


def test_tables_of_several_contexts_are_near_the_best() -> None:
    rng = np.random.default_rng(0)
    contexts = np.repeat(np.arange(3), 120).astype(np.uint8)
    residuals = np.rint(rng.laplace(size=360) * np.array([0.5, 2, 6])[contexts]).astype(np.int64)
    found = cost(residuals, contexts, fit_tables(residuals, contexts, 3))
    scales = range(12, 54, 3)
    best = min(
        cost(residuals, contexts, NUM_SCALES + np.array(choice))
        for choice in itertools.product(scales, repeat=3)
    )
    assert found <= 1.01 * best + 4


def test_tables_outside_the_contexts_used_are_minus_one() -> None:
    contexts = np.array([3, 3, 5], np.uint8)
    tables = fit_tables(np.array([1, 0, -2]), contexts, 9)
    assert (tables >= 0).tolist() == [False, False, False, True, True, True, False, False, False]
    assert (fit_tables(np.zeros(0, np.int64), np.zeros(0, np.uint8), 4) >= 0).tolist() == [
        True,
        False,
        False,
        False,
    ]


@pytest.mark.parametrize("largest", [2**20, 2**29, 2**31])
def test_huge_residuals_have_tables_too(largest: int) -> None:
    residuals = np.array([0, largest, -largest, 5])
    contexts = np.zeros(4, np.uint8)
    assert cost(residuals, contexts, fit_tables(residuals, contexts, 1)) <= 32


def test_weights_are_least_squares() -> None:
    rng = np.random.default_rng(0)
    features = [rng.integers(-500, 500, 3000) for _ in range(4)]
    true = np.array([256, -64, 0, 300])
    goal = sum(f * w for f, w in zip(features, true.tolist(), strict=True)) // 256
    assert np.abs(fit_weights(features, goal) - true).max() <= 1


def test_weights_that_do_not_pay_are_zero() -> None:
    rng = np.random.default_rng(0)
    noise = [rng.integers(-500, 500, 2000) for _ in range(5)]
    assert not fit_weights(noise, rng.integers(-500, 500, 2000)).any()
    assert not fit_weights([np.arange(8), np.ones(8, np.int64)], np.zeros(8, np.int64)).any()


def test_weights_of_degenerate_features_are_finite() -> None:
    same = np.arange(1000)
    weights = fit_weights([same, same, np.zeros(1000, np.int64)], same)
    prediction = (same * weights[0] + same * weights[1]) / 256
    assert np.abs(prediction - same).max() <= 8
    assert weights[2] == 0


def test_histogram_levels_give_back_the_frequencies() -> None:
    rng = np.random.default_rng(0)
    share = np.array([0.5, 0.25, 0.2, 0.05, 0.0])
    symbols = rng.choice(5, 20000, p=share)
    levels = fit_histogram_levels(symbols, np.zeros(20000, np.uint8), np.array([0]), 5)
    assert levels[0, 4] == ABSENT_LEVEL
    coded = frequencies_from_levels(levels[0]) / 2**24
    entropy = -(share[:4] * np.log2(share[:4])).sum()
    assert -(share[:4] * np.log2(coded[:4])).sum() <= 1.01 * entropy


def test_histogram_levels_of_each_context() -> None:
    contexts = np.array([1, 1, 1, 4, 4], np.uint8)
    levels = fit_histogram_levels(np.array([0, 0, 0, 2, 2]), contexts, np.array([1, 4]), 3)
    assert levels.tolist() == [[0, ABSENT_LEVEL, ABSENT_LEVEL], [ABSENT_LEVEL, ABSENT_LEVEL, 0]]


def test_the_bias_fits_how_cells_split() -> None:
    counts = np.full(4000, 8)
    even = np.random.default_rng(0).binomial(8, 0.5, 4000)
    uneven = np.random.default_rng(1).choice([0, 8], 4000)
    assert fit_split_bias(counts, even) != fit_split_bias(counts, uneven)

from __future__ import annotations

import hashlib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from dfcgs_codec.entropy.tables import (
    FREQUENCY_BITS,
    MAX_SPLIT_COUNT,
    NUM_BASE_SCALES,
    NUM_SCALES,
    SPLIT_ALPHAS,
    Shape,
    frequencies_from_cdf,
    frequencies_from_weights,
    scale_table,
    split_scale,
    split_table,
)

ONE = 1 << FREQUENCY_BITS
#: part of the format: other tables are another bitstream version
TABLES_SHA256 = "7016b9a8c8d7f40258f7ca37faae9adc65c3fcda1d2c9af2230d2626a5fc5f5b"
SPLITS_SHA256 = "647110fe86a9ef4ebc97689f3784f78154fd8d0c5f969d6f93a0c8cd10f41361"
BASE_TABLES = [(shape, scale) for shape in Shape for scale in range(NUM_BASE_SCALES)]
SPLIT_TABLES = [(bias, n) for bias in range(len(SPLIT_ALPHAS)) for n in range(1, MAX_SPLIT_COUNT + 1)]


def sha256(tables: list[np.ndarray]) -> str:
    return hashlib.sha256(b"".join(table.astype("<u4").tobytes() for table in tables)).hexdigest()


def test_scale_tables_are_frozen() -> None:
    assert sha256([scale_table(*key) for key in BASE_TABLES]) == TABLES_SHA256


def test_split_tables_are_frozen() -> None:
    assert sha256([split_table(*key) for key in SPLIT_TABLES]) == SPLITS_SHA256


def check_frequencies(table: np.ndarray) -> None:
    assert table.sum() == ONE
    assert table.min() >= 1
    assert np.abs(table - table[::-1]).max() <= 1


@pytest.mark.parametrize("shape", Shape)
def test_scale_tables_are_positive_complete_and_symmetric(shape: Shape) -> None:
    for scale in range(NUM_BASE_SCALES):
        check_frequencies(scale_table(shape, scale))


def test_split_tables_are_positive_complete_and_symmetric() -> None:
    for key in SPLIT_TABLES:
        check_frequencies(split_table(*key))


def expected(shape: Shape, scale: int, size: int) -> np.ndarray:
    """Probabilities of the symbols from the distribution itself; the end symbols hold the tails."""
    k = size // 2
    sigma = 2.0 ** ((scale - 26) / 6)
    edges = np.arange(-k, k + 2) - 0.5

    def laplace(deviation: float) -> np.ndarray:
        return stats.laplace(scale=deviation / np.sqrt(2)).cdf(edges)

    cdf = {
        Shape.GAUSSIAN: lambda: stats.norm(scale=sigma).cdf(edges),
        Shape.LAPLACE: lambda: laplace(sigma),
        Shape.HEAVY: lambda: (laplace(sigma / 2) + laplace(2 * sigma)) / 2,
    }[shape]()
    cdf[0], cdf[-1] = 0, 1
    return np.diff(cdf)


def bits_lost(true: np.ndarray, table: np.ndarray) -> float:
    """Kullback-Leibler divergence, bits per symbol."""
    known = true > 0
    return float((true[known] * np.log2(true[known] / (table[known] / ONE))).sum())


@pytest.mark.parametrize("shape", Shape)
def test_scale_tables_are_their_distributions(shape: Shape) -> None:
    for scale in range(NUM_BASE_SCALES):
        table = scale_table(shape, scale)
        assert bits_lost(expected(shape, scale, len(table)), table) < 1e-5


@pytest.mark.parametrize(("shape", "reach"), [(Shape.GAUSSIAN, 5.5), (Shape.LAPLACE, 8), (Shape.HEAVY, 12)])
def test_tables_end_where_hardly_anything_is_left(shape: Shape, reach: float) -> None:
    for scale in range(NUM_BASE_SCALES):
        size = len(scale_table(shape, scale))
        k = reach * 2.0 ** ((scale - 26) / 6)
        assert size % 2 == 1
        assert size // 2 == min(511, 2 + int(k)) or abs(size // 2 - k - 2) <= 1


def test_split_tables_are_beta_binomial() -> None:
    for bias, count in SPLIT_TABLES:
        alpha = SPLIT_ALPHAS[bias] / 8
        true = stats.betabinom(count, alpha, alpha).pmf(np.arange(count + 1))
        assert bits_lost(true, split_table(bias, count)) < 1e-6


def test_wider_scales_have_raw_low_bits() -> None:
    assert [split_scale(s) for s in (0, 63, 64, 69, 70, 159)] == [
        (0, 0),
        (63, 0),
        (58, 1),
        (63, 1),
        (58, 2),
        (63, 16),
    ]


def test_each_scale_is_a_sixth_of_an_octave_above_the_one_before() -> None:
    sigmas = [2.0 ** ((base - 26) / 6 + low) for base, low in map(split_scale, range(NUM_SCALES))]
    assert np.allclose(np.diff(np.log2(sigmas)), 1 / 6)


@given(st.lists(st.integers(0, 2**31 - 1), min_size=1, max_size=1024).filter(any))
def test_frequencies_from_weights(weights: list[int]) -> None:
    frequencies = frequencies_from_weights(np.array(weights, np.int64))
    assert frequencies.sum() == ONE
    assert frequencies.min() >= 1
    share = np.array(weights) / sum(weights)
    assert np.abs(frequencies - share * (ONE - len(weights)) - 1).max() <= 1


@given(st.lists(st.integers(0, 2**32), min_size=1, max_size=600))
def test_frequencies_from_cdf(inner: list[int]) -> None:
    cdf = np.array([0, *sorted(inner), 1 << 32], np.int64)
    frequencies = frequencies_from_cdf(cdf)
    assert frequencies.sum() == ONE
    assert frequencies.min() >= 1

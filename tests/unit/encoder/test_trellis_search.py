from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from dfcgs_codec.encoder.intra import trellis_search
from dfcgs_codec.encoder.intra.intra_plan import ColumnQuantiser
from dfcgs_codec.encoder.intra.trellis_search import context_sizes, search
from dfcgs_codec.encoder.residual.quantise import ZeroBin
from dfcgs_codec.transform.trellis import CHAIN_LENGTH, FEWEST_SYMBOLS, second_quantisers


def values(symbols: np.ndarray) -> np.ndarray:
    return symbols - 0.5 * np.sign(symbols) * second_quantisers(symbols)


def searched(residuals: np.ndarray, size: float) -> np.ndarray:
    return search(residuals, np.zeros(len(residuals), np.uint8), np.array([size]))


def entropy(symbols: np.ndarray) -> float:
    shares = np.unique(symbols, return_counts=True)[1] / len(symbols)
    return float(-(shares * np.log2(shares)).sum())


def laplace(count: int, size: float) -> np.ndarray:
    return np.random.default_rng(3).laplace(0, size, count)


@pytest.mark.parametrize("seed", range(5))
def test_no_path_is_nearer(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """One chain, errors alone: against every path through the first seven symbols."""
    monkeypatch.setattr(trellis_search, "BIT_WORTH", 0.0)
    residuals = np.random.default_rng(seed).uniform(-1.5, 1.5, 7)
    found = searched(residuals, 1.0)
    error = ((values(found) - residuals) ** 2).sum()
    for symbols in product(range(-2, 3), repeat=7):
        path = np.array(symbols)
        assert ((values(path) - residuals) ** 2).sum() >= error - 1e-6


@pytest.mark.parametrize(
    ("size", "saved"), [(0.25, 0.015), (0.5, 0.05), (1.0, 0.1), (4.0, 0.15), (30.0, 0.15)]
)
def test_bits_are_saved_at_the_same_error(size: float, saved: float) -> None:
    residuals = laplace(40_000, size)
    found = searched(residuals, size)
    error = np.mean((values(found) - residuals) ** 2)
    steps = np.geomspace(0.5, 1.3, 60)
    alone = [ZeroBin(0.6).quantise_real(residuals / step) for step in steps]
    errors = [np.mean((s * step - residuals) ** 2) for s, step in zip(alone, steps, strict=True)]
    assert errors[0] < error < errors[-1]
    assert entropy(found) < np.interp(error, errors, [entropy(s) for s in alone]) - saved


@pytest.mark.parametrize("size", [0.05, 0.4, 5.0])
def test_no_error_is_large(size: float) -> None:
    residuals = np.concatenate([laplace(3000, size), laplace(500, 40 * size), [1e6, -1e7, 1e8]])
    found = search(residuals, np.zeros(len(residuals), np.uint8), np.array([size]))
    assert np.abs(values(found) - residuals).max() <= 0.85


def test_far_values_do_not_blur_the_choice_of_others() -> None:
    residuals = laplace(CHAIN_LENGTH, 1.0)
    alone = search(residuals, np.zeros(CHAIN_LENGTH, np.uint8), np.array([1.0]))
    residuals[-1] = 1e9
    together = search(residuals, np.zeros(CHAIN_LENGTH, np.uint8), np.array([1.0]))
    assert np.mean(alone[:-8] == together[:-8]) > 0.95


def test_chains_are_independent() -> None:
    residuals = laplace(10 * CHAIN_LENGTH, 2.0)
    together = searched(residuals, 2.0)
    for chain in (0, 7):
        alone = searched(residuals[chain::10], 2.0)
        assert np.array_equal(alone, together[chain::10])


def test_far_values_are_reached() -> None:
    residuals = laplace(1000, 1.0) * 1e9
    found = searched(residuals, 1.0)
    assert np.abs(values(found) - residuals).max() <= 1.0


def test_few_symbols_are_left_to_one_quantiser() -> None:
    residuals, steps = np.arange(FEWEST_SYMBOLS - 1), np.full(FEWEST_SYMBOLS - 1, 7)
    contexts = np.zeros(len(steps), np.uint8)
    quantiser = ColumnQuantiser(residuals, ZeroBin(0.6), alternating=True)
    found = quantiser.choose(slice(None), np.zeros_like(residuals), steps, contexts)
    assert np.array_equal(found, ZeroBin(0.6).quantise(residuals, steps))


def test_sizes_are_those_of_a_context() -> None:
    contexts = np.repeat(np.array([3, 9, 20], np.uint8), [5000, 5000, 2])
    residuals = laplace(10_002, 1.0) * np.repeat([0.3, 8.0, 500.0], [5000, 5000, 2])
    sizes = context_sizes(residuals, contexts)
    assert sizes[3] == pytest.approx(np.abs(residuals[:5000]).mean(), rel=0.05)
    assert sizes[9] == pytest.approx(np.abs(residuals[5000:10_000]).mean(), rel=0.05)
    assert sizes[20] < np.abs(residuals[-2:]).mean()

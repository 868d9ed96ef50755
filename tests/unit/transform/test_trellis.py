from __future__ import annotations

import numpy as np
import pytest

from dfcgs_codec.transform.trellis import (
    CHAIN_LENGTH,
    FEWEST_SYMBOLS,
    num_chains,
    second_quantisers,
    step_values,
)


def by_recurrence(symbols: list[int]) -> list[int]:
    """Of one chain, as the specification says it."""
    second: list[int] = []
    for t in range(len(symbols)):
        a = [second[t - back] if t >= back else 0 for back in (1, 3)]
        second.append(a[0] ^ a[1] ^ (symbols[t - 2] & 1 if t >= 2 else 0))
    return second


@pytest.mark.parametrize("count", [1, 2, 127, 128, 129, 1000, 5000])
def test_turns_follow_from_parities(count: int) -> None:
    symbols = np.random.default_rng(count).integers(-5, 6, count)
    second, chains = second_quantisers(symbols), num_chains(count)
    assert chains * CHAIN_LENGTH >= count > (chains - 1) * CHAIN_LENGTH
    for chain in range(chains):
        assert second[chain::chains].tolist() == by_recurrence(symbols[chain::chains].tolist())


def test_even_symbols_stay_with_the_first_quantiser() -> None:
    assert not second_quantisers(np.full(600, -2)).any()


def test_values_of_the_second_lie_half_a_step_nearer_to_zero() -> None:
    rng = np.random.default_rng(0)
    symbols, steps = rng.integers(-4, 5, FEWEST_SYMBOLS), rng.integers(1, 90, FEWEST_SYMBOLS)
    second = second_quantisers(symbols)
    assert 0.3 < second.mean() < 0.7
    nearer = np.sign(symbols) * second
    expected = np.floor((symbols - nearer / 2) * steps).astype(np.int64)
    assert np.array_equal(step_values(symbols, steps, alternating=True), expected)
    assert np.array_equal(step_values(symbols, steps, alternating=False), symbols * steps)


def test_few_symbols_have_the_first_alone() -> None:
    symbols, steps = np.full(FEWEST_SYMBOLS - 1, 3), np.full(FEWEST_SYMBOLS - 1, 5)
    assert (step_values(symbols, steps, alternating=True) == 15).all()

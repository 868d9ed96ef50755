from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from dfcgs_codec.bitstream.constants import STATE_LIMIT
from dfcgs_codec.codec.component import EarlierPasses, code_component
from dfcgs_codec.codec.symbols import SymbolCoder
from dfcgs_codec.transform.lod import LevelsOfDetail, build_levels, order_levels
from tests.helpers import check_walk, make_cloud


def check(target: np.ndarray, lod: LevelsOfDetail, earlier: EarlierPasses | None = None) -> int:
    """Round trip with what was coded before; returns bytes."""
    before = earlier or EarlierPasses(len(target))

    def code(coder: SymbolCoder, writing: bool) -> tuple[np.ndarray, np.ndarray]:
        passes = EarlierPasses(
            len(target), list(before.residuals), list(before.magnitudes), list(before.hints)
        )
        found = code_component(coder, target if writing else None, lod, passes)
        assert np.array_equal(found, target)
        assert len(passes.residuals) == len(before.residuals) + 1
        return found, passes.residuals[-1]

    return check_walk(code, lambda a, b: np.array_equal(a[0], b[0]) and np.array_equal(a[1], b[1]))


def smooth(count: int, seed: int = 0) -> np.ndarray:
    """A random walk: neighbours in order are alike."""
    return np.cumsum(np.random.default_rng(seed).integers(-9, 10, count))


@given(st.data())
def test_any_values(data: st.DataObject) -> None:
    limit = data.draw(st.sampled_from([0, 1, 100, STATE_LIMIT]))
    elements = st.integers(-limit, limit)
    target = data.draw(hnp.arrays(np.int64, st.integers(1, 90), elements=elements))
    check(target, order_levels(len(target)))


@pytest.mark.parametrize("count", [1, 2, 31, 33, 64, 65, 1000])
def test_any_count(count: int) -> None:
    positions = np.rint(make_cloud(count).positions * 1000).astype(np.int64)
    check(smooth(count), build_levels(positions))


def test_a_constant_costs_almost_nothing() -> None:
    assert check(np.full(5000, 12345), order_levels(5000)) <= 24


def test_neighbours_help_where_values_are_smooth() -> None:
    walk = smooth(4000)
    mixed = np.random.default_rng(1).permutation(walk)
    assert check(walk, order_levels(4000)) < 0.75 * check(mixed, order_levels(4000))


def test_earlier_components_help_where_they_are_alike() -> None:
    rng = np.random.default_rng(0)
    first = rng.integers(-1000, 1000, 3000)
    second = first + rng.integers(-3, 4, 3000)
    earlier = EarlierPasses(3000)
    earlier.add(first - int(np.median(first)))
    alone = check(second, order_levels(3000))
    assert check(second, order_levels(3000), earlier) < 0.5 * alone


def test_hints_help_where_they_tell_the_magnitude() -> None:
    rng = np.random.default_rng(0)
    hint = rng.choice([1, 200], 3000)
    target = np.rint(rng.normal(size=3000) * hint).astype(np.int64)
    alone = check(target, order_levels(3000))
    assert check(target, order_levels(3000), EarlierPasses(3000, hints=[hint])) < 0.85 * alone

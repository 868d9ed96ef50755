from __future__ import annotations

import time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from dfcgs_codec.bitstream.constants import MAX_SORT_SHIFT, STATE_LIMIT
from dfcgs_codec.bitstream.frame_headers import SortGrid
from dfcgs_codec.codec.columns.coder import SymbolCoder
from dfcgs_codec.codec.intra.positions import code_positions
from dfcgs_codec.encoder.residual.quantise import order_of, plan_grid
from lab.small_clouds import coincident_cloud, make_cloud, with_outliers
from tests.helpers import check_walk


def check(indices: np.ndarray, grid: SortGrid) -> int:
    """Round trip of `indices` in canonical order; returns bytes."""
    ordered = indices[order_of(indices, grid)]

    def code(coder: SymbolCoder, writing: bool) -> np.ndarray:
        found = code_positions(coder, ordered if writing else None, grid, len(ordered))
        assert np.array_equal(found, ordered)
        return found

    return check_walk(code, np.array_equal)


def on_grid(positions: np.ndarray, per_unit: int = 1000) -> np.ndarray:
    return np.rint(positions.astype(np.float64) * per_unit).astype(np.int64)


@st.composite
def indices(draw: st.DrawFn, limit: int) -> np.ndarray:
    shape = st.tuples(st.integers(1, 40), st.just(3))
    return draw(hnp.arrays(np.int64, shape, elements=st.integers(-limit, limit)))


@given(st.data(), st.sampled_from([0, 1, 3, 1000, STATE_LIMIT]), st.sampled_from([1, 4, 21]))
def test_planned_grids_with_duplicates_and_outliers(data: st.DataObject, limit: int, max_bits: int) -> None:
    positions = data.draw(indices(limit))
    check(positions, plan_grid(positions, max_bits))


@given(st.data())
def test_any_grid_with_excess(data: st.DataObject) -> None:
    positions = data.draw(indices(STATE_LIMIT))
    shift, bits = data.draw(st.integers(0, MAX_SORT_SHIFT)), data.draw(st.integers(0, 21))
    near = st.integers(-(STATE_LIMIT >> shift), STATE_LIMIT >> shift)
    origin = data.draw(st.tuples(near, near, near))
    check(positions, SortGrid(shift, bits, origin, True))


@pytest.mark.parametrize("count", [1, 2, 3, 4, 5, 32, 33, 34, 500])
def test_counts_around_the_table_classes(count: int) -> None:
    positions = on_grid(make_cloud(count).positions)
    check(positions, plan_grid(positions))


def test_one_gaussian_costs_its_raw_bits_only() -> None:
    grid = SortGrid(0, 10, (0, 0, 0), False)
    assert check(np.array([[1, 500, 1023]]), grid) <= 8
    assert check(np.array([[7, -7, 70]]), plan_grid(np.array([[7, -7, 70]]))) == 0


def test_far_outliers_become_excess() -> None:
    positions = on_grid(with_outliers(make_cloud(500), 3, 1e5).positions)
    grid = plan_grid(positions)
    assert grid.has_excess
    near = plan_grid(on_grid(make_cloud(500).positions))
    assert check(positions, grid) < check(on_grid(make_cloud(500).positions), near) + 150


def test_a_wide_scene_has_raw_low_bits() -> None:
    positions = np.random.default_rng(0).integers(-STATE_LIMIT, STATE_LIMIT, (300, 3))
    grid = plan_grid(positions)
    assert grid.shift > 0
    check(positions, grid)


def test_many_coincident_gaussians_are_quick_and_cost_nothing() -> None:
    positions = on_grid(with_outliers(coincident_cloud(200_000), 1).positions)
    start = time.perf_counter()
    assert check(positions, plan_grid(positions)) < 200
    assert time.perf_counter() - start < 20


def test_density_is_paid_for_not_extent() -> None:
    clustered = on_grid(make_cloud(2000).positions, 30)
    spread = on_grid(make_cloud(2000).positions, 100_000)
    assert check(clustered, plan_grid(clustered)) < 0.5 * check(spread, plan_grid(spread))


def test_positions_cost_less_than_independent_coordinates() -> None:
    positions = np.random.default_rng(0).integers(0, 1 << 12, (4000, 3))
    grid = SortGrid(0, 12, (0, 0, 0), False)
    saved_by_sorting = np.log2(np.arange(1, 4001)).sum() / 8
    assert check(positions, grid) < 4000 * 36 / 8 - 0.95 * saved_by_sorting

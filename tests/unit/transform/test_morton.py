from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from dfcgs_codec.transform.morton import canonical_order, morton_cells, morton_keys

CELLS = hnp.arrays(np.int64, st.tuples(st.integers(0, 50), st.just(3)), elements=st.integers(0, 2**21 - 1))
FEW = hnp.arrays(np.int64, st.tuples(st.integers(1, 40), st.just(3)), elements=st.integers(0, 3))


def interleave(x: int, y: int, z: int) -> int:
    return sum(((x >> b & 1) << 2 | (y >> b & 1) << 1 | (z >> b & 1)) << (3 * b) for b in range(21))


@given(CELLS)
def test_keys_interleave_x_y_z_from_the_top(cells: np.ndarray) -> None:
    assert morton_keys(cells).tolist() == [interleave(*row) for row in cells.tolist()]


@given(CELLS)
def test_cells_are_the_inverse_of_keys(cells: np.ndarray) -> None:
    assert np.array_equal(morton_cells(morton_keys(cells)), cells)


def test_the_largest_key_has_63_bits() -> None:
    corner = np.full((1, 3), 2**21 - 1, np.int64)
    assert morton_keys(corner).tolist() == [2**63 - 1]


@given(FEW, st.integers(0, 2))
def test_ties_go_by_coordinates_then_by_index(positions: np.ndarray, shift: int) -> None:
    keys = morton_keys(positions >> shift)
    expected = sorted(range(len(keys)), key=lambda i: (keys[i], *positions[i].tolist(), i))
    assert canonical_order(keys, positions).tolist() == expected


@given(FEW, st.randoms(use_true_random=False))
def test_the_order_does_not_depend_on_the_input_order(positions: np.ndarray, random) -> None:
    mixed = positions[random.sample(range(len(positions)), len(positions))]
    sorted_rows = [rows[canonical_order(morton_keys(rows >> 1), rows)] for rows in (positions, mixed)]
    assert np.array_equal(*sorted_rows)


def test_the_input_is_left_alone() -> None:
    cells = np.array([[3, 2, 1], [0, 1, 2]], np.int64)
    keys = morton_keys(cells)
    morton_cells(keys)
    assert cells.tolist() == [[3, 2, 1], [0, 1, 2]]
    assert keys.tolist() == morton_keys(cells).tolist()

from __future__ import annotations

import numpy as np
import pytest

from dfcgs_codec.array_types import Int64
from dfcgs_codec.transform.control_points import (
    CELL_LIMIT,
    GATHER_WEIGHT_BITS,
    NUM_GATHERED,
    control_cells,
    farthest_points,
    gather_from,
    nearest,
)
from dfcgs_codec.transform.morton import canonical_order, morton_keys


def random_cells(count: int, seed: int = 0, reach: int = 2000) -> Int64:
    cells = np.random.default_rng(seed).integers(0, reach, (count, 3))
    return cells[canonical_order(morton_keys(cells), cells)]


def lattice(side: int) -> Int64:
    """All points of a cubic lattice: nearly all distances tie."""
    return np.stack(np.meshgrid(*[np.arange(side) * 8] * 3), axis=-1).reshape(-1, 3)


def squared(a: Int64, b: Int64) -> Int64:
    return ((a[:, None] - b[None]) ** 2).sum(axis=2)


def farthest_by_looking_at_all(cells: Int64, count: int) -> list[int]:
    chosen, distance = [0], squared(cells, cells[:1])[:, 0]
    while len(chosen) < count and distance.max() > 0:
        chosen.append(int(distance.argmax()))
        distance = np.minimum(distance, squared(cells, cells[chosen[-1:]])[:, 0])
    return chosen


@pytest.mark.parametrize("cells", [random_cells(3000), random_cells(700, 1, 6), lattice(9)])
def test_farthest_points_are_exact(cells: Int64) -> None:
    assert farthest_points(cells, 80).tolist() == farthest_by_looking_at_all(cells, 80)


def test_every_prefix_is_a_set_of_its_own() -> None:
    cells = random_cells(1000)
    many = farthest_points(cells, 100)
    for count in (1, 2, 17, 64):
        assert farthest_points(cells, count).tolist() == many[:count].tolist()


def test_farthest_points_end_where_all_are_reached() -> None:
    cells = np.repeat(np.array([[0, 0, 0], [5, 0, 0], [9, 9, 9]]), 400, axis=0)
    assert farthest_points(cells, 50).tolist() == [0, 800, 400]
    assert farthest_points(np.zeros((200_000, 3), np.int64), 3000).tolist() == [0]


@pytest.mark.parametrize("count", [1, 2, 5])
@pytest.mark.parametrize("cells", [random_cells(500), random_cells(300, 2, 4), lattice(7)])
def test_nearest_breaks_ties_by_rank(cells: Int64, count: int) -> None:
    control = cells[farthest_points(cells, len(cells) // 4)]
    ranks, distances = nearest(cells, control, count)
    all_distances = squared(cells, control)
    expected = np.argsort(all_distances, axis=1, kind="stable")[:, :count]
    assert np.array_equal(ranks, expected)
    assert np.array_equal(distances, np.take_along_axis(all_distances, expected, 1))


@pytest.mark.parametrize("num_control", [1, 2, 3, 4, 5, 40])
def test_weights_sum_to_one_and_fall_with_distance(num_control: int) -> None:
    cells = random_cells(300)
    control = cells[farthest_points(cells, num_control)]
    gathering = gather_from(cells, control)
    assert gathering.ranks.shape == gathering.weights.shape == (NUM_GATHERED, 300)
    assert (gathering.weights.sum(axis=0) == 1 << GATHER_WEIGHT_BITS).all()
    assert gathering.weights.min() >= 0
    assert (np.diff(gathering.weights, axis=0) <= 0).all()
    if num_control < NUM_GATHERED:
        assert not gathering.weights[num_control:].any()
        assert (gathering.ranks[num_control:] == gathering.ranks[0]).all()


def test_a_point_on_a_control_point_follows_it_most() -> None:
    cells = random_cells(200)
    points = farthest_points(cells, 20)
    gathering = gather_from(cells[points], cells[points])
    assert gathering.ranks[0].tolist() == list(range(20))
    assert (gathering.weights[0] > 1 << (GATHER_WEIGHT_BITS - 1)).all()


def test_cells_are_clipped_around_their_center() -> None:
    positions = np.array([[0, 0, 0], [64, -64, 7], [1 << 29, -(1 << 29), 0]])
    cells = control_cells(positions, positions[1], 3)
    assert cells.tolist() == [[-8, 8, -1], [0, 0, 0], [CELL_LIMIT, -CELL_LIMIT, -1]]

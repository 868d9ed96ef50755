"""Whom a control point's motion is spread over, against the definition."""

from __future__ import annotations

from decimal import Decimal, localcontext

import numpy as np
import pytest

from dfcgs_codec.bitstream.constants import MAX_DECAY_EXPONENT, MAX_NEIGHBOURS
from dfcgs_codec.transform.control_points import CELL_LIMIT
from dfcgs_codec.transform.spreading import (
    DECAY,
    DECAY_ARGUMENT_BITS,
    DECAY_FRACTION_BITS,
    SPREAD_WEIGHT_BITS,
    Spreading,
    decayed,
    spread_from,
)


def scenes() -> dict[str, np.ndarray]:
    rng = np.random.default_rng(0)
    spread = np.rint(rng.normal(size=(2000, 3)) * 200).astype(np.int64)
    lattice = np.stack(np.meshgrid(*[np.arange(12)] * 3), axis=-1).reshape(-1, 3).astype(np.int64)
    crowded = spread.copy()
    crowded[::2] = crowded[1]
    ends = np.array([[CELL_LIMIT] * 3, [-CELL_LIMIT] * 3, [0, 0, 0]] * 4)
    return {"spread": spread, "lattice": lattice, "crowded": crowded, "ends": ends, "one": spread[:1]}


SCENES = scenes()


def test_the_table_is_the_exponential() -> None:
    with localcontext() as context:
        context.prec = 40
        exact = [(-(Decimal(2) ** (bit - DECAY_ARGUMENT_BITS))).exp() for bit in range(len(DECAY))]
        scaled = [int((value * 2**DECAY_FRACTION_BITS).to_integral_value()) for value in exact]
    assert tuple(scaled) == DECAY


def test_decay_is_close_to_the_exponential_and_never_rises() -> None:
    distance = np.arange(0, 1 << 17, 3)
    found = decayed(distance)
    exact = np.exp(-distance / 2.0**DECAY_ARGUMENT_BITS)
    assert np.abs(found / 2.0**DECAY_FRACTION_BITS - exact).max() < 5e-7
    assert (np.diff(found) <= 8).all()
    assert found[0] == 1 << DECAY_FRACTION_BITS
    assert not found[distance >= 16 << DECAY_ARGUMENT_BITS].any()


@pytest.mark.parametrize("scene", SCENES)
@pytest.mark.parametrize("count", [1, 4, 30, MAX_NEIGHBOURS])
def test_neighbours_are_the_nearest_the_first_of_equals(scene: str, count: int) -> None:
    cells = SCENES[scene]
    points = np.arange(0, len(cells), 7)
    found = spread_from(cells, points, count, -6)
    for rank, point in enumerate(points):
        squared = ((cells - cells[point]) ** 2).sum(axis=1)
        expected = np.lexsort((np.arange(len(cells)), squared))[:count]
        assert np.array_equal(found.gaussians[rank], expected)


@pytest.mark.parametrize("scene", SCENES)
@pytest.mark.parametrize("exponent", [-MAX_DECAY_EXPONENT, -8, -5, 0, MAX_DECAY_EXPONENT])
def test_weights_are_the_papers(scene: str, exponent: int) -> None:
    cells = SCENES[scene]
    points = np.arange(0, len(cells), 7)
    found = spread_from(cells, points, 30, exponent)
    assert (found.weights.sum(axis=1) == 1 << SPREAD_WEIGHT_BITS).all()
    assert found.weights.min() >= 0
    apart = np.linalg.norm(cells[found.gaussians] - cells[points][:, None], axis=2) * 2.0**exponent
    exact = np.exp(-apart)
    exact /= exact.sum(axis=1, keepdims=True)
    # a sixteenth of a cell, 30 roundings down
    slack = min(1.0, 2.0 ** (exponent - 3)) * exact.max() + 40 * 2.0**-SPREAD_WEIGHT_BITS
    if exponent <= 0:
        assert np.abs(found.weights * 2.0**-SPREAD_WEIGHT_BITS - exact).max() < slack


def test_shares_add_up() -> None:
    spreading = Spreading(np.array([[0, 1], [1, 2]]), np.array([[40000, 25536], [60000, 5536]]))
    received = spreading.received(np.array([[8, -16], [100, 0]]), 3)
    exact = [[40000 * 8, 40000 * -16], [25536 * 8 + 60000 * 100, 25536 * -16], [5536 * 100, 0]]
    assert received.tolist() == [[(value + 32768) >> 16 for value in row] for row in exact]

"""Trilinear interpolation on the hash grid, against its definition."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from dfcgs_codec.model.hash_grid import HashGrid
from dfcgs_codec.model.layers import LayerError
from dfcgs_codec.transform.normalisation import NORMAL_BITS


def grid(seed: int = 0) -> HashGrid:
    return HashGrid(np.random.default_rng(seed).integers(-128, 128, (6, 4096, 4)).astype(np.int8))


def by_definition(table: np.ndarray, place: list[int]) -> list[int]:
    """Spec section 16.3, one Gaussian."""
    found = []
    t = [min(max(c, -(2**15)), 2**15 - 1) + 2**15 for c in place]
    for level in range(6):
        b = level + 2
        side = 2**b + 1
        total = [0] * 4
        for corner in itertools.product((0, 1), repeat=3):
            weight, xyz = 1, []
            for c, d in zip(t, corner, strict=True):
                f = (c >> (8 - b)) & 255
                weight *= f if d else 256 - f
                xyz.append((c >> (16 - b)) + d)
            x, y, z = xyz
            row = x + side * (y + side * z)
            if side**3 > 4096:
                row = (x ^ (y * 2654435761) ^ (z * 805459861)) & 4095
            total = [a + weight * int(g) for a, g in zip(total, table[level, row], strict=True)]
        found += [a >> 18 for a in total]
    return found


def test_reading_is_as_defined() -> None:
    rng = np.random.default_rng(1)
    one = 1 << NORMAL_BITS
    places = np.concatenate(
        [
            rng.integers(-one, one, (40, 3)),
            rng.integers(-4 * one, 4 * one, (20, 3)),
            [[-one] * 3, [one - 1] * 3],
        ]
    )
    found = grid().read(places)
    assert found.shape == (62, 24)
    assert found.tolist() == [by_definition(grid().table, place) for place in places.tolist()]


def test_features_change_with_the_place_and_not_in_jumps() -> None:
    line = np.zeros((2000, 3), np.int64)
    line[:, 0] = np.arange(-1000, 1000)
    coarse = grid().read(line)[:, :4]
    # a feature goes by at most 255 / 64 across a cell, in 256 steps
    assert 0 < np.abs(np.diff(coarse, axis=0)).max() <= 64
    assert np.abs(coarse[-1] - coarse[0]).max() > 50


def test_another_shape_or_type_is_refused() -> None:
    with pytest.raises(LayerError, match="hash grid"):
        HashGrid(np.zeros((5, 4096, 4), np.int8))
    with pytest.raises(LayerError, match="hash grid"):
        HashGrid(np.zeros((6, 4096, 4), np.int16))

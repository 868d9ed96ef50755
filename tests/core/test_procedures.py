"""Procedures that numpy leaves to the core where it is there: the same as its own."""

from __future__ import annotations

import numpy as np
import pytest

from dfcgs_codec.codec.intra.turns import TurnWalk
from dfcgs_codec.codec.motion import compensation
from dfcgs_codec.core import procedures
from dfcgs_codec.core.engine import has_core
from dfcgs_codec.transform import control_points, lod
from dfcgs_codec.transform.pole import axes_of_quaternions
from dfcgs_codec.transform.rotation import normalise

pytestmark = pytest.mark.skipif(not has_core(), reason="needs wasmtime")


def _cells(seed: int, count: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    walk = np.cumsum(rng.integers(-3, 4, (count, 3)), axis=0)
    return np.where(rng.random((count, 1)) < 0.1, rng.integers(-(1 << 20), 1 << 20, (count, 3)), walk)


@pytest.mark.parametrize("seed", range(4))
def test_control_points(seed: int) -> None:
    cells = _cells(seed, 3000)
    found = procedures.farthest_points(cells, 40)
    assert np.array_equal(found, control_points._farthest_points(cells, 40))
    for count in (1, 3, 4, 5, 40):
        ranks, weights = procedures.gather(cells, cells[found[:count]])
        wanted = control_points._gather_from(cells, cells[found[:count]])
        assert np.array_equal(ranks, wanted.ranks)
        assert np.array_equal(weights, wanted.weights)


@pytest.mark.parametrize("count", [0, 63, 64, 3001])
def test_levels_of_detail(count: int, monkeypatch: pytest.MonkeyPatch) -> None:
    positions = _cells(count, count)
    wanted = lod.build_levels(positions)
    monkeypatch.setattr(procedures, "is_worth", lambda _: True)
    found = lod.build_levels(positions)
    assert len(found.levels) == len(wanted.levels)
    for one, other in zip(found.levels, wanted.levels, strict=True):
        assert np.array_equal(one.weights, other.weights)
        assert one.weights.dtype == other.weights.dtype


@pytest.mark.parametrize("spread", [0, 300, 1 << 18])
def test_turns_of_what_is_carried(spread: int) -> None:
    rng = np.random.default_rng(spread)
    quaternions = normalise(rng.integers(-(1 << 24), 1 << 24, (3000, 4)))
    vectors = rng.integers(-spread, spread + 1, (3000, 3)) * (rng.random((3000, 1)) < 0.5)
    assert np.array_equal(procedures.turned(quaternions, vectors), compensation._turned(quaternions, vectors))


def test_turns_that_are_expected(monkeypatch: pytest.MonkeyPatch) -> None:
    rng, count = np.random.default_rng(0), 3001
    axes = axes_of_quaternions(normalise(rng.integers(-(1 << 24), 1 << 24, (count, 4))))
    steps, needles = np.full(count, 100), rng.random(count) < 0.5
    walk = TurnWalk(steps, steps, needles, lod.build_levels(_cells(1, count)))
    for level in walk.lod.levels:
        wanted = walk._expected(level.rows, level, axes)
        monkeypatch.setattr(procedures, "is_worth", lambda _: True)
        found = walk._expected(level.rows, level, axes)
        monkeypatch.undo()
        for one, other in zip(found, wanted, strict=True):
            assert np.array_equal(one, other)


def test_few_rows_and_numpy_do_without_the_core(monkeypatch: pytest.MonkeyPatch) -> None:
    assert not procedures.is_worth(100)
    assert procedures.is_worth(1 << 20)
    monkeypatch.setenv("DFCGS_ENGINE", "numpy")
    assert not procedures.is_worth(1 << 20)

"""Turns of I-frames in the core (spec section 11.5)."""

from __future__ import annotations

import numpy as np
import pytest

from dfcgs_codec.codec.intra.turns import TurnWalk, pole_turns
from dfcgs_codec.transform.lod import build_levels, order_levels
from dfcgs_codec.transform.pole import axes_of_quaternions, rest_frames
from dfcgs_codec.transform.rotation import CELLS, ONE, from_stereo, multiply, normalise
from tests.core.machines import call, int32

pytestmark = pytest.mark.usefixtures("both_machines")


def _quaternions(rng: np.random.Generator, count: int, spread: float) -> np.ndarray:
    around = normalise(rng.integers(-(1 << 24), 1 << 24, (1, 4)))
    vectors = np.rint(rng.normal(0, spread, (count, 3)) * (1 << 18)).astype(np.int64)
    return normalise(multiply(around, from_stereo(vectors)))


@pytest.mark.parametrize("spread", [0.0, 0.02, 0.3, 2.0])
@pytest.mark.parametrize("count", [64, 65, 3000])
@pytest.mark.parametrize("distances", [False, True])
def test_frames_that_are_expected(count: int, spread: float, distances: bool) -> None:
    rng = np.random.default_rng(count)
    axes = axes_of_quaternions(_quaternions(rng, count, spread))
    axes[rng.random(count) < 0.02] = 0
    needles = rng.random(count) < 0.4
    lod = build_levels(rng.integers(0, 300, (count, 3))) if distances else order_levels(count)
    steps = np.full(count, 100)
    walk, flags = TurnWalk(steps, steps, needles, lod), needles.astype(np.uint8)
    for number, level in zip(range(len(lod.levels) - 1, -1, -1), lod.levels, strict=True):
        wanted = walk._expected(level.rows, level, axes)
        rows = len(wanted[0])
        weights = np.ascontiguousarray(level.weights.T.astype(np.int16)) if distances else None
        frames, tilts, spins = (
            np.zeros((rows, 4), np.int32),
            np.zeros(rows, np.int64),
            np.zeros(rows, np.int64),
        )
        call("expect_turns", int32(axes), flags, count, number, weights, frames, tilts, spins)
        assert np.array_equal(frames, wanted[0])
        assert np.array_equal(tilts, wanted[1])
        assert np.array_equal(spins, wanted[2])


@pytest.mark.parametrize("flips", [False, True])
@pytest.mark.parametrize("base", [False, True])
@pytest.mark.parametrize("reach", [0, 100, 1 << 18, (1 << 30) - 2])
def test_turns_applied(reach: int, base: bool, flips: bool) -> None:
    rng, count, first, stride = np.random.default_rng(reach), 4000, 2, 4
    some = slice(first, None, stride)
    rows = len(range(count)[some])
    needles = rng.random(count) < 0.5
    frames = rest_frames(rows) if base else _quaternions(rng, rows, 0.5)
    tilts, spins = rng.integers(-reach, reach + 1, (rows, 2)), rng.integers(-reach, reach + 1, rows)
    names = rng.integers(0, 4, rows) if flips else np.zeros(rows, np.int64)
    tilted, spun = pole_turns(tilts, spins, needles[some])
    turned = normalise(multiply(multiply(frames, tilted), spun))
    rotations, axes = np.zeros((count, 4), np.int32), np.zeros((count, 3, 3), np.int32)
    known = None if base else int32(frames)
    given = names.astype(np.uint8) if flips else None
    arrays = needles.astype(np.uint8), known, int32(tilts.T), int32(spins), given, rotations, axes
    call("apply_turns", first, stride, rows, *arrays)
    assert np.array_equal(axes[some], axes_of_quaternions(turned))
    assert np.array_equal(rotations[some], multiply(turned, CELLS[names] * ONE))

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dfcgs_codec.transform.pole import AXIS_ONE, axes_of_quaternions, predict_poles, rest_frames
from dfcgs_codec.transform.rotation import CELLS, ONE, multiply, normalise


def quaternions(count: int, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return normalise(rng.integers(-(1 << 23), 1 << 23, (count, 4)))


def degrees(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Angles between frames whose axes are lines."""
    turn = np.abs(multiply(a * np.array([1, -1, -1, -1]), b)).max(axis=1) / ONE
    return np.degrees(2 * np.arccos(np.clip(turn, 0, 1)))


def neighbours_of(frames: np.ndarray, seed: int = 1) -> np.ndarray:
    """Axes (8, rows, 3, 3) of eight neighbours with the same axes, each under a name of its own."""
    rng = np.random.default_rng(seed)
    names = rng.integers(0, 4, (8, len(frames)))
    return np.stack([axes_of_quaternions(multiply(frames, CELLS[n] * ONE)) for n in names])


def test_axes_are_the_columns_of_the_matrix() -> None:
    found = quaternions(200)
    matrices = Rotation.from_quat(found[:, [1, 2, 3, 0]]).as_matrix()
    axes = axes_of_quaternions(found) / AXIS_ONE
    assert np.abs(axes - matrices.transpose(0, 2, 1)).max() < 2 / AXIS_ONE


@pytest.mark.parametrize("is_needle", [False, True])
def test_neighbours_that_agree_are_what_is_expected(is_needle: bool) -> None:
    frames = quaternions(300)
    weights = np.full((8, 300), 32)
    found = predict_poles(neighbours_of(frames), weights, np.full(300, is_needle))
    assert degrees(found.frames, frames).max() < 0.1
    # half the square of an angle, Q36
    assert np.degrees(np.sqrt(2 * found.tilt.max() / 2**36)) < 2
    assert np.degrees(np.sqrt(2 * found.spin.max() / 2**36)) < 2


@pytest.mark.parametrize("is_needle", [False, True])
def test_the_names_of_neighbours_do_not_matter(is_needle: bool) -> None:
    rng = np.random.default_rng(3)
    weights = rng.integers(1, 60, (8, 400))
    axes = np.stack([axes_of_quaternions(quaternions(400, seed)) for seed in range(8)])
    needles = np.full(400, is_needle)
    flipped = axes * rng.choice([-1, 1], (8, 400, 3, 1))
    first, second = (predict_poles(given, weights, needles) for given in (axes, flipped))
    same = (np.abs(first.frames - second.frames).max(axis=1) < 1 << 12) | (
        degrees(first.frames, second.frames) < 0.1
    )
    # but where neighbours cancel each other out, and where two sides are equally near
    assert same.mean() > 0.97


def test_frames_are_unit_quaternions_even_where_neighbours_say_nothing() -> None:
    axes = np.zeros((8, 5, 3, 3), np.int64)
    for needles in (np.zeros(5, bool), np.ones(5, bool)):
        found = predict_poles(axes, np.full((8, 5), 32), needles)
        assert np.array_equal(found.frames, rest_frames(5))
        assert (found.tilt == 1 << 36).all()
        assert (found.spin == 1 << 36).all()

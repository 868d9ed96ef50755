from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from dfcgs_codec.bitstream.constants import STATE_LIMIT
from dfcgs_codec.transform.rigid import RigidMotion, displacements
from dfcgs_codec.transform.rotation import ONE, STEREO_ONE, from_stereo

COORDINATES = st.tuples(*[st.integers(-STATE_LIMIT, STATE_LIMIT)] * 3)
SHIFTS = st.tuples(*[st.integers(-2 * STATE_LIMIT, 2 * STATE_LIMIT)] * 3)
TURNS = st.tuples(*[st.integers(-STEREO_ONE, STEREO_ONE)] * 3)


def in_big_integers(pivot: list[int], shift: list[int], quaternion: list[int], x: list[int]) -> list[int]:
    """Spec section 14.4 with integers of any size."""
    w, i, j, k = quaternion
    matrix = [
        [-(j * j + k * k), i * j - w * k, i * k + w * j],
        [i * j + w * k, -(i * i + k * k), j * k - w * i],
        [i * k - w * j, j * k + w * i, -(i * i + j * j)],
    ]
    rounded = [[(entry + (1 << 26)) >> 27 for entry in row] for row in matrix]
    return [
        shift[a] + ((sum(rounded[a][b] * (x[b] - pivot[b]) for b in range(3)) + (1 << 19)) >> 20)
        for a in range(3)
    ]


@given(COORDINATES, SHIFTS, TURNS, COORDINATES)
def test_floats_are_as_good_as_integers(
    pivot: tuple[int, ...], shift: tuple[int, ...], turn: tuple[int, ...], x: tuple[int, ...]
) -> None:
    motion = RigidMotion(*(np.array([part], np.int64) for part in (pivot, shift, turn)))
    found = displacements(motion.table(), np.zeros(1, np.int64), np.array(x, np.float64)[:, None])
    quaternion = motion.quaternions()[0].tolist()
    assert found[:, 0].tolist() == in_big_integers(list(pivot), list(shift), quaternion, list(x))


def test_a_motion_is_a_turn_about_its_pivot() -> None:
    rng = np.random.default_rng(0)
    pivot, shift = np.array([[9000, -70, 31_000]]), np.array([[400, 0, -3]])
    turn = np.array([[12_000, -30_000, 5000]])
    x = rng.integers(-50_000, 50_000, (200, 3))
    moved = displacements(
        RigidMotion(pivot, shift, turn).table(), np.zeros(200, np.int64), x.T.astype(np.float64)
    )
    rotation = Rotation.from_quat(np.roll(from_stereo(turn)[0] / ONE, -1))
    expected = rotation.apply(x - pivot) + pivot + shift - x
    assert np.abs(moved.T - expected).max() < 1.0


def test_no_motion_moves_nothing() -> None:
    rng = np.random.default_rng(1)
    pivots = rng.integers(-STATE_LIMIT, STATE_LIMIT, (9, 3))
    nothing = np.zeros((9, 3), np.int64)
    x = rng.integers(-STATE_LIMIT, STATE_LIMIT, (3, 100)).astype(np.float64)
    table = RigidMotion(pivots, nothing, nothing).table()
    assert not displacements(table, rng.integers(0, 9, 100), x).any()

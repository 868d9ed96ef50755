from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy.spatial.transform import Rotation

from dfcgs_codec.transform.rotation import (
    CELLS,
    ONE,
    STEREO_ONE,
    from_float,
    from_stereo,
    multiply,
    normalise,
    round_divide,
    to_stereo,
)

VECTORS = hnp.arrays(
    np.int64, st.tuples(st.integers(1, 20), st.just(3)), elements=st.integers(-STEREO_ONE, STEREO_ONE)
)
FLOATS = st.floats(width=32, allow_nan=False, allow_infinity=False, allow_subnormal=True)


def length(quaternions: np.ndarray) -> np.ndarray:
    return np.sqrt((quaternions.astype(np.float64) ** 2).sum(axis=1)) / ONE


def unit_quaternions(count: int, seed: int = 0) -> np.ndarray:
    q = np.random.default_rng(seed).normal(size=(count, 4))
    return np.rint(q / np.linalg.norm(q, axis=1, keepdims=True) * ONE).astype(np.int64)


def rotation(quaternions: np.ndarray) -> Rotation:
    return Rotation.from_quat(quaternions[:, [1, 2, 3, 0]] / ONE)


def exact_from_stereo(vector: list[int]) -> list[int]:
    """The same in exact rational arithmetic."""
    p = [Fraction(max(-STEREO_ONE, min(STEREO_ONE, v)), STEREO_ONE) for v in vector]
    squared = sum(v * v for v in p)
    values = [(1 - squared) / (1 + squared), *(2 * v / (1 + squared) for v in p)]
    return [int((v * ONE + Fraction(1, 2)) // 1) for v in values]


@given(st.integers(-(2**60), 2**60), st.integers(1, 2**60))
def test_round_divide_rounds_halves_up(numerator: int, denominator: int) -> None:
    result = int(round_divide(np.array([numerator]), np.array([denominator]))[0])
    assert result == (Fraction(numerator, denominator) + Fraction(1, 2)) // 1


@given(VECTORS)
def test_from_stereo_is_exact(vectors: np.ndarray) -> None:
    assert from_stereo(vectors).tolist() == [exact_from_stereo(v) for v in vectors.tolist()]


@pytest.mark.parametrize("extreme", [STEREO_ONE, -STEREO_ONE, 2**40, -(2**40), 2**62])
def test_from_stereo_does_not_overflow_at_the_extremes(extreme: int) -> None:
    vectors = np.array([[extreme, extreme, extreme], [extreme, 0, -extreme], [0, extreme, 1]], np.int64)
    assert from_stereo(vectors).tolist() == [exact_from_stereo(v) for v in vectors.tolist()]


@given(VECTORS)
def test_from_stereo_has_unit_length(vectors: np.ndarray) -> None:
    assert np.abs(length(from_stereo(vectors)) - 1).max() <= 2.0**-23


def test_to_stereo_is_the_inverse_of_from_stereo() -> None:
    rng = np.random.default_rng(0)
    p = rng.normal(size=(5000, 3))
    p *= rng.uniform(0, STEREO_ONE, (5000, 1)) / np.linalg.norm(p, axis=1, keepdims=True)
    vectors = np.rint(p).astype(np.int64)
    back = to_stereo(from_stereo(vectors) / ONE) * STEREO_ONE
    inside = (vectors**2).sum(axis=1) < STEREO_ONE**2
    assert np.abs(back - vectors)[inside].max() < 0.1


def test_to_stereo_takes_either_sign_and_stays_in_the_unit_ball() -> None:
    q = unit_quaternions(1000) / ONE
    assert np.array_equal(to_stereo(q), to_stereo(-q))
    assert (np.linalg.norm(to_stereo(q), axis=1) <= 1 + 1e-9).all()


def test_a_stereo_unit_turns_by_two_to_four_radians() -> None:
    vectors = (np.linspace(0, 0.99, 100)[:, None] * np.array([[STEREO_ONE, 0, 0]])).astype(np.int64)
    angles = rotation(from_stereo(vectors)).magnitude()
    rate = np.diff(angles) / np.diff(vectors[:, 0]) * STEREO_ONE
    assert rate.min() >= 2 - 1e-3
    assert rate.max() <= 4 + 1e-3


def test_multiply_is_the_hamilton_product() -> None:
    a, b = unit_quaternions(500, 1), unit_quaternions(500, 2)
    product = multiply(a, b)
    assert (rotation(a) * rotation(b) * rotation(product).inv()).magnitude().max() < 1e-6
    assert np.abs(length(product) - 1).max() < 1e-6


def hamilton(a: list[int], b: list[int]) -> list[int]:
    """The product of unlimited integers, rounded to nearest, halves up."""
    (w, x, y, z), (s, i, j, k) = a, b
    product = [
        w * s - x * i - y * j - z * k,
        w * i + x * s + y * k - z * j,
        w * j - x * k + y * s + z * i,
        w * k + x * j - y * i + z * s,
    ]
    return [(value + ONE // 2) // ONE for value in product]


def test_multiply_rounds_to_nearest() -> None:
    a, b = unit_quaternions(300, 3), unit_quaternions(300, 4)
    rows = zip(a.tolist(), b.tolist(), strict=True)
    assert multiply(a, b).tolist() == [hamilton(*row) for row in rows]
    extreme = np.array([[2 * ONE, -2 * ONE, 2 * ONE, -2 * ONE]])
    assert multiply(extreme, -extreme).tolist() == [hamilton(extreme[0].tolist(), (-extreme[0]).tolist())]


def test_multiply_by_one_changes_nothing() -> None:
    q = unit_quaternions(1000)
    one = np.broadcast_to(np.array([ONE, 0, 0, 0]), q.shape)
    assert np.array_equal(multiply(q, one), q)
    assert np.array_equal(multiply(one, q), q)


def test_axis_flips_leave_the_covariance() -> None:
    q = unit_quaternions(50)
    before = np.abs(rotation(q).as_matrix())
    for flip in CELLS:
        flipped = multiply(q, np.broadcast_to(flip * ONE, q.shape))
        assert np.allclose(np.abs(rotation(flipped).as_matrix()), before, atol=1e-6)


def test_normalise_gives_unit_length() -> None:
    q = unit_quaternions(2000)
    for factor in (1, 2, 3):
        assert np.abs(length(normalise(q * factor // 2)) - 1).max() <= 2.0**-22


def test_normalise_again_moves_by_one_unit_at_most() -> None:
    once = normalise(unit_quaternions(20000))
    assert np.abs(normalise(once) - once).max() <= 1


@pytest.mark.parametrize(
    "row", [[ONE * 2] * 4, [-ONE * 2, 0, 0, 0], [1, 0, 0, 0], [0, 0, -1, 1], [3, 4, 0, 0]]
)
def test_normalise_does_not_overflow_at_the_extremes(row: list[int]) -> None:
    found = normalise(np.array([row], np.int64))[0]
    norm = np.linalg.norm(np.array(row, np.float64))
    # the length of a tiny quaternion is an integer too
    tolerance = 2 if norm > 1000 else ONE / 2
    assert np.abs(found - np.array(row) / norm * ONE).max() <= tolerance


@pytest.mark.parametrize("length", [1, 2, 3, ONE - 1, ONE, ONE + 1, 2 * ONE])
def test_normalise_along_an_axis_is_exact(length: int) -> None:
    for axis in range(4):
        row = np.zeros((1, 4), np.int64)
        row[0, axis] = -length
        expected = np.zeros((1, 4), np.int64)
        expected[0, axis] = -ONE
        assert np.array_equal(normalise(row), expected)


def test_three_hundred_identity_turns_change_no_bit() -> None:
    start = turned = from_stereo(np.random.default_rng(0).integers(-STEREO_ONE, STEREO_ONE, (2000, 3)))
    identity = from_stereo(np.zeros((2000, 3), np.int64))
    for _ in range(300):
        turned = multiply(turned, identity)
    assert np.array_equal(turned, start)


def test_three_hundred_small_turns_keep_unit_length() -> None:
    rng = np.random.default_rng(0)
    turned = unit_quaternions(500)
    for _ in range(300):
        turned = normalise(multiply(turned, from_stereo(rng.integers(-2000, 2000, (500, 3)))))
    assert np.abs(length(turned) - 1).max() <= 2.0**-22


@given(hnp.arrays(np.float32, (5, 4), elements=FLOATS).filter(lambda q: (q != 0).any(axis=1).all()))
def test_from_float_keeps_the_direction_of_any_length(rotations: np.ndarray) -> None:
    found = from_float(rotations)
    wide = rotations.astype(np.float64)
    expected = wide / np.abs(wide).max(axis=1, keepdims=True)
    expected /= np.linalg.norm(expected, axis=1, keepdims=True)
    assert np.abs(found / ONE - expected).max() < 2.0**-22


def test_from_float_does_not_see_powers_of_two() -> None:
    rotations = np.random.default_rng(0).normal(size=(300, 4)).astype(np.float32)
    assert np.array_equal(from_float(rotations * np.float32(2.0**40)), from_float(rotations))
    assert np.array_equal(from_float(-rotations), from_float(-rotations.copy()))


def test_quotients_by_arrays_are_exact_next_to_integers() -> None:
    rng = np.random.default_rng(4)
    divisors = rng.integers(1, 1 << 26, 20_000)
    quotients = rng.integers(-(1 << 25), 1 << 25, 20_000)
    for off in (-2, -1, 0, 1, 2):
        # halves, and integers, and what lies next to them
        for numerators in (quotients * divisors + off, quotients * divisors + divisors // 2 + off):
            expected = [
                (2 * n + d) // (2 * d) for n, d in zip(numerators.tolist(), divisors.tolist(), strict=True)
            ]
            assert round_divide(numerators, divisors).tolist() == expected
    # beyond what float64 holds exactly
    large = np.array([(1 << 61) - 1, -(1 << 61), (1 << 52) + 1])
    assert round_divide(large, np.array([3, 7, 1])).tolist() == [
        (2 * n + d) // (2 * d) for n, d in zip(large.tolist(), (3, 7, 1), strict=True)
    ]


def test_products_are_those_of_the_text() -> None:
    rng = np.random.default_rng(5)
    a, b = rng.integers(-ONE, ONE + 1, (2, 50, 4))
    for row, (w, x, y, z), (s, i, j, k) in zip(multiply(a, b).tolist(), a.tolist(), b.tolist(), strict=True):
        sums = [
            w * s - x * i - y * j - z * k,
            w * i + x * s + y * k - z * j,
            w * j - x * k + y * s + z * i,
            w * k + x * j - y * i + z * s,
        ]
        assert row == [(value + (ONE >> 1)) >> 24 for value in sums]

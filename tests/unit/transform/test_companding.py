from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from dfcgs_codec.bitstream.constants import MAX_OPACITY_EXPONENT, MAX_THIN_EXPONENT, MAX_THIN_OCTAVES
from dfcgs_codec.transform.companding import (
    ALPHA_PER_UNIT,
    KNOTS,
    compress,
    compress_thinness,
    expand,
    expand_thinness,
    thin_octaves,
)

EXPONENTS = [MAX_OPACITY_EXPONENT, -12, -16]


def alpha(logit: np.ndarray) -> np.ndarray:
    return 1 / (1 + np.exp(-logit))


def all_units(exponent: int) -> np.ndarray:
    """Companded integers up to a logit of about 10."""
    return np.arange(-3 << -exponent, (3 << -exponent) + 1)


@pytest.mark.parametrize("exponent", EXPONENTS)
def test_compress_undoes_expand(exponent: int) -> None:
    units = all_units(exponent)
    assert np.array_equal(compress(expand(units, exponent), exponent), units)


@pytest.mark.parametrize("exponent", EXPONENTS)
def test_both_are_monotone_and_odd(exponent: int) -> None:
    units = all_units(exponent)
    assert (np.diff(expand(units, exponent)) > 0).all()
    logits = np.arange(-10 << -exponent, 10 << -exponent)
    assert (np.diff(compress(logits, exponent)) >= 0).all()
    assert np.array_equal(compress(-logits, exponent), -compress(logits, exponent))
    assert np.array_equal(expand(-units, exponent), -expand(units, exponent))


@pytest.mark.parametrize("exponent", EXPONENTS)
def test_alpha_per_unit(exponent: int) -> None:
    logits = expand(all_units(exponent), exponent) * 2.0**exponent
    rate = np.abs(np.diff(alpha(logits))) / 2.0**exponent
    assert rate.max() <= ALPHA_PER_UNIT
    assert rate.max() >= ALPHA_PER_UNIT * 0.97


@pytest.mark.parametrize("exponent", EXPONENTS)
def test_rounding_costs_half_a_unit_of_alpha(exponent: int) -> None:
    logits = np.arange(-12 << -exponent, 12 << -exponent)
    back = expand(compress(logits, exponent), exponent)
    error = np.abs(alpha(back * 2.0**exponent) - alpha(logits * 2.0**exponent))
    assert error.max() <= 0.5 * ALPHA_PER_UNIT * 2.0**exponent


@given(st.sampled_from(EXPONENTS), hnp.arrays(np.int64, 20, elements=st.integers(-(2**29), 2**29)))
def test_expand_comes_back_within_half_its_slope(exponent: int, logits: np.ndarray) -> None:
    back = expand(compress(logits, exponent), exponent)
    assert (np.abs(back - logits) <= 1 << (len(KNOTS) - 1)).all()


def test_nothing_is_lost_before_the_first_knot() -> None:
    logits = np.arange(-(28 << 8), (28 << 8) + 1)
    assert np.array_equal(compress(logits, -12), logits)


def test_extremes_of_the_state_do_not_overflow() -> None:
    limit = (1 << 29) - 1
    found = expand(np.array([limit, -limit]), -12) * 2.0**-12
    assert found[0] == -found[1]
    assert found[0] > 10**6


@pytest.mark.parametrize("octaves", [0, 1, 6, MAX_THIN_OCTAVES])
@pytest.mark.parametrize("exponent", [MAX_THIN_EXPONENT, -16, -60])
def test_thinness_comes_back_within_half_its_slope(exponent: int, octaves: int) -> None:
    logs = np.random.default_rng(1).integers(-(2**29), 2**29, 3000) >> np.arange(3000) % 30
    back = expand_thinness(compress_thinness(logs, exponent, octaves), exponent, octaves)
    # where rounding leads to the next zone, its grid is twice as wide
    slope = 1 << np.minimum(thin_octaves(logs, exponent, octaves) + 1, octaves)
    assert (2 * np.abs(back - logs) <= slope).all()
    assert octaves or np.array_equal(back, logs)


def test_a_step_is_worth_twice_as_much_after_each_octave() -> None:
    exponent, octave = -14, np.log(2) * 2.0**14
    logs = (np.arange(8) * octave + octave / 2).astype(np.int64)
    slopes = (compress_thinness(logs + 256, exponent, 6) - compress_thinness(logs, exponent, 6)) / 256
    assert np.allclose(slopes, 2.0 ** -np.array([0, 1, 2, 3, 4, 5, 6, 6]))
    assert thin_octaves(logs, exponent, 6).tolist() == [0, 1, 2, 3, 4, 5, 6, 6]
    assert thin_octaves(-logs, exponent, 6).tolist() == [0, 1, 2, 3, 4, 5, 6, 6]

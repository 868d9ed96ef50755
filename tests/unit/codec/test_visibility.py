from __future__ import annotations

import numpy as np
import pytest

from dfcgs_codec.bitstream.constants import STATE_LIMIT, Attribute
from dfcgs_codec.bitstream.sequence_header import UnitExponents
from dfcgs_codec.codec.intra.verbatim import state_of
from dfcgs_codec.codec.state.planes import FrameState, Plane, output
from dfcgs_codec.codec.state.visibility import MULTIPLIERS, Visibility
from lab.small_clouds import make_cloud

UNITS = UnitExponents(-12, -12, -12, -12)
#: sixteenths of an octave
UNIT = 1 / 16


def frame(count: int = 400) -> FrameState:
    return FrameState(state_of(make_cloud(count, 1), UNITS).planes)


def real_weights(state: FrameState) -> dict[Attribute, np.ndarray]:
    """What section 9.5 approximates, in octaves."""
    cloud = output(state, UNITS)
    alpha = -2 * np.log2(1 + np.exp(-cloud.opacities.astype(np.float64)))
    axes = np.sort(cloud.scales.astype(np.float64), axis=1) / np.log(2)
    area, ratio = axes[:, 2] + axes[:, 1], np.maximum(2.0 ** (axes[:, 2] - axes[:, 1]), 2.0 ** (1 / 8))
    return {
        Attribute.POSITION: alpha,
        Attribute.OPACITY: area,
        Attribute.SCALE: alpha + area,
        Attribute.SH_1: alpha + area,
        Attribute.ROTATION: alpha + area + 2 * np.log2(ratio - 1 / ratio),
    }


def test_weights_are_those_of_real_arithmetic() -> None:
    state = frame()
    visibility = Visibility(state, UNITS)
    for attribute, expected in real_weights(state).items():
        error = np.abs(visibility.weights(attribute) * UNIT - expected)
        # rounding to the tables: an eighth of a logit, an eighth of an octave of roundness
        assert error.max() < (0.5 if attribute != Attribute.ROTATION else 3.5), attribute
        assert np.median(error) < 0.3


def test_no_step_is_finer_and_none_coarser_than_the_largest_multiplier() -> None:
    visibility = Visibility(frame(), UNITS)
    for level in (-STATE_LIMIT, -100, 0, 100, STATE_LIMIT):
        found = visibility.multipliers(Attribute.SH_DC, level)
        assert found.shape == (400, 1)
        assert found.min() >= 256
        assert set(found[:, 0]) <= set(MULTIPLIERS)
    assert (visibility.multipliers(Attribute.SH_DC, -STATE_LIMIT) == 256).all()
    assert (visibility.multipliers(Attribute.SH_DC, STATE_LIMIT) == MULTIPLIERS[-1]).all()


def test_multipliers_rise_as_the_weight_falls() -> None:
    visibility = Visibility(frame(), UNITS)
    order = np.argsort(visibility.weights(Attribute.ROTATION))
    level = int(visibility.weights(Attribute.ROTATION).max())
    multipliers = visibility.multipliers(Attribute.ROTATION, level)[order, 0]
    assert (np.diff(multipliers) <= 0).all()
    assert len(set(multipliers)) > 6
    # half the error in the image for each octave of weight, so that errors show alike
    weight = visibility.weights(Attribute.ROTATION)[order]
    inside = (level - weight) * UNIT < 6
    exact = 256 * 2.0 ** ((level - weight[inside]) * UNIT / 2)
    assert (np.abs(np.log2(multipliers[inside] / exact)) <= 0.26).all()


def test_level_is_not_remembered_for_another() -> None:
    visibility = Visibility(frame(), UNITS)
    level = int(np.median(visibility.weights(Attribute.SCALE)))
    first = visibility.multipliers(Attribute.SCALE, level)
    assert visibility.multipliers(Attribute.SCALE, level) is first
    assert not np.array_equal(visibility.multipliers(Attribute.SCALE, level + 8), first)


@pytest.mark.parametrize("attribute", [Attribute.SCALE, Attribute.OPACITY])
def test_it_is_that_of_the_frame(attribute: Attribute) -> None:
    state = frame()
    visibility = Visibility(state, UNITS)
    moved = FrameState(
        state.planes | {Attribute.POSITION: Plane(state.planes[Attribute.POSITION].wide() + 1)}
    )
    assert visibility.of(moved) is visibility
    brighter = FrameState(state.planes | {attribute: Plane(state.planes[attribute].wide() + 9000)})
    found = visibility.of(brighter)
    assert found is not visibility
    assert found.weights(Attribute.SH_DC).sum() > visibility.weights(Attribute.SH_DC).sum()


@pytest.mark.parametrize("exponent", [-60, -12, 10, 60])
def test_extreme_grids_stay_inside_64_bits(exponent: int) -> None:
    values = np.array([[STATE_LIMIT, -STATE_LIMIT, 0], [STATE_LIMIT] * 3, [-STATE_LIMIT] * 3])
    opacity = np.array([[STATE_LIMIT], [-STATE_LIMIT], [0]])
    planes = {Attribute.SCALE: Plane(values), Attribute.OPACITY: Plane(opacity)}
    visibility = Visibility(
        FrameState(planes), UnitExponents(-12, exponent, max(-60, min(exponent, -11)), -12)
    )
    shift = min(max(10 - exponent, 0), 63)
    longest = STATE_LIMIT * 23637 >> shift
    middle = [0, longest, -STATE_LIMIT * 23637 >> shift]
    first = [longest, longest, middle[2]]
    area = [a + b for a, b in zip(first, middle, strict=True)]
    assert visibility.weights(Attribute.OPACITY).tolist() == area
    for level in (-STATE_LIMIT, STATE_LIMIT):
        assert visibility.multipliers(Attribute.ROTATION, level).min() >= 256

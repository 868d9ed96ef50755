from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dfcgs_codec.bitstream.constants import STATE_LIMIT, Attribute
from dfcgs_codec.encoder.plan.quantiser_steps import (
    BOUND_UNITS,
    MAX_PSNR,
    MAX_QP,
    MIN_PSNR,
    MIN_QP,
    QUALITIES,
    REFERENCE_QP,
    Bound,
    Quantisation,
    expected_qp,
    plan_quantisation,
    typical_size,
)
from dfcgs_codec.errors import InputError
from dfcgs_codec.gaussians import GaussianCloud
from lab.small_clouds import make_cloud

CLOUD = make_cloud(200, 3)
SH_2 = make_cloud(200, 2)


def real_steps(quantisation: Quantisation) -> dict[Attribute, float]:
    """Steps in the attributes' own units."""
    units = quantisation.units
    exponents = {
        Attribute.POSITION: units.position,
        Attribute.SCALE: units.scale,
        Attribute.ROTATION: -18,
        Attribute.OPACITY: units.opacity,
    }
    return {a: step * 2.0 ** exponents.get(a, units.color) for a, step in quantisation.steps.items()}


def plan(qp: float = 28, *bounds: Bound, cloud: GaussianCloud = CLOUD) -> Quantisation:
    return plan_quantisation(qp, bounds, cloud)


def test_the_step_doubles_every_six_qp() -> None:
    for coarse, fine in itertools.pairwise(real_steps(plan(qp)) for qp in (46, 40, 34, 28, 22, 16, 10)):
        for attribute in set(Attribute) - {Attribute.POSITION}:
            assert coarse[attribute] / fine[attribute] == pytest.approx(2, rel=0.02)


@pytest.mark.parametrize(("coarse", "fine"), [(46, 40), (28, 22), (22, 18), (14, 10)])
def test_the_position_step_halves_faster_where_it_is_fine(coarse: float, fine: float) -> None:
    steps = [real_steps(plan(qp))[Attribute.POSITION] for qp in (coarse, fine)]
    assert steps[0] / steps[1] == pytest.approx(2, rel=0.02)


def test_steps_at_the_reference_qp() -> None:
    steps = real_steps(plan(REFERENCE_QP, cloud=SH_2))
    assert steps[Attribute.POSITION] == pytest.approx(typical_size(CLOUD) / 8, rel=0.02)
    assert steps[Attribute.ROTATION] == pytest.approx(1 / 80, rel=0.001)
    assert steps[Attribute.SCALE] == pytest.approx(1 / 10, rel=0.02)
    assert steps[Attribute.OPACITY] == pytest.approx(1 / 6, rel=0.02)


def test_more_values_to_a_gaussian_take_smaller_steps() -> None:
    few, many = (
        real_steps(plan(28, cloud=replace(CLOUD, sh_rest=CLOUD.sh_rest[:, :, :0]))),
        real_steps(plan(28)),
    )
    for attribute in (Attribute.POSITION, Attribute.ROTATION, Attribute.SH_DC):
        assert few[attribute] / many[attribute] == pytest.approx((58 / 13) ** 0.5, rel=0.02)


@pytest.mark.parametrize("qp", [0, 0.5, 17.3, MAX_QP])
def test_grids_are_finer_than_steps_and_legal(qp: float) -> None:
    quantisation = plan(qp)
    assert all(1 <= step <= STATE_LIMIT for step in quantisation.steps.values())
    assert all(step >= 32 for a, step in quantisation.steps.items() if a != Attribute.ROTATION)
    units = quantisation.units
    assert max(map(abs, (units.position, units.scale, units.opacity, units.color))) <= 60
    assert quantisation.units.opacity <= -11


def test_qualities_go_from_coarse_to_fine() -> None:
    assert list(QUALITIES) == ["low", "medium", "high", "transparent"]
    assert sorted(QUALITIES.values()) == list(QUALITIES.values())
    qps = [expected_qp(None, quality) for quality in QUALITIES.values()]
    assert sorted(qps, reverse=True) == qps
    assert expected_qp(None, MAX_PSNR) == MIN_QP
    assert expected_qp(None, MIN_PSNR) <= MAX_QP
    assert expected_qp(3.5, 37.0) == 3.5


def test_typical_size_is_the_geometric_mean() -> None:
    round_ones = replace(CLOUD, scales=CLOUD.scales.clip(-4, -3))
    expected = float(np.exp(np.median(round_ones.scales.mean(axis=1))))
    assert typical_size(round_ones) == pytest.approx(expected)


def test_discs_are_as_large_as_they_look() -> None:
    sizes = []
    for thickness in (1e-2, 1e-9):
        scales = np.log(np.tile([0.5, thickness, 0.5], (200, 1))).astype(np.float32)
        sizes.append(typical_size(replace(CLOUD, scales=scales)))
    assert sizes[0] == pytest.approx(sizes[1])


@pytest.mark.parametrize(
    ("name", "attributes"),
    [
        ("position", {Attribute.POSITION}),
        ("rotation", {Attribute.ROTATION}),
        ("scale", {Attribute.SCALE}),
        ("alpha", {Attribute.OPACITY}),
        ("colour", {Attribute.SH_DC}),
        ("sh", {Attribute.SH_1, Attribute.SH_2, Attribute.SH_3}),
    ],
)
def test_a_bound_replaces_the_steps_of_its_attributes(name: str, attributes: set[Attribute]) -> None:
    free, bounded = plan(28), plan(28, Bound(name, 1e-2))
    assert bounded.bounded == attributes
    assert list(BOUND_UNITS).count(name) == 1
    before, after = real_steps(free), real_steps(bounded)
    for attribute in Attribute:
        if attribute in attributes:
            assert after[attribute] != before[attribute]
        else:
            assert after[attribute] == pytest.approx(before[attribute], rel=0.02)


@given(st.sampled_from(sorted(BOUND_UNITS)), st.floats(5e-3, 0.5))
def test_bounded_steps_leave_room_for_the_grids_own_rounding(name: str, value: float) -> None:
    quantisation = plan(28, Bound(name, value))
    steps = real_steps(quantisation)
    for attribute, limit in Bound(name, value).steps().items():
        unit = steps[attribute] / quantisation.steps[attribute]
        assert steps[attribute] + unit <= limit * (1 + 1e-9)
        assert steps[attribute] >= 0.9 * limit - 2 * unit


def test_a_smaller_bound_counts_less_than_no_other_attribute() -> None:
    both = plan(28, Bound("alpha", 0.01), Bound("sh", 0.02))
    assert both.bounded == {Attribute.OPACITY, Attribute.SH_1, Attribute.SH_2, Attribute.SH_3}


@pytest.mark.parametrize("order", [1, -1])
def test_of_two_bounds_for_one_attribute_the_tighter_holds(order: int) -> None:
    bounds = (Bound("scale", 0.1), Bound("scale", 0.001))[::order]
    assert real_steps(plan(28, *bounds))[Attribute.SCALE] <= 2 * 0.001


@pytest.mark.parametrize("value", [0.0, -1.0, math.nan, math.inf])
def test_a_bound_is_a_number_above_0(value: float) -> None:
    with pytest.raises(InputError, match="above 0"):
        Bound("position", value)


def test_a_rotation_bound_finer_than_the_symbols_is_refused() -> None:
    plan(28, Bound("rotation", 0.002))
    with pytest.raises(InputError, match=r"--bound rotation: the tightest .* is 0\.0015 degrees"):
        plan(28, Bound("rotation", 0.001))


def test_an_unknown_bound_lists_the_known_ones() -> None:
    with pytest.raises(InputError, match=r"--bound colur: unknown; known are .*colour \(RGB"):
        Bound("colur", 1.0)

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from dfcgs_codec.bitstream.constants import MAX_SORT_BITS, STATE_LIMIT, Attribute
from dfcgs_codec.bitstream.sequence_header import UnitExponents
from dfcgs_codec.codec.frame.reconstruct import reconstruct_inter
from dfcgs_codec.codec.intra.verbatim import state_of
from dfcgs_codec.codec.state.planes import FrameState, Plane, output
from dfcgs_codec.encoder.plan.quantiser_steps import Quantisation
from dfcgs_codec.encoder.residual.quantise import (
    ResidualQuantiser,
    ZeroBin,
    inter_symbols,
    order_of,
    plan_grid,
)
from dfcgs_codec.gaussians import GaussianCloud
from lab.small_clouds import coincident_cloud, make_cloud, with_outliers
from tests.helpers import rotation_degrees

UNITS = UnitExponents(-16, -16, -16, -16)
RESIDUALS = hnp.arrays(np.int64, 30, elements=st.integers(-(10**6), 10**6))


def planes_of(cloud: GaussianCloud) -> dict[Attribute, np.ndarray]:
    return {a: p.wide() for a, p in state_of(cloud, UNITS).planes.items()}


def cloud_of(state: FrameState) -> GaussianCloud:
    return output(state, UNITS)


# --- zero bin -----------------------------------------------------------------------------------------


@given(RESIDUALS, st.integers(1, 1000))
def test_without_a_dead_zone_the_nearest_symbol_is_taken(residuals: np.ndarray, step: int) -> None:
    symbols = ZeroBin(0.5).quantise(residuals, step)
    assert (2 * np.abs(residuals - symbols * step) <= step).all()
    assert (np.abs(symbols * step) <= np.abs(residuals) + step // 2).all()


@given(RESIDUALS, st.integers(1, 1000), st.floats(0.5, 1.0))
def test_the_dead_zone_ends_at_its_threshold(residuals: np.ndarray, step: int, threshold: float) -> None:
    symbols = ZeroBin(threshold).quantise(residuals, step)
    assert (np.abs(residuals - symbols * step) <= max(threshold, 0.5) * step).all()
    assert not symbols[np.abs(residuals) < threshold * step].any()
    assert np.array_equal(symbols, -ZeroBin(threshold).quantise(-residuals, step))


@given(RESIDUALS, st.sampled_from([0.5, 0.6, 1.0]))
def test_real_residuals_are_quantised_alike(residuals: np.ndarray, threshold: float) -> None:
    bin_ = ZeroBin(threshold)
    assert np.array_equal(bin_.quantise(residuals, 64), bin_.quantise_real(residuals / 64))


def test_halves_go_towards_zero() -> None:
    assert ZeroBin(0.5).quantise(np.array([-15, -5, 5, 15, 16]), 10).tolist() == [-1, 0, 0, 1, 2]


# --- grid and order -----------------------------------------------------------------------------------


@given(st.data(), st.sampled_from([1, 10, STATE_LIMIT]), st.integers(1, MAX_SORT_BITS))
def test_grids_are_legal(data: st.DataObject, limit: int, max_bits: int) -> None:
    shape = st.tuples(st.integers(1, 30), st.just(3))
    indices = data.draw(hnp.arrays(np.int64, shape, elements=st.integers(-limit, limit)))
    grid = plan_grid(indices, max_bits)
    assert 0 <= grid.bits <= max_bits
    assert 0 <= grid.shift <= 31
    assert max(map(abs, grid.origin)) <= STATE_LIMIT
    inside = (indices >> grid.shift) - np.array(grid.origin)
    if not grid.has_excess:
        assert inside.min() >= 0
        assert inside.max() < 1 << grid.bits
    assert sorted(order_of(indices, grid).tolist()) == list(range(len(indices)))


def test_outliers_do_not_coarsen_the_middle() -> None:
    near = np.rint(make_cloud(1000).positions * 2000).astype(np.int64)
    far = np.rint(with_outliers(make_cloud(1000), 5, 1e5).positions * 2000).astype(np.int64)
    assert not plan_grid(near).has_excess
    grid = plan_grid(far)
    assert grid.has_excess
    assert grid.shift == 0


def test_a_point_needs_no_bits() -> None:
    grid = plan_grid(np.full((5, 3), -77))
    assert (grid.bits, grid.shift, grid.origin, grid.has_excess) == (0, 0, (-77, -77, -77), False)
    assert order_of(np.full((5, 3), -77), grid).tolist() == [0, 1, 2, 3, 4]


# --- symbols ------------------------------------------------------------------------------------------

STEPS = dict.fromkeys(Attribute, 1000) | {Attribute.ROTATION: 256}
QUANTISATION = Quantisation(UNITS, STEPS, frozenset(), STEPS, frozenset())


def test_inter_symbols_follow_the_target() -> None:
    first, second = make_cloud(300, 1, 1), make_cloud(300, 1, 2)
    before, target = planes_of(first), planes_of(second)
    reference = FrameState({a: Plane(v) for a, v in before.items()})
    symbols = inter_symbols(
        target, before, (reference, reference), ResidualQuantiser(QUANTISATION, ZeroBin(0.6))
    )
    state = reconstruct_inter(symbols, STEPS, reference)
    for attribute, values in target.items():
        if attribute != Attribute.ROTATION:
            assert np.abs(state.planes[attribute].wide() - values).max() <= 600
    degrees = rotation_degrees(second, cloud_of(state))
    assert degrees.max() <= np.degrees(4 * np.sqrt(3) * 0.6 * 256 / 2**18) + 1e-4


def test_coarser_steps_are_those_of_the_decoder() -> None:
    first, second = make_cloud(300, 1, 1), make_cloud(300, 1, 2)
    before, target = planes_of(first), planes_of(second)
    reference = FrameState({a: Plane(v) for a, v in before.items()})
    rng = np.random.default_rng(0)
    multipliers = {attribute: rng.integers(256, 2049, (300, 1)) for attribute in target}
    quantiser = ResidualQuantiser(QUANTISATION, ZeroBin(0.6), multipliers)
    symbols = inter_symbols(target, before, (reference, reference), quantiser)
    state = reconstruct_inter(symbols, STEPS, reference, multipliers)
    for attribute, values in target.items():
        limit = 0.6 * STEPS[attribute] * multipliers[attribute] / 256 + 1
        if attribute != Attribute.ROTATION:
            assert (np.abs(state.planes[attribute].wide() - values) <= limit).all()
    plain = inter_symbols(target, before, (reference, reference), replace(quantiser, multipliers={}))
    for attribute, activity in symbols.activity.items():
        assert np.abs(activity.symbols).sum() < np.abs(plain.activity[attribute].symbols).sum()


def test_what_did_not_change_gets_no_symbols() -> None:
    cloud = make_cloud(300, 1)
    before = planes_of(cloud)
    far_off = FrameState({a: Plane(v + 5000 * (a != Attribute.ROTATION)) for a, v in before.items()})
    coding = ResidualQuantiser(QUANTISATION, ZeroBin(0.6))
    assert inter_symbols(before, before, (far_off, far_off), coding).activity == {}
    target = before | {Attribute.SCALE: before[Attribute.SCALE].copy()}
    target[Attribute.SCALE][7] += 1
    found = inter_symbols(target, before, (far_off, far_off), coding).activity
    assert list(found) == [Attribute.SCALE]
    assert np.flatnonzero(found[Attribute.SCALE].significant()).tolist() == [7]


@pytest.mark.parametrize("bounded", [False, True])
def test_a_bounded_attribute_has_no_dead_zone(bounded: bool) -> None:
    before = planes_of(coincident_cloud(64))
    target = before | {Attribute.POSITION: before[Attribute.POSITION] + 550}
    reference = FrameState({a: Plane(v) for a, v in before.items()})
    some = frozenset({Attribute.POSITION} if bounded else ())
    quantisation = Quantisation(UNITS, STEPS, some, STEPS, some)
    found = inter_symbols(
        target, before, (reference, reference), ResidualQuantiser(quantisation, ZeroBin(0.6))
    )
    assert (Attribute.POSITION in found.activity) is bounded


def test_symbols_of_all_are_those_of_each() -> None:
    # more than are looked at together; some change, then all do
    first, second = make_cloud(9000, 0, 1), make_cloud(9000, 0, 2)
    before, target = planes_of(first), planes_of(second)
    rng = np.random.default_rng(0)
    slack = {a: rng.integers(1, 60, (9000, 1)) for a in target}
    multipliers = {a: rng.integers(256, 2049, (9000, 1)) for a in target}
    quantiser = ResidualQuantiser(QUANTISATION, ZeroBin(0.6), multipliers, slack)
    everyone, some = np.arange(9000), np.arange(1, 9000, 2)
    for attribute, values in target.items():
        whole = quantiser.symbols(attribute, everyone, values, before[attribute])
        part = quantiser.symbols(attribute, some, values, before[attribute])
        assert np.array_equal(whole[some], part[some])
        assert whole.any()
        assert not np.delete(part, some, axis=0).any()

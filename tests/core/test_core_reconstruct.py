"""Reconstruction, steps and companding of the core (spec sections 8.3, 9.3 to 9.8)."""

from __future__ import annotations

import numpy as np
import pytest

from dfcgs_codec.bitstream.constants import STATE_LIMIT, Attribute, Precision
from dfcgs_codec.bitstream.frame_headers import IntraSteps
from dfcgs_codec.bitstream.sequence_header import UnitExponents
from dfcgs_codec.codec.frame.reconstruct import reconstruct_inter
from dfcgs_codec.codec.intra.steps import IntraWeights, column_steps, position_octaves, turn_steps
from dfcgs_codec.codec.intra.walk import MAX_TURN_STEP
from dfcgs_codec.codec.residual.classes import AttributeActivity, InterSymbols
from dfcgs_codec.codec.state.planes import FrameState, Plane
from dfcgs_codec.codec.state.visibility import MULTIPLIERS, Visibility
from dfcgs_codec.errors import CorruptBitstream
from dfcgs_codec.transform.companding import compress, expand, expand_thinness
from dfcgs_codec.transform.rotation import normalise, round_divide
from dfcgs_codec.transform.trellis import step_values
from tests.core.machines import CORRUPT, OK, call, int32

pytestmark = pytest.mark.usefixtures("both_machines")

EXPONENTS = (-60, -40, -20, -13, -11)


def spread(rng: np.random.Generator, shape: tuple[int, ...], reach: int = STATE_LIMIT) -> np.ndarray:
    """Integers of all magnitudes up to `reach`, zeros among them."""
    shifts = rng.integers(0, reach.bit_length() + 1, shape)
    return rng.integers(-reach, reach + 1, shape) >> shifts


@pytest.mark.parametrize("exponent", EXPONENTS)
def test_companding(exponent: int) -> None:
    rng = np.random.default_rng(-exponent)
    values = spread(rng, (5000,))
    logits, opacities = np.zeros(5000, np.int64), np.zeros(5000, np.int32)
    call("expand_opacities", int32(values), 5000, exponent, logits)
    assert np.array_equal(logits, expand(values, exponent))
    call("compress_logits", int32(values), 5000, exponent, opacities)
    assert np.array_equal(opacities, compress(values, exponent))


@pytest.mark.parametrize("octaves", [1, 6, 8])
@pytest.mark.parametrize("exponent", EXPONENTS)
def test_third_axis(exponent: int, octaves: int) -> None:
    rng = np.random.default_rng(octaves - exponent)
    second, thinness = spread(rng, (2, 3000))
    wanted = second - expand_thinness(thinness, exponent, octaves)
    kept = np.abs(wanted) <= STATE_LIMIT
    third = np.zeros(int(kept.sum()), np.int32)
    arguments = int32(second[kept]), int32(thinness[kept]), len(third), exponent, octaves, third
    assert call("third_axis", *arguments) == OK
    assert np.array_equal(third, wanted[kept])
    if not kept.all():
        found = np.zeros(3000, np.int32)
        assert call("third_axis", int32(second), int32(thinness), 3000, exponent, octaves, found) == CORRUPT


def _frame(rng: np.random.Generator, count: int) -> FrameState:
    scales = np.where(
        rng.random((count, 1)) < 0.5, spread(rng, (count, 3)), rng.integers(-9000, 9000, (count, 3))
    )
    opacities = np.where(
        rng.random((count, 1)) < 0.5, spread(rng, (count, 1)), spread(rng, (count, 1), 30_000)
    )
    rotations = normalise(rng.integers(-(1 << 24), 1 << 24, (count, 4)))
    planes = {
        Attribute.POSITION: spread(rng, (count, 3)),
        Attribute.SCALE: scales,
        Attribute.ROTATION: np.clip(rotations, -(1 << 24), 1 << 24),
        Attribute.OPACITY: opacities,
        Attribute.SH_DC: spread(rng, (count, 3)),
    }
    cover = rng.integers(0, 16, count) if rng.random() < 0.7 else None
    return FrameState({a: Plane(values) for a, values in planes.items()}, cover=cover)


def _units(scale: int, opacity: int) -> UnitExponents:
    return UnitExponents(-10, scale, opacity, -8, (0, 0, 0), Precision.FLOAT32)


def _cover(frame: FrameState) -> np.ndarray | None:
    return None if frame.cover is None else frame.cover.astype(np.uint8)


LEVELS = (-STATE_LIMIT, -300, -50, 0, 77, STATE_LIMIT)
SHOWN = {
    Attribute.POSITION: 0,
    Attribute.OPACITY: 1,
    Attribute.ROTATION: 2,
    Attribute.SCALE: 3,
    Attribute.SH_DC: 3,
}


@pytest.mark.parametrize("scale", [-60, -11, -3, 0, 11, 60])
@pytest.mark.parametrize("opacity", EXPONENTS)
def test_visibility(scale: int, opacity: int) -> None:
    count = 700
    frame = _frame(np.random.default_rng(scale * 100 + 10_000 - opacity), count)
    known = Visibility(frame, _units(scale, opacity))
    weights, found = np.zeros((4, count), np.int32), np.zeros(count, np.uint8)
    scales, opacities = frame.planes[Attribute.SCALE].values, frame.planes[Attribute.OPACITY].values
    call("visibility", scales, opacities, _cover(frame), count, scale, opacity, weights)
    for attribute, kind in SHOWN.items():
        for level in LEVELS:
            call("coarseness", np.ascontiguousarray(weights[kind]), count, level, 3, 16, found)
            assert np.array_equal(found, known.coarseness(attribute, level))


@pytest.mark.parametrize("scale", [-60, -11, -3, 0, 11, 60])
@pytest.mark.parametrize("opacity", EXPONENTS)
def test_steps_of_intra_frames(scale: int, opacity: int) -> None:
    count, units = 700, _units(scale, opacity)
    rng = np.random.default_rng(scale * 100 + 20_000 - opacity)
    frame = _frame(rng, count)
    cover = rng.integers(0, 16, count)
    scales, opacities = frame.planes[Attribute.SCALE].values, frame.planes[Attribute.OPACITY].values
    known = IntraWeights(cover).with_scales(scales, units).with_opacities(opacities.astype(np.int64), units)
    covers = cover.astype(np.uint8)
    weights = np.zeros((6, count), np.int32)
    needles, found = np.zeros((2, count), np.uint8)
    call("cover_weights", covers, count, weights[0])
    call("area_weights", scales, covers, count, scale, weights[1])
    call("alpha_weights", opacities, covers, count, opacity, weights[2])
    call("seen_weights", scales, opacities, covers, count, scale, opacity, *weights[3:], needles)
    assert np.array_equal(needles, known.is_needle)
    for level in LEVELS:
        for step in (1, 37, STATE_LIMIT):
            rule = IntraSteps(
                dict.fromkeys(Attribute, step), 8, dict.fromkeys(Attribute, level), 0, frozenset()
            )
            tilts, spins = (np.minimum(steps, MAX_TURN_STEP) for steps in turn_steps(rule, known))
            wanted = {
                (0, "steps"): column_steps(rule, Attribute.SCALE, known),
                (1, "steps"): column_steps(rule, Attribute.OPACITY, known),
                (3, "steps"): column_steps(rule, Attribute.SH_2, known),
                (4, "turn_steps"): tilts,
                (5, "turn_steps"): spins,
            }
            for (kind, name), expected in wanted.items():
                table = np.zeros(17, np.int64)
                call(name, step, table)
                call("coarseness", weights[kind], count, level, 3, 16, found)
                assert np.array_equal(table[found], expected)
            call("coarseness", weights[2], count, level, 5, 8, found)
            assert np.array_equal(found, position_octaves(rule, known))


def _reconstructed(
    frame: FrameState, attribute: Attribute, symbols: np.ndarray, step: int, level: int | None
) -> None:
    """By the core and by numpy, or refused by both."""
    count = len(symbols)
    multipliers, coarseness = None, None
    if level is not None:
        known = Visibility(frame, _units(-11, -11))
        multipliers = {attribute: known.multipliers(attribute, level)}
        coarseness = np.searchsorted(MULTIPLIERS, multipliers[attribute][:, 0]).astype(np.uint8)
    plane = np.array(frame.planes[attribute].values)
    if attribute == Attribute.ROTATION:
        status = call("turn", plane, int32(symbols), count, step, coarseness)
    else:
        status = call("reconstruct", plane, int32(symbols), count, plane.shape[1], step, coarseness)
    zeros = np.zeros(count, np.int64)
    activity = InterSymbols({attribute: AttributeActivity(symbols, zeros, zeros)})
    try:
        wanted = reconstruct_inter(activity, {attribute: step}, frame, multipliers)
    except CorruptBitstream:
        assert status == CORRUPT
        return
    assert status == OK
    assert np.array_equal(plane, wanted.planes[attribute].values)


@pytest.mark.parametrize("step", [1, 2, 3, 1000, 1 << 20, STATE_LIMIT])
@pytest.mark.parametrize("level", [None, -100, 50])
@pytest.mark.parametrize("attribute", [Attribute.POSITION, Attribute.SH_DC, Attribute.ROTATION])
def test_reconstruction(attribute: Attribute, level: int | None, step: int) -> None:
    rng = np.random.default_rng(step + int(attribute))
    for count in (0, 1, 400):
        for reach in (0, 3, 2 * STATE_LIMIT // step, 2 * STATE_LIMIT // step + 1):
            frame = _frame(rng, count)
            _reconstructed(frame, attribute, spread(rng, (count, 3), reach), step, level)
    near = 2 * STATE_LIMIT // step
    for symbol in (near, near + 1, -near, -near - 1):
        _reconstructed(_frame(rng, 1), attribute, np.array([[0, symbol, 0]]), step, level)


@pytest.mark.parametrize("count", [512, 513, 1000, 5000])
def test_second_quantisers(count: int) -> None:
    rng = np.random.default_rng(count)
    symbols, steps = spread(rng, (count,), 1000), rng.integers(1, 1000, count)
    second = np.zeros(count, np.uint8)
    call("second_quantisers", int32(symbols), count, second)
    worth = (2 * symbols - np.sign(symbols) * second) * steps >> 1
    assert np.array_equal(worth, step_values(symbols, steps, alternating=True))


@pytest.mark.parametrize("step", [1, 3, 4096, STATE_LIMIT])
def test_positions_of_intra_frames(step: int) -> None:
    rng = np.random.default_rng(step)
    count = 3000
    octaves = rng.integers(0, 9, count)
    index = spread(rng, (count, 3), 2 * STATE_LIMIT // step)
    width = (1 << octaves)[:, None]
    wanted = index * width * step + ((width - 1) * step >> 1)
    kept = (np.abs(wanted) <= STATE_LIMIT).all(axis=1)
    found = np.zeros((int(kept.sum()), 3), np.int32)
    some = octaves.astype(np.uint8)[kept]
    assert call("intra_positions", int32(index[kept]), len(found), some, step, found) == OK
    assert np.array_equal(found, wanted[kept])
    if not kept.all():
        all_octaves, scratch = octaves.astype(np.uint8), np.zeros((count, 3), np.int32)
        assert call("intra_positions", int32(index), count, all_octaves, step, scratch) == CORRUPT
    anchors = np.zeros_like(found)
    call("anchors", found, len(found), step, anchors)
    assert np.array_equal(anchors, round_divide(wanted[kept], step))

from __future__ import annotations

import numpy as np
import pytest

from dfcgs_codec.bitstream.constants import STATE_LIMIT, Attribute
from dfcgs_codec.bitstream.sequence_header import UnitExponents
from dfcgs_codec.codec.frame.reconstruct import reconstruct_inter
from dfcgs_codec.codec.intra.verbatim import state_of
from dfcgs_codec.codec.residual.classes import AttributeActivity, InterSymbols
from dfcgs_codec.codec.state.planes import FrameState, Plane
from dfcgs_codec.encoder.residual.block_classes import classify_blocks
from dfcgs_codec.errors import CorruptBitstream
from dfcgs_codec.transform.rotation import ONE
from lab.small_clouds import make_cloud

UNITS = UnitExponents(-12, -12, -12, -12)


def activity(symbols: np.ndarray) -> AttributeActivity:
    return AttributeActivity(symbols, *classify_blocks(symbols))


def reference(count: int = 30) -> FrameState:
    return FrameState(state_of(make_cloud(count, 1), UNITS).planes)


def some_rows(count: int, columns: int, every: int) -> np.ndarray:
    symbols = np.zeros((count, columns), np.int64)
    symbols[::every] = np.random.default_rng(0).integers(1, 9, (len(range(0, count, every)), columns))
    return symbols


def test_inter_beyond_the_state_is_corrupt() -> None:
    full = FrameState({Attribute.SCALE: Plane(np.full((4, 3), STATE_LIMIT))})
    symbols = InterSymbols({Attribute.SCALE: activity(some_rows(4, 3, 2))})
    with pytest.raises(CorruptBitstream, match="range of the state"):
        reconstruct_inter(symbols, {Attribute.SCALE: 1}, full)


def test_inter_adds_symbols_times_step() -> None:
    before, symbols = reference(), some_rows(30, 3, 4)
    after = reconstruct_inter(
        InterSymbols({Attribute.POSITION: activity(symbols)}), {Attribute.POSITION: 9}, before
    )
    difference = after.planes[Attribute.POSITION].wide() - before.planes[Attribute.POSITION].wide()
    assert np.array_equal(difference, symbols * 9)


def test_attributes_without_symbols_are_the_reference_itself() -> None:
    before = reference()
    symbols = InterSymbols({Attribute.POSITION: activity(some_rows(30, 3, 4))})
    after = reconstruct_inter(symbols, {Attribute.POSITION: 9}, before)
    for attribute in (Attribute.SCALE, Attribute.ROTATION, Attribute.OPACITY, Attribute.SH_1):
        assert after.planes[attribute] is before.planes[attribute]
    assert reconstruct_inter(InterSymbols(), {}, before).hash() == before.hash()


def test_rows_without_symbols_keep_their_bits_for_300_frames() -> None:
    before = state = reference(200)
    turn = some_rows(200, 3, 5)
    for _ in range(300):
        activities = {Attribute.ROTATION: activity(turn), Attribute.POSITION: activity(turn)}
        steps = {Attribute.ROTATION: 700, Attribute.POSITION: 3}
        state = reconstruct_inter(InterSymbols(activities), steps, state)
    still = ~turn.any(axis=1)
    for attribute in (Attribute.ROTATION, Attribute.POSITION):
        first, last = before.planes[attribute].values, state.planes[attribute].values
        assert np.array_equal(first[still], last[still])
        assert (first[~still] != last[~still]).any(axis=1).all()


def test_turns_keep_unit_length() -> None:
    state = reference(200)
    rng = np.random.default_rng(1)
    for _ in range(50):
        symbols = InterSymbols({Attribute.ROTATION: activity(rng.integers(-99, 99, (200, 3)))})
        state = reconstruct_inter(symbols, {Attribute.ROTATION: 500}, state)
    length = np.sqrt((state.planes[Attribute.ROTATION].wide() ** 2).sum(axis=1))
    assert np.abs(length / ONE - 1).max() < 2.0**-22


def verbatim_reference() -> FrameState:
    first = state_of(make_cloud(4), UNITS)
    return FrameState(first.planes, Plane(np.arange(4)[::-1, None].copy()), first.verbatim)


def test_a_p_frame_keeps_the_order_and_drops_the_verbatim_floats() -> None:
    before = verbatim_reference()
    symbols = InterSymbols({Attribute.POSITION: activity(some_rows(4, 3, 2))})
    after = reconstruct_inter(symbols, {Attribute.POSITION: 1}, before)
    assert after.order is before.order
    assert after.verbatim is None


def test_a_skipped_frame_is_its_reference_floats_and_all() -> None:
    before = verbatim_reference()
    after = reconstruct_inter(InterSymbols(), {}, before)
    assert after.verbatim is before.verbatim
    assert after.hash() == before.hash()


@pytest.mark.parametrize("symbol", [2**31, -(2**40), 2**62, -(2**63)])
@pytest.mark.parametrize("attribute", [Attribute.POSITION, Attribute.ROTATION])
def test_symbols_beyond_64_bits_are_corrupt(symbol: int, attribute: Attribute) -> None:
    symbols = np.zeros((4, 3), np.int64)
    symbols[2, 1] = symbol
    steps = {attribute: STATE_LIMIT}
    coded = InterSymbols({attribute: AttributeActivity(symbols, np.ones(1, np.int64), np.ones(1, np.int64))})
    with pytest.raises(CorruptBitstream):
        reconstruct_inter(coded, steps, reference(4))

"""Control points of a GoF carry its Gaussians along."""

from __future__ import annotations

import numpy as np
import pytest

from dfcgs_codec.bitstream.constants import STATE_LIMIT, Attribute
from dfcgs_codec.bitstream.frame_headers import ControlHeader
from dfcgs_codec.bitstream.motion_header import MotionHeader
from dfcgs_codec.codec.motion.compensation import GofMotion, turned
from dfcgs_codec.codec.motion.field import level_starts
from dfcgs_codec.codec.motion.walk import MotionSymbols
from dfcgs_codec.codec.state.planes import FrameState, Plane
from dfcgs_codec.encoder.residual.block_classes import classify_modes
from dfcgs_codec.errors import CorruptBitstream
from dfcgs_codec.transform.rotation import ONE, from_float
from lab.small_clouds import make_cloud

CONTROL = ControlHeader(20, 2)
RULES = [CONTROL, ControlHeader(10_000, 2)]


def state_of(count: int, seed: int = 0) -> FrameState:
    cloud = make_cloud(count, 0, seed)
    positions = np.rint(cloud.positions * 5000).astype(np.int64)
    planes = {Attribute.POSITION: positions, Attribute.ROTATION: from_float(cloud.rotations)}
    return FrameState({attribute: Plane(values) for attribute, values in planes.items()})


def start(state: FrameState, control: ControlHeader = CONTROL) -> GofMotion:
    return GofMotion.of(state.planes[Attribute.POSITION].wide(), control)


def symbols_of(motion: GofMotion, control: np.ndarray, follows: np.ndarray) -> MotionSymbols:
    whole = np.zeros((motion.field.num_points, 6), np.int64)
    whole[: len(control), : control.shape[1]] = control
    return MotionSymbols(whole, classify_modes(follows), follows)


def test_levels_of_control_points() -> None:
    assert level_starts(1) == [0, 1]
    assert level_starts(2) == [0, 1, 2]
    assert level_starts(16) == [0, 1, 4, 16]
    assert level_starts(50) == [0, 1, 4, 16, 50]


@pytest.mark.parametrize("control", RULES)
@pytest.mark.parametrize("turn_step", [0, 7])
def test_standing_still_for_300_frames_changes_no_bit(control: ControlHeader, turn_step: int) -> None:
    first = state_of(150)
    motion, state = start(first, control), first
    header = MotionHeader(5, turn_step)
    symbols = symbols_of(motion, np.zeros((0, 6)), np.ones(150, bool))
    for _ in range(300):
        carried = motion.carry(header, symbols, state)
        motion, state = motion.after(carried, symbols, (state, carried.state)), carried.state
    assert state.hash() == first.hash()


def test_those_who_do_not_follow_keep_every_bit() -> None:
    state = state_of(400)
    motion = start(state)
    control = np.random.default_rng(0).integers(-50, 50, (motion.field.num_points, 6))
    follows = np.arange(400) % 3 == 0
    carried = motion.carry(MotionHeader(40, 300), symbols_of(motion, control, follows), state)
    for attribute in (Attribute.POSITION, Attribute.ROTATION):
        changed = (carried.state.planes[attribute].values != state.planes[attribute].values).any(axis=1)
        assert np.array_equal(changed, follows)


@pytest.mark.parametrize("control", RULES)
def test_one_symbol_moves_the_whole_scene(control: ControlHeader) -> None:
    """What the first control point does, all others are expected to do."""
    state = state_of(400)
    motion = start(state, control)
    carried = motion.carry(
        MotionHeader(10, 0),
        symbols_of(motion, np.array([[7, -3, 1, 0, 0, 0]]), np.ones(400, bool)),
        state,
    )
    moved = carried.state.planes[Attribute.POSITION].wide() - state.planes[Attribute.POSITION].wide()
    assert (moved == [70, -30, 10]).all()
    assert carried.state.planes[Attribute.ROTATION] is state.planes[Attribute.ROTATION]


def test_one_turn_turns_the_whole_scene_rigidly() -> None:
    state = state_of(400)
    motion = start(state)
    carried = motion.carry(
        MotionHeader(10, 1000),
        symbols_of(motion, np.array([[0, 0, 0, 0, 0, 30]]), np.ones(400, bool)),
        state,
    )
    old = state.planes[Attribute.POSITION].wide()
    new = carried.state.planes[Attribute.POSITION].wide()
    pivot = old[motion.field.gaussians[0]]
    assert np.abs(new - old).max() > 500
    before, after = (np.linalg.norm((p - pivot).astype(float), axis=1) for p in (old, new))
    assert np.abs(before - after).max() < 4
    assert (new[:, 2] == old[:, 2]).all()
    lengths = np.linalg.norm(carried.state.planes[Attribute.ROTATION].values / ONE, axis=1)
    assert np.abs(lengths - 1).max() < 1e-6


def test_the_end_of_the_world_is_not_left() -> None:
    state = FrameState(
        {
            Attribute.POSITION: Plane(np.full((4, 3), STATE_LIMIT - 5)),
            Attribute.ROTATION: Plane(np.tile([ONE, 0, 0, 0], (4, 1))),
        }
    )
    motion = start(state)
    symbols = symbols_of(motion, np.array([[1, -1, 0, 0, 0, 0]]), np.ones(4, bool))
    carried = motion.carry(MotionHeader(100, 0), symbols, state)
    assert carried.state.planes[Attribute.POSITION].values[0].tolist() == [
        STATE_LIMIT,
        STATE_LIMIT - 105,
        STATE_LIMIT - 5,
    ]


def test_symbols_beyond_the_grid_are_corrupt() -> None:
    state = state_of(100)
    motion = start(state)
    symbols = symbols_of(motion, np.array([[1 << 30, 0, 0, 0, 0, 0]]), np.ones(100, bool))
    with pytest.raises(CorruptBitstream):
        motion.carry(MotionHeader(9, 0), symbols, state)


def test_turns_of_many_are_those_of_each() -> None:
    # more than are looked at together
    random = np.random.default_rng(5)
    quaternions = from_float(random.normal(size=(20_000, 4)).astype(np.float32))
    vectors = random.integers(-9000, 9000, (20_000, 3)) * (random.random((20_000, 1)) < 0.7)
    whole = turned(quaternions, vectors)
    assert np.array_equal(whole[~vectors.any(axis=1)], quaternions[~vectors.any(axis=1)])
    for rows in (slice(0, 9), slice(8190, 8195), slice(19_990, 20_000)):
        assert np.array_equal(turned(quaternions[rows], vectors[rows]), whole[rows])
    assert (whole != quaternions).any(axis=1).mean() > 0.6

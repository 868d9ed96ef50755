"""Control points of the core and how they move (spec sections 9.1, 14)."""

from __future__ import annotations

import ctypes

import numpy as np
import pytest

from dfcgs_codec.bitstream.constants import STATE_LIMIT, Attribute
from dfcgs_codec.bitstream.frame_headers import ControlHeader
from dfcgs_codec.bitstream.motion_header import MotionHeader
from dfcgs_codec.codec.motion.compensation import GofMotion
from dfcgs_codec.codec.motion.control_points import ControlPrior
from dfcgs_codec.codec.motion.field import control_points
from dfcgs_codec.codec.motion.followers import Binding
from dfcgs_codec.codec.motion.walk import MotionSymbols
from dfcgs_codec.codec.state.planes import FrameState, Plane
from dfcgs_codec.errors import CorruptBitstream
from dfcgs_codec.model.registry import context_model
from dfcgs_codec.transform.control_points import control_cells, farthest_points, gather_from
from dfcgs_codec.transform.morton import canonical_order, morton_keys
from dfcgs_codec.transform.rotation import normalise
from tests.core.bindings import BINDING, same
from tests.core.machines import CORRUPT, OK, Arena, call, int32

pytestmark = pytest.mark.usefixtures("both_machines")


def _clouds(seed: int, count: int) -> np.ndarray:
    """Cells in one of several arrangements, with many ties."""
    rng = np.random.default_rng(seed)
    reach = int(rng.choice([0, 1, 3, 20, 1000, 1 << 20]))
    cells = rng.integers(-reach, reach + 1, (count, 3))
    if seed % 3 == 1:
        cells = np.rint(rng.normal(0, reach / 5, (count, 3))).astype(np.int64)
        cells = np.clip(cells, -(1 << 20), 1 << 20)
    if seed % 3 == 2:
        cells[:, 2] = 0
    if seed % 2:
        cells = cells[canonical_order(morton_keys(np.minimum(cells + (1 << 20), (1 << 21) - 1)), cells)]
    return cells


COUNTS = (1, 2, 5, 63, 64, 65, 300, 5000)


@pytest.mark.parametrize("count", COUNTS)
@pytest.mark.parametrize("seed", range(6))
def test_farthest_points(count: int, seed: int) -> None:
    cells = _clouds(seed, count)
    for wanted in {1, max(1, count // 40), min(count, 200)}:
        chosen, found = np.zeros(wanted, np.uint32), np.zeros(1, np.uint32)
        assert call("farthest_points", Arena.of(1 << 20), int32(cells), count, wanted, chosen, found) == OK
        assert np.array_equal(chosen[: found[0]], farthest_points(cells, wanted))


@pytest.mark.parametrize("count", COUNTS)
@pytest.mark.parametrize("seed", range(6))
def test_gathering(count: int, seed: int) -> None:
    cells, rng = _clouds(seed, count), np.random.default_rng(seed)
    for num in {1, 2, 4, 5, 6, 40, 700}:
        control = np.concatenate([cells[rng.integers(0, count, num // 2)], _clouds(seed, num - num // 2)])
        records = np.zeros(count, BINDING)
        assert call("gather", Arena.of(1 << 20), int32(cells), count, int32(control), num, records) == OK
        assert same(records, Binding.of(gather_from(cells, control)))


def test_no_memory_is_said() -> None:
    cells, found = np.zeros((500, 3), np.int32), np.zeros(1, np.uint32)
    for size in range(0, 20_000, 1000):
        room = np.zeros(500, BINDING)
        assert call("gather", Arena.of(size // 4), cells, 500, cells, 100, room) > CORRUPT or size > 4000
        assert call("farthest_points", Arena.of(size), cells, 500, 9, room, found) > CORRUPT


@pytest.mark.parametrize("shift", [0, 7, 31])
def test_cells_and_keys(shift: int) -> None:
    rng = np.random.default_rng(shift)
    positions = rng.integers(-STATE_LIMIT, STATE_LIMIT + 1, (2000, 3)) >> rng.integers(0, 29, (2000, 1))
    cells, keys = np.zeros((2000, 3), np.int32), np.zeros(2000, np.uint64)
    call("control_cells", int32(positions), 2000, int32(positions[1000]), shift, cells)
    wanted = control_cells(positions, positions[1000], shift)
    assert np.array_equal(cells, wanted)
    call("cell_keys", cells, 2000, keys)
    assert np.array_equal(keys.astype(np.int64), morton_keys(np.minimum(wanted + (1 << 20), (1 << 21) - 1)))


class Field(ctypes.Structure):
    """`dfcgs_field`, its arrays numpy's."""

    _fields_ = (
        ("count", ctypes.c_uint32),
        *((name, ctypes.c_void_p) for name in ("pivots", "translations", "vectors")),
        *((name, ctypes.c_void_p) for name in ("translation_habits", "turn_habits", "bindings", "table")),
    )

    @staticmethod
    def of(positions: np.ndarray, points: np.ndarray, cells: np.ndarray) -> Field:
        count = len(points)
        field = Field(count)
        field.arrays = {
            name: np.zeros((count, 3), np.int32) for name in ("pivots", "translations", "vectors")
        }
        habits = ("translation_habits", "turn_habits")
        field.arrays |= {name: np.zeros((count, 3), np.int64) for name in habits}
        field.arrays |= {"bindings": np.zeros(count, BINDING), "table": np.zeros((count, 12), np.int64)}
        field.arrays["pivots"][:] = positions[points]
        for name, array in field.arrays.items():
            setattr(field, name, array.ctypes.data)
        assert call("bind_levels", Arena.of(1 << 20), int32(cells[points]), field) == OK
        return field


class _Both:
    """The motion of a GoF, by numpy and by the core."""

    def __init__(self, seed: int, count: int, reach: int) -> None:
        self.rng = np.random.default_rng(seed)
        positions = self.rng.integers(-reach, reach + 1, (count, 3))
        rotations = normalise(self.rng.integers(-(1 << 24), 1 << 24, (count, 4)))
        self.state = self._frame(positions, np.clip(rotations, -(1 << 24), 1 << 24))
        self.control = ControlHeader(int(self.rng.integers(3, 40)), int(self.rng.integers(0, 12)))
        self.motion = GofMotion.of(positions, self.control)
        points, cells = control_points(self.motion.cells, self.control), self.motion.cells
        self.field, self.bindings = Field.of(positions, points, cells), np.zeros(count, BINDING)
        call(
            "gather", Arena.of(1 << 20), int32(cells), count, int32(cells[points]), len(points), self.bindings
        )

    @staticmethod
    def _frame(positions: np.ndarray, rotations: np.ndarray) -> FrameState:
        return FrameState({Attribute.POSITION: Plane(positions), Attribute.ROTATION: Plane(rotations)})

    def check(self) -> None:
        """All that is kept from frame to frame is the same."""
        arrays, field = self.field.arrays, self.motion.field
        assert np.array_equal(arrays["pivots"], field.pivots)
        assert np.array_equal(arrays["translation_habits"], field.history.translations)
        assert np.array_equal(arrays["turn_habits"], field.history.vectors)
        start = 1
        for parent in field.parents:
            assert same(arrays["bindings"][start : start + len(parent.choice)], parent)
            start += len(parent.choice)
        assert same(self.bindings, self.motion.binding)

    def inputs(self, header: MotionHeader, before: np.ndarray) -> None:
        """Inputs of the networks of control points are the same."""
        known = ControlPrior.of(context_model("main-1"), self.motion.field, header, before)
        count = self.field.count
        inputs, expected = np.zeros((count, 4), np.uint8), np.zeros((count, 6), np.int64)
        steps = header.translation_step, header.turn_step
        call("control_inputs", self.field, int32(before), *steps, inputs, expected)
        assert np.array_equal(expected, known.expected)
        assert np.array_equal(inputs, known.inputs)

    def frame(self, header: MotionHeader, symbols: np.ndarray, noise: int) -> bool:
        """Motion, residual and learning of a frame; False where both refuse it."""
        count = len(self.bindings)
        follows = self.rng.random(count) < self.rng.choice([0.0, 0.5, 1.0])
        steps = header.translation_step, header.turn_step
        status = call("move_field", self.field, int32(symbols), *steps)
        known = MotionSymbols(symbols, self.motion.symbols.modes, follows)
        try:
            carried = self.motion.carry(header, known, self.state)
        except CorruptBitstream:
            assert status == CORRUPT
            return False
        assert status == OK
        planes = self.state.planes
        positions, rotations = (np.array(planes[a].values) for a in (Attribute.POSITION, Attribute.ROTATION))
        reference, flags = positions.copy(), follows.astype(np.uint8)
        call("carry", self.field, self.bindings, flags, count, int(header.is_rigid), positions, rotations)
        assert np.array_equal(positions, carried.state.planes[Attribute.POSITION].values)
        assert np.array_equal(rotations, carried.state.planes[Attribute.ROTATION].values)
        decoded = np.clip(
            positions + self.rng.integers(-noise, noise + 1, (count, 3)), -STATE_LIMIT, STATE_LIMIT
        )
        frame = self._frame(decoded, rotations)
        self.motion = self.motion.after(carried, known, (self.state, frame))
        narrow = int32(decoded)
        call("learn", self.field, self.bindings, flags, count, reference, narrow, header.translation_step)
        call("learn_field", self.field, header.translation_step)
        self.state = frame
        self.check()
        return True


@pytest.mark.parametrize("seed", range(16))
def test_motion_of_a_gof(seed: int) -> None:
    rng = np.random.default_rng(seed)
    both = _Both(seed, int(rng.integers(1, 1500)), int(rng.choice([10, 5000, 1 << 20, STATE_LIMIT])))
    both.check()
    before = np.zeros((both.field.count, 6), np.int64)
    for _ in range(5):
        header = MotionHeader(int(rng.choice([1, 3, 500])), int(rng.choice([0, 1, 200, 1 << 18])))
        sizes = rng.choice([1, 50, 1 << 22])
        symbols = np.rint(rng.laplace(0, sizes, before.shape)).astype(np.int64)
        symbols[:, 3:] = symbols[:, 3:] // 50 if header.is_rigid else 0
        symbols = np.clip(symbols, *(sign * 2 * STATE_LIMIT // (1 << 19) for sign in (-1, 1)))
        both.inputs(header, before)
        assert both.frame(header, symbols, int(rng.choice([0, 3, 1000])))
        before = symbols


@pytest.mark.parametrize("column", [0, 4])
def test_symbols_that_are_too_large_are_refused(column: int) -> None:
    both = _Both(1, 200, 1000)
    symbols = np.zeros((both.field.count, 6), np.int64)
    symbols[-1, column] = -(2 * STATE_LIMIT // 7) - 1
    assert not both.frame(MotionHeader(7, 7), symbols, 0)

"""Networks of the frozen prior in the core, and what they are told (spec sections 12.1, 12.3, 17)."""

from __future__ import annotations

import ctypes
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from dfcgs_codec.bitstream.constants import Attribute
from dfcgs_codec.codec.columns.magnitudes import log_of, row_sums
from dfcgs_codec.codec.columns.prior_column import Component, others_of, rows_of_passes
from dfcgs_codec.codec.motion.followers import Binding
from dfcgs_codec.codec.residual.classes import AttributeActivity
from dfcgs_codec.codec.residual.inputs import (
    BEFORE,
    NUM_COMMON,
    AttributeInputs,
    common_inputs,
    gaussian_inputs,
)
from dfcgs_codec.model.context_model import ClassNetwork, NarrowLayer, cells_of
from dfcgs_codec.model.registry import context_model
from dfcgs_codec.transform.control_points import Gathering
from dfcgs_codec.transform.lod import build_levels
from tests.core.bindings import packed
from tests.core.machines import OK, Arena, call, int32

pytestmark = pytest.mark.usefixtures("both_machines")

PRIOR = context_model("main-1")
MODEL_MISMATCH = 5


def words_of(network: ClassNetwork) -> np.ndarray:
    """A network as the core reads it."""
    words: list[int] = [len(network.layers)]
    for layer in network.layers:
        words += [*layer.weight.shape, layer.shift, layer.limit]
        words += layer.bias.astype(np.int64).tolist() + layer.weight.astype(np.int64).ravel().tolist()
    return np.array(words, np.int32)


class CoreNetwork:
    """A network read by the core."""

    def __init__(self, network: ClassNetwork) -> None:
        self.arena, self.memory = Arena.of(1 << 16), np.zeros(1024, np.uint8)
        words, used = words_of(network), np.zeros(1, np.uint32)
        self.others = network.layers[0].weight.shape[1] - network.num_common
        self.width = -(-len(network.layers[0].bias) // 16) * 16
        classes = network.layers[-1].limit + 1
        shape = network.num_common, self.others, classes
        status = call("read_network", self.arena, words, len(words), *shape, self.memory, used)
        assert (status, used[0]) == (OK, len(words))

    def prepare(self, common: np.ndarray) -> np.ndarray:
        """Sums of common inputs."""
        prepared = np.zeros((len(common), self.width), np.int32)
        call("prepare", self.memory, common, len(common), prepared)
        return prepared


def _layer(rng: np.random.Generator, inputs: int, outputs: int, limits: tuple[int, int]) -> NarrowLayer:
    weight = rng.integers(-1000, 1001, (outputs, inputs))
    room = (1 << 24) - 1 - np.abs(weight).sum(axis=1) * limits[0]
    weight[room < 0] = 0
    room = (1 << 24) - 1 - np.abs(weight).sum(axis=1) * limits[0]
    bias = (room * rng.uniform(-1, 1, outputs)).astype(np.int64)
    shift = int(rng.integers(0, 20))
    return NarrowLayer(weight.astype(np.float32), bias.astype(np.float32), shift, limits[1])


def _random_network(seed: int) -> ClassNetwork:
    rng = np.random.default_rng(seed)
    common, others = int(rng.integers(1, 30)), int(rng.integers(1, 12))
    widths = [common + others, *rng.integers(2, 40, rng.integers(1, 4)).tolist(), 1]
    limits = [255, *rng.integers(1, 1024, len(widths) - 2).tolist(), int(rng.integers(1, 250))]
    sizes = zip(widths[:-1], widths[1:], limits[:-1], limits[1:], strict=True)
    return ClassNetwork(tuple(_layer(rng, a, b, (c, d)) for a, b, c, d in sizes), common)


def _same_classes(network: ClassNetwork, seed: int) -> None:
    rng, count = np.random.default_rng(seed), 500
    core = CoreNetwork(network)
    common = rng.integers(0, 256, (count, network.num_common)).astype(np.uint8)
    others = rng.integers(0, 256, (count, core.others)).astype(np.uint8)
    common[0], others[0] = 255, 255
    prepared, classes = core.prepare(common), np.zeros(count, np.uint8)
    wanted = network.prepare(common)
    assert np.array_equal(prepared[:, : wanted.shape[1]], wanted)
    call("classes", core.memory, prepared, others, count, classes)
    assert np.array_equal(classes, network.classes(wanted, others))


@pytest.mark.parametrize("part", [PRIOR.flags, PRIOR.columns, PRIOR.control])
def test_networks_of_the_model(part: Any) -> None:
    _same_classes(part.network, 1)


@pytest.mark.parametrize("seed", range(40))
def test_random_networks(seed: int) -> None:
    _same_classes(_random_network(seed), seed)


@pytest.mark.parametrize("place", [1, 2, 3, 4, -1])
def test_networks_that_are_none_are_refused(place: int) -> None:
    words = words_of(PRIOR.columns.network)
    words[place] = 1 << 20
    room, used = np.zeros(1024, np.uint8), np.zeros(1, np.uint32)
    found = call("read_network", Arena.of(1 << 16), words, len(words), NUM_COMMON, 10, 40, room, used)
    assert found == MODEL_MISMATCH
    assert (
        call("read_network", Arena.of(1 << 16), words, 10, NUM_COMMON, 10, 40, room, used) == MODEL_MISMATCH
    )


def _symbols(rng: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
    return rng.integers(-(1 << 30), 1 << 30, shape) >> rng.integers(0, 31, shape)


@pytest.mark.parametrize("columns", [1, 3, 21])
def test_memory(columns: int) -> None:
    rng, count = np.random.default_rng(columns), 400
    activity = AttributeActivity.none(count, columns)
    running, memory = np.zeros(count, np.int32), np.zeros((count, columns), np.int64)
    for _ in range(9):
        symbols, sizes = _symbols(rng, (count, columns)), np.zeros(count, np.uint8)
        activity = replace(activity, symbols=symbols).remembering(activity)
        call("remember", int32(symbols), count, columns, running, memory)
        assert np.array_equal(running, activity.running)
        assert np.array_equal(memory, activity.memory)
        call("log_sizes", int32(symbols), count, columns, sizes)
        assert np.array_equal(sizes, log_of(row_sums(np.abs(symbols))))


def _binding(rng: np.random.Generator, count: int) -> Binding:
    gathering = Gathering(rng.integers(0, 16384, (4, count)), rng.integers(0, 4097, (4, count)))
    return Binding(gathering, rng.integers(0, 4033, (5, count)).astype(np.int32), rng.integers(0, 5, count))


@pytest.mark.parametrize("moves", [False, True])
def test_inputs_of_gaussians(moves: bool) -> None:
    rng, count = np.random.default_rng(0), 1000
    binding = _binding(rng, count) if moves else None
    follows = rng.random(count) < 0.5 if moves else None
    found = np.zeros((count, 5), np.uint8)
    core = None if binding is None else packed(binding)
    call("gaussian_inputs", core, None if follows is None else follows.astype(np.uint8), count, found)
    assert np.array_equal(found, gaussian_inputs(binding, follows, count))


class Known(ctypes.Structure):
    """`dfcgs_known`."""

    _fields_ = (
        *((name, ctypes.c_void_p) for name in ("gaussians", "coarseness", "before", "running", "memory")),
        *((name, ctypes.c_void_p) for name in ("density_before", "density", "magnitude")),
        ("earlier", ctypes.c_void_p * 2),
        ("attribute", ctypes.c_int32),
        ("columns", ctypes.c_int32),
    )


def _pointer(array: np.ndarray | None) -> int | None:
    return None if array is None else array.ctypes.data


@pytest.mark.parametrize("attribute", list(Attribute))
@pytest.mark.parametrize("seed", range(3))
def test_common_inputs(attribute: Attribute, seed: int) -> None:
    rng, count = np.random.default_rng(seed * 10 + int(attribute)), 700
    blocks, columns = -(-count >> 6), 3
    rows = np.flatnonzero(rng.random(count) < 0.6)
    gaussians = rng.integers(0, 256, (count, 5)).astype(np.uint8)
    coarseness = rng.integers(0, 17, count) if rng.random() < 0.5 else None
    before, memory = _symbols(rng, (count, columns)), _symbols(rng, (count, columns)) * 64
    running = rng.integers(0, 1 << 24, count)
    density_before, density = rng.integers(0, 4, (2, blocks))
    magnitude = rng.integers(0, 24, blocks)
    earlier = {a: _symbols(rng, (count,)) for a in BEFORE if rng.random() < 0.5}
    block = rows >> 6
    wanted = common_inputs(
        gaussians[rows],
        AttributeInputs(
            attribute,
            None if coarseness is None else coarseness[rows],
            row_sums(np.abs(before))[rows],
            running[rows],
            row_sums(np.abs(memory))[rows],
            density_before[block],
            density[block],
            magnitude[block],
            {a: np.abs(values[rows]) for a, values in earlier.items()},
        ),
    )
    bytes_of = [None if coarseness is None else coarseness.astype(np.uint8), log_of(row_sums(np.abs(before)))]
    blocks_of = [values.astype(np.uint8) for values in (density_before, density, magnitude)]
    logs = [None if a not in earlier else log_of(np.abs(earlier[a])) for a in BEFORE]
    narrow = int32(running)
    known = Known(
        *map(_pointer, (gaussians, *bytes_of, narrow, memory, *blocks_of)),
        (ctypes.c_void_p * 2)(*map(_pointer, logs)),
        int(attribute),
        columns,
    )
    found = np.zeros((len(rows), NUM_COMMON), np.uint8)
    call("common_inputs", known, rows.astype(np.uint32), len(rows), found)
    assert np.array_equal(found, wanted)


class CoreComponent(ctypes.Structure):
    """`dfcgs_component`."""

    _fields_ = (
        *((name, ctypes.c_void_p) for name in ("network", "prepared", "others", "kinds", "own")),
        ("mean_weight", ctypes.c_int32),
    )


class _Recorder:
    """A part that keeps what a pass gives it, and answers with symbols given."""

    def __init__(self, network: ClassNetwork, symbols: np.ndarray) -> None:
        self.network, self.symbols, self.passes = network, symbols, []

    def prepare(self, common: np.ndarray) -> np.ndarray:
        return self.network.prepare(common)

    def code(self, _: Any, __: Any, inputs: Any, cells: Any) -> np.ndarray:
        contexts = cells_of(self.network.classes(*inputs), *cells)
        start = sum(len(known) for known in self.passes)
        self.passes.append(contexts)
        return self.symbols[start : start + len(contexts)]


@pytest.mark.parametrize("reach", [1, 30, 1 << 28])
@pytest.mark.parametrize("column", [0, 1, 2])
def test_passes_of_a_column(column: int, reach: int) -> None:
    rng, count = np.random.default_rng(column + reach), 3000
    before, coded = (np.rint(rng.laplace(0, reach / 5, (count, 3))).astype(np.int64) for _ in range(2))
    memory = _symbols(rng, (count, 3)) >> 5
    common = rng.integers(0, 256, (count, NUM_COMMON)).astype(np.uint8)
    weights = rng.integers(-300, 300, 3 + column)
    kinds = rng.integers(0, 4, count)
    symbols = np.rint(rng.laplace(0, reach, count)).astype(np.int64)
    lod = build_levels(rng.integers(0, 1000, (count, 3)))
    recorder = _Recorder(PRIOR.columns.network, symbols)
    others = others_of(before[:, column], coded[:, :column])
    others[:, 9] = 48
    features = [coded[:, c] * 16 for c in range(column)] + [before[:, column] * 16, memory[:, column]]
    component = Component(recorder, recorder.prepare(common), features, others, kinds)
    values, residual = component.code(None, None, lod, weights)

    core, found = CoreNetwork(recorder.network), np.zeros((count, 10), np.uint8)
    call("other_inputs", int32(before), int32(coded), count, 3, column, 48, found)
    assert np.array_equal(found, others)
    own = np.zeros(count, np.int64)
    for c in range(column):
        call("add_feature", int32(coded[:, c]), count, 1, int(weights[1 + c]) * 256, own)
    call("add_feature", int32(before[:, column]), count, 1, int(weights[1 + column]) * 256, own)
    wide = np.ascontiguousarray(memory[:, column])
    call("add_wide_feature", wide, count, 1, int(weights[2 + column]) * 16, own)
    prepared, narrow = core.prepare(common), kinds.astype(np.uint8)
    arrays = core.memory, prepared, found, narrow, own
    known = CoreComponent(*map(_pointer, arrays), int(weights[0]))
    for (span, level), contexts in zip(rows_of_passes(lod), recorder.passes, strict=True):
        rows = len(contexts)
        predictions, cells, flipped = (
            np.zeros(rows, np.int64),
            np.zeros(rows, np.uint8),
            np.zeros(rows, np.uint8),
        )
        statistics = (None, None) if level is None else level.statistics(values)
        call("pass", known, span.start, span.step, rows, *statistics, predictions, cells, flipped)
        assert np.array_equal(cells, contexts)
        assert np.array_equal(predictions, values[span] - residual[span])
        decoded = symbols[:rows] * np.where(flipped, -1, 1)
        symbols = symbols[rows:]
        assert np.array_equal(decoded, residual[span])


def test_classes_of_flags() -> None:
    rng, count = np.random.default_rng(0), 900
    network = PRIOR.flags.network
    common = rng.integers(0, 256, (count, NUM_COMMON)).astype(np.uint8)
    core, rows = CoreNetwork(network), np.flatnonzero(rng.random(count) < 0.4)
    mean = rng.integers(0, 257, len(rows)) * 256
    for base in (False, True):
        others, classes = np.zeros((len(rows), 2), np.uint8), np.zeros(len(rows), np.uint8)
        others[:, int(base)] = 64 if base else mean >> 9
        wanted = network.classes(network.prepare(common)[rows], others)
        known = None if base else mean
        arguments = core.memory, core.prepare(common), rows.astype(np.uint32), len(rows), known, classes
        call("flag_classes", *arguments)
        assert np.array_equal(classes, wanted)

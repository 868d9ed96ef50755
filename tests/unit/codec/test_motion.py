from __future__ import annotations

import numpy as np
import pytest

from dfcgs_codec.codec.columns.reader import SymbolReader
from dfcgs_codec.codec.motion.control_points import ControlPrior
from dfcgs_codec.codec.motion.walk import (
    FOLLOW,
    MIXED,
    STILL,
    MotionShape,
    MotionSymbols,
    code_motion,
)
from dfcgs_codec.encoder.columns.writer import SymbolWriter
from dfcgs_codec.encoder.residual.block_classes import classify_modes
from dfcgs_codec.model.context_model import NUM_CONTROL_COMMON
from dfcgs_codec.model.registry import DEFAULT_PRIOR, context_model


def shape_of(points: int, columns: int) -> MotionShape:
    """Of control points about which nothing is known yet."""
    inputs, expected = np.zeros((points, NUM_CONTROL_COMMON), np.uint8), np.zeros((points, 6), np.int64)
    prior = ControlPrior(context_model(DEFAULT_PRIOR), inputs, expected)
    return MotionShape(np.random.default_rng(5).permutation(points), columns, prior)


def random_motion(points: int, columns: int, count: int, share: float, seed: int = 0) -> MotionSymbols:
    rng = np.random.default_rng(seed)
    control = np.zeros((points, 6), np.int64)
    control[:, :columns] = np.rint(rng.normal(size=(points, columns)) * 20).astype(np.int64)
    follows = rng.random(count) < share
    return MotionSymbols(control, classify_modes(follows), follows)


def test_modes_of_blocks() -> None:
    follows = np.array([False] * 64 + [True] * 64 + [True, False] + [True] * 62 + [True] * 3)
    assert classify_modes(follows).tolist() == [STILL, FOLLOW, MIXED, FOLLOW]


@pytest.mark.parametrize("share", [0.0, 0.3, 1.0])
@pytest.mark.parametrize("points", [1, 40, 100])
@pytest.mark.parametrize("columns", [3, 6])
def test_round_trip_with_history(points: int, columns: int, share: float) -> None:
    shape = shape_of(points, columns)
    history = MotionSymbols.none(points, 515)
    for seed in range(3):
        symbols = random_motion(points, columns, 515, share, seed)
        writers = [SymbolWriter(), SymbolWriter()]
        code_motion(iter(writers).__next__, symbols, history, shape)
        readers = [SymbolReader(writer.getvalue()) for writer in writers]
        found = code_motion(iter(readers).__next__, None, history, shape)
        for reader in readers:
            reader.finish()
        assert np.array_equal(found.control, symbols.control)
        assert np.array_equal(found.modes, symbols.modes)
        assert np.array_equal(found.follows, symbols.follows)
        history = found


def test_what_goes_on_costs_little() -> None:
    shape = shape_of(10, 3)
    symbols = random_motion(10, 3, 6400, 0.5)
    sizes = []
    for history in (MotionSymbols.none(10, 6400), symbols):
        writers = [SymbolWriter(), SymbolWriter()]
        code_motion(iter(writers).__next__, symbols, history, shape)
        sizes.append(len(writers[0].getvalue()))
    assert sizes[0] > 6400 / 8
    assert sizes[1] < 20

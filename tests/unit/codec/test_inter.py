from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dfcgs_codec.bitstream.constants import Attribute
from dfcgs_codec.codec.columns.magnitudes import row_sums
from dfcgs_codec.codec.columns.reader import SymbolReader
from dfcgs_codec.codec.residual.classes import (
    BLOCK_LOG2,
    DENSE,
    NUM_MAGNITUDES,
    AttributeActivity,
    InterSymbols,
    nonzero_rows,
    num_blocks,
    num_inter_columns,
)
from dfcgs_codec.codec.residual.inputs import gaussian_inputs
from dfcgs_codec.codec.residual.walk import InterShape, Prior, code_inter
from dfcgs_codec.encoder.columns.writer import SymbolWriter
from dfcgs_codec.encoder.residual.block_classes import classify_blocks
from dfcgs_codec.model.registry import DEFAULT_PRIOR, context_model
from dfcgs_codec.transform.lod import GofLevels
from lab.small_clouds import make_cloud

ATTRIBUTES = [Attribute.POSITION, Attribute.ROTATION, Attribute.OPACITY, Attribute.SH_1]


def shape_of(count: int, attributes: list[Attribute]) -> InterShape:
    positions = np.rint(make_cloud(count).positions * 1000).astype(np.int64)
    prior = Prior(context_model(DEFAULT_PRIOR), gaussian_inputs(None, None, count), {})
    return InterShape(attributes, count, GofLevels(positions), prior)


def random_symbols(shape: InterShape, share: float, size: float, seed: int = 0) -> InterSymbols:
    """`share` of the Gaussians, at least one, have symbols of magnitude about `size`."""
    rng = np.random.default_rng(seed)
    activity = {}
    for attribute in shape.attributes:
        like = (shape.num_gaussians, num_inter_columns(attribute))
        symbols = np.rint(rng.normal(size=like) * size).astype(np.int64)
        symbols[rng.random(shape.num_gaussians) >= share] = 0
        symbols[rng.integers(shape.num_gaussians), 0] = 1
        activity[attribute] = AttributeActivity(symbols, *classify_blocks(symbols))
    return InterSymbols(activity)


def write(symbols: InterSymbols, history: InterSymbols, shape: InterShape) -> list[bytes]:
    writers: list[SymbolWriter] = []

    def open_writer() -> SymbolWriter:
        writers.append(SymbolWriter())
        return writers[-1]

    code_inter(open_writer, symbols, history, shape)
    return [writer.getvalue() for writer in writers]


def read(streams: list[bytes], history: InterSymbols, shape: InterShape) -> InterSymbols:
    readers = [SymbolReader(stream) for stream in streams]
    rest = iter(readers)
    found = code_inter(lambda: next(rest), None, history, shape)
    for reader in readers:
        reader.finish()
    return found


def check(symbols: InterSymbols, history: InterSymbols, shape: InterShape) -> int:
    """Symbols and block classes survive, for the next frame's contexts need both; returns bytes."""
    streams = write(symbols, history, shape)
    found = read(streams, history, shape)
    assert list(found.activity) == shape.attributes
    for attribute, expected in symbols.activity.items():
        for name in ("symbols", "density", "magnitude"):
            assert np.array_equal(getattr(found.activity[attribute], name), getattr(expected, name))
    return sum(map(len, streams))


@pytest.mark.parametrize("count", [1, 2, 33, 64, 65, 700])
@pytest.mark.parametrize("share", [0.03, 0.3, 0.9, 1.0])
def test_round_trip(count: int, share: float) -> None:
    shape = shape_of(count, ATTRIBUTES)
    before, now = random_symbols(shape, share, 3, 1), random_symbols(shape, share, 5, 2)
    check(now, InterSymbols(), shape)
    check(now, before, shape)


@settings(max_examples=25)
@given(st.data())
def test_any_frame(data: st.DataObject) -> None:
    count = data.draw(st.integers(1, 200))
    attributes = sorted(data.draw(st.sets(st.sampled_from(list(Attribute)), min_size=1)))
    share, size = data.draw(st.floats(0, 1)), data.draw(st.sampled_from([0.4, 2, 1e3, 1e7]))
    shape = shape_of(count, attributes)
    before = random_symbols(shape_of(count, ATTRIBUTES), 1 - share, size, 3)
    check(random_symbols(shape, share, size, 4), before, shape)


def test_a_single_symbol_costs_little() -> None:
    shape = shape_of(5000, [Attribute.POSITION])
    assert check(random_symbols(shape, 0, 1), InterSymbols(), shape) <= 60


def test_what_stands_still_is_not_paid_for() -> None:
    shape = shape_of(6400, [Attribute.POSITION])
    moving = random_symbols(shape, 1.0, 5)
    part = moving.activity[Attribute.POSITION].symbols.copy()
    part[640:] = 0
    few = InterSymbols({Attribute.POSITION: AttributeActivity(part, *classify_blocks(part))})
    assert check(few, InterSymbols(), shape) < 0.12 * check(moving, InterSymbols(), shape)


def test_the_previous_frame_helps() -> None:
    shape = shape_of(3000, [Attribute.POSITION])
    before = random_symbols(shape, 1.0, 20)
    symbols = before.activity[Attribute.POSITION].symbols + 1
    now = InterSymbols({Attribute.POSITION: AttributeActivity(symbols, *classify_blocks(symbols))})
    assert check(now, before, shape) < check(now, InterSymbols(), shape)


@given(st.integers(1, 300), st.floats(0, 1), st.integers(0, 99))
def test_block_classes(count: int, share: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    symbols = rng.integers(-3, 4, (count, 3)) * (rng.random((count, 1)) < share)
    density, magnitude = classify_blocks(symbols)
    assert len(density) == len(magnitude) == num_blocks(count)
    significant = symbols.any(axis=1)
    for block in range(len(density)):
        rows = significant[block << BLOCK_LOG2 : (block + 1) << BLOCK_LOG2]
        # a block without symbols may be dense where nearly everything is, never the other way round
        assert rows.any() <= (density[block] > 0)
        assert rows.all() <= (density[block] == DENSE)
        assert rows.any() >= (magnitude[block] > 0)
    assert magnitude.max() < NUM_MAGNITUDES


def test_activity_of_nothing() -> None:
    none = AttributeActivity.none(100, 3)
    assert not none.symbols.any()
    assert not none.significant().any()
    assert none.density.shape == (2,)


def test_row_functions() -> None:
    rows = np.array([[0, 0, 0], [1, -1, 0], [0, 0, 7]])
    assert row_sums(rows).tolist() == [0, 0, 7]
    assert nonzero_rows(rows).tolist() == [False, True, True]

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dfcgs_codec.bitstream.constants import STATE_LIMIT
from dfcgs_codec.codec.columns.side_information import (
    ABSENT_LEVEL,
    code_signed,
    code_tables,
    code_weights,
    frequencies_from_levels,
    histogram_models,
)
from dfcgs_codec.entropy.coder import RangeCoder, RangeReader, RangeWriter
from dfcgs_codec.entropy.tables import NUM_SCALES, NUM_SHAPES
from dfcgs_codec.errors import CorruptBitstream


def both(code: Callable[[RangeCoder, Any], Any], value: Any) -> tuple[Any, int]:
    """What a reader makes of `value` written, and bytes; the writer returns the same."""
    writer = RangeWriter()
    written = code(writer, value)
    reader = RangeReader(writer.getvalue())
    found = code(reader, None)
    reader.finish()
    assert np.array_equal(written, found)
    return found, len(writer.getvalue())


@given(st.integers(-STATE_LIMIT, STATE_LIMIT))
def test_signed(value: int) -> None:
    assert both(lambda c, v: code_signed(c, v, STATE_LIMIT), value)[0] == value


def test_signed_beyond_its_limit_is_corrupt() -> None:
    writer = RangeWriter()
    code_signed(writer, -6, 6)
    with pytest.raises(CorruptBitstream):
        code_signed(RangeReader(writer.getvalue()), None, 5)


@given(st.lists(st.integers(-1024, 1024), max_size=12))
def test_weights(weights: list[int]) -> None:
    array = np.array(weights, np.int64)
    found, _ = both(lambda c, v: code_weights(c, v, len(array)), array)
    assert found.tolist() == weights


def test_no_weights_cost_nothing_and_zeros_little() -> None:
    assert both(lambda c, v: code_weights(c, v, 0), np.zeros(0, np.int64))[1] == 0
    assert both(lambda c, v: code_weights(c, v, 40), np.zeros(40, np.int64))[1] <= 4


def test_weights_out_of_range_are_corrupt() -> None:
    writer = RangeWriter()
    with pytest.raises(CorruptBitstream, match="weight"):
        code_weights(writer, np.array([1 << 13]), 1)


@st.composite
def context_tables(draw: st.DrawFn) -> np.ndarray:
    """-1 outside a range of contexts, any table inside."""
    size = draw(st.integers(1, 32))
    first = draw(st.integers(0, size - 1))
    last = draw(st.integers(first, size - 1))
    tables = np.full(size, -1, np.int64)
    any_table = st.integers(0, NUM_SHAPES * NUM_SCALES - 1)
    tables[first : last + 1] = [draw(any_table) for _ in range(first, last + 1)]
    return tables


@given(context_tables())
def test_tables(tables: np.ndarray) -> None:
    found, _ = both(lambda c, v: code_tables(c, v, len(tables)), tables)
    used = tables >= 0
    assert np.array_equal(found[used], tables[used])
    assert ((found >= 0) & (found < NUM_SHAPES * NUM_SCALES)).all()


@pytest.mark.parametrize("table", [NUM_SHAPES * NUM_SCALES, 2 * NUM_SHAPES * NUM_SCALES])
def test_tables_that_do_not_exist_are_corrupt(table: int) -> None:
    with pytest.raises(CorruptBitstream, match="table index"):
        code_tables(RangeWriter(), np.array([table]), 1)


def test_contexts_beyond_the_last_are_corrupt() -> None:
    writer = RangeWriter()
    code_tables(writer, np.array([-1, -1, -1, 200, 200]), 5)
    with pytest.raises(CorruptBitstream, match="at most"):
        code_tables(RangeReader(writer.getvalue()), None, 4)


def test_tables_that_rise_as_expected_are_cheap() -> None:
    expected = NUM_SCALES + 26 + 3 * np.arange(30)
    surprising = NUM_SCALES + np.random.default_rng(0).integers(0, NUM_SCALES, 30)
    cheap = both(lambda c, v: code_tables(c, v, 30), expected)[1]
    assert 3 * cheap < both(lambda c, v: code_tables(c, v, 30), surprising)[1]


@st.composite
def levels(draw: st.DrawFn) -> np.ndarray:
    rows, size = draw(st.integers(1, 4)), draw(st.integers(2, 12))
    value = st.integers(0, ABSENT_LEVEL)
    table = np.array([[draw(value) for _ in range(size)] for _ in range(rows)], np.int64)
    table[:, draw(st.integers(0, size - 1))] = 0
    return table


@given(levels())
def test_histograms(table: np.ndarray) -> None:
    used = np.arange(len(table)) * 2
    contexts, size = 2 * len(table) + 1, table.shape[1]

    def code(coder: RangeCoder, given_levels: np.ndarray | None) -> list[list[int]]:
        models = histogram_models(coder, given_levels, used, contexts, size)
        assert len(models) == contexts
        return [model.frequencies.tolist() for model in models]

    found, _ = both(code, table)
    for context, row in zip(used.tolist(), table, strict=True):
        assert found[context] == frequencies_from_levels(row).tolist()
    assert max(found[1]) - min(found[1]) <= 1


def test_levels_are_quarter_octaves() -> None:
    frequencies = frequencies_from_levels(np.array([0, 4, 8, 1, 2, 3, ABSENT_LEVEL]))
    share = frequencies / frequencies[0]
    assert np.allclose(share[1:6], 2.0 ** (-np.array([4, 8, 1, 2, 3]) / 4), rtol=5e-3)
    assert frequencies[-1] == 1
    assert frequencies.sum() == 1 << 24


@pytest.mark.parametrize("level", [-1, ABSENT_LEVEL + 1])
def test_levels_out_of_range_are_corrupt(level: int) -> None:
    with pytest.raises(CorruptBitstream, match="histogram level"):
        histogram_models(RangeWriter(), np.array([[0, level, 0]]), np.array([0]), 1, 3)


def test_an_empty_histogram_is_corrupt() -> None:
    with pytest.raises(CorruptBitstream, match="empty"):
        frequencies_from_levels(np.full(4, ABSENT_LEVEL))

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from dfcgs_codec.entropy.coder import RangeReader, RangeWriter, categorical, scale_model, uniform
from dfcgs_codec.entropy.symbols import (
    Groups,
    code_bits,
    code_count,
    code_escapes,
    code_residuals,
    code_with_models,
)
from dfcgs_codec.entropy.tables import NUM_SCALES, Shape, frequencies_from_weights
from dfcgs_codec.errors import CorruptBitstream

SIZES = st.integers(0, 60)


def check(code, values: np.ndarray) -> bytes:
    """`code(coder, values or None)` gives `values` in both directions; returns the stream."""
    writer = RangeWriter()
    assert np.array_equal(code(writer, values), values)
    reader = RangeReader(writer.getvalue())
    found = code(reader, None)
    reader.finish()
    assert found.dtype == np.int64
    assert np.array_equal(found, values)
    return writer.getvalue()


@given(st.integers(0, 63), st.data())
def test_bits(bits: int, data: st.DataObject) -> None:
    elements = st.integers(0, (1 << bits) - 1)
    values = data.draw(hnp.arrays(np.int64, SIZES, elements=elements))
    stream = check(lambda coder, v: code_bits(coder, v, bits, len(values)), values)
    assert len(stream) <= len(values) * bits / 8 + 8


@given(hnp.arrays(np.int64, SIZES, elements=st.integers(0, 2**32 - 2)))
def test_escapes(values: np.ndarray) -> None:
    check(lambda coder, v: code_escapes(coder, v, len(values)), values)


@pytest.mark.parametrize("value", [-1, 2**32 - 1, 2**40])
def test_escapes_out_of_range_are_not_written(value: int) -> None:
    with pytest.raises(ValueError, match="outside"):
        code_escapes(RangeWriter(), np.array([value], np.int64), 1)


def test_escapes_cost_two_bits_per_octave_beyond_the_length() -> None:
    values = np.full(1000, 1000, np.int64)
    stream = check(lambda coder, v: code_escapes(coder, v, 1000), values)
    assert len(stream) == pytest.approx(1000 * (5 + 9) / 8, abs=8)


@given(st.data())
def test_groups_partition_the_symbols(data: st.DataObject) -> None:
    contexts = data.draw(hnp.arrays(np.uint8, SIZES, elements=st.integers(0, 6)))
    groups = Groups(contexts, 7)
    assert sorted(groups.order.tolist()) == list(range(len(contexts)))
    for context, part in groups.slices():
        rows = groups.order[part]
        assert (contexts[rows] == context).all()
        assert (np.diff(rows) > 0).all()
    assert groups.used.tolist() == sorted(set(contexts.tolist()))


def test_each_symbol_has_the_model_of_its_context() -> None:
    rng = np.random.default_rng(0)
    contexts = rng.integers(0, 3, 500).astype(np.uint8)
    sure = categorical(frequencies_from_weights(np.array([0, 0, 1])))
    models = [sure, uniform(4), scale_model(Shape.GAUSSIAN, 0)]
    values = np.where(contexts == 0, 2, rng.integers(0, 3, 500))
    groups = Groups(contexts, 3)
    check(lambda coder, v: code_with_models(coder, v, groups, models), values)


TABLES = st.integers(0, len(Shape) * NUM_SCALES - 1)


@given(st.data())
def test_residuals_of_any_size_with_any_tables(data: st.DataObject) -> None:
    tables = np.array(data.draw(st.lists(TABLES, min_size=1, max_size=5)), np.int64)
    # the excess beyond the narrowest table is an escape and has 32 bits
    values = data.draw(hnp.arrays(np.int64, SIZES, elements=st.integers(-(2**31), 2**31)))
    elements = st.integers(0, len(tables) - 1)
    contexts = data.draw(hnp.arrays(np.uint8, len(values), elements=elements))
    check(lambda coder, v: code_residuals(coder, v, contexts, tables), values)


@pytest.mark.parametrize("shape", Shape)
@pytest.mark.parametrize("scale", [0, 26, 63, 64, 100, 159])
def test_residuals_around_the_escapes(shape: Shape, scale: int) -> None:
    base = scale if scale < 64 else 63
    k = scale_model(shape, base).size // 2
    low_bits = 0 if scale < 64 else (scale - 64) // 6 + 1
    edges = np.arange(-k - 3, k + 4) << low_bits
    values = np.concatenate([edges, edges + 1, edges - 1])
    contexts = np.zeros(len(values), np.uint8)
    table = np.array([shape * NUM_SCALES + scale])
    check(lambda coder, v: code_residuals(coder, v, contexts, table), values)


def test_a_fitting_table_costs_about_the_entropy() -> None:
    rng = np.random.default_rng(0)
    values = np.rint(rng.normal(scale=2.0 ** (60 / 6), size=4000)).astype(np.int64)
    contexts = np.zeros(4000, np.uint8)
    table = np.array([Shape.GAUSSIAN * NUM_SCALES + 86])
    stream = check(lambda coder, v: code_residuals(coder, v, contexts, table), values)
    entropy = np.log2(np.sqrt(2 * np.pi * np.e) * 2.0**10)
    assert 8 * len(stream) / 4000 == pytest.approx(entropy, rel=0.01)


@given(st.integers(0, 10**6))
def test_count(value: int) -> None:
    writer = RangeWriter()
    assert code_count(writer, value, 10**6) == value
    assert code_count(RangeReader(writer.getvalue()), None, 10**6) == value
    if value:
        with pytest.raises(CorruptBitstream, match="at most"):
            code_count(RangeReader(writer.getvalue()), None, value - 1)

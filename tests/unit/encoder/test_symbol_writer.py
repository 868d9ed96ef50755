"""The writer chooses, the reader follows: every side-information call in both directions."""

from __future__ import annotations

import numpy as np
import pytest

from dfcgs_codec.codec.columns.reader import SymbolReader
from dfcgs_codec.encoder.columns.writer import SymbolWriter
from dfcgs_codec.errors import CorruptBitstream


def never() -> None:
    raise AssertionError("a reader asked for evidence")


@pytest.mark.parametrize("choice", [0, 3, 15])
def test_choice(choice: int) -> None:
    writer = SymbolWriter()
    assert writer.choice(16, lambda: choice) == choice
    assert SymbolReader(writer.getvalue()).choice(16, never) == choice


def test_weights_and_tables() -> None:
    rng = np.random.default_rng(0)
    feature = rng.integers(-99, 99, 500)
    contexts = (np.abs(feature) > 40).astype(np.uint8)
    writer = SymbolWriter()
    weights = writer.weights(1, lambda: ([feature], feature // 2))
    tables = writer.tables(4, lambda: (feature, contexts))
    reader = SymbolReader(writer.getvalue())
    assert abs(weights[0] - 128) <= 1
    assert np.array_equal(reader.weights(1, never), weights)
    assert np.array_equal(reader.tables(4, never), tables)
    reader.finish()


def test_histograms() -> None:
    symbols, contexts = np.array([0, 0, 1, 2, 2, 2]), np.array([0, 0, 0, 2, 2, 2], np.uint8)
    used = np.array([0, 2])
    writer = SymbolWriter()
    written = writer.histograms(used, 3, 3, lambda: (symbols, contexts))
    read = SymbolReader(writer.getvalue()).histograms(used, 3, 3, never)
    for a, b in zip(written, read, strict=True):
        assert np.array_equal(a.frequencies, b.frequencies)
    assert written[2].frequencies.argmax() == 2


def test_an_empty_stream_is_all_zeros_and_no_error() -> None:
    reader = SymbolReader(b"")
    assert reader.choice(2, never) == 0
    with pytest.raises(CorruptBitstream):
        SymbolReader(b"\x01")

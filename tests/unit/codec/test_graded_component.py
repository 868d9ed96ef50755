from __future__ import annotations

import numpy as np
import pytest

from dfcgs_codec.bitstream.constants import STATE_LIMIT
from dfcgs_codec.codec.graded_component import Earlier, GradedColumn, Target, scaled_symbols
from dfcgs_codec.codec.symbol_reader import SymbolReader
from dfcgs_codec.encoder.analysis import ZeroBin
from dfcgs_codec.encoder.symbol_writer import SymbolWriter
from dfcgs_codec.errors import CorruptBitstream
from dfcgs_codec.transform.lod import LevelsOfDetail, build_levels


def levels(count: int) -> LevelsOfDetail:
    along = np.arange(count)
    return build_levels(np.stack([along, along % 7, along % 5], axis=1))


def waves(count: int, seed: int = 0) -> np.ndarray:
    noise = np.random.default_rng(seed).normal(0, 40, count)
    return np.rint(9000 * np.sin(np.arange(count) / 90) + noise).astype(np.int64)


def code(columns: list[np.ndarray], steps: np.ndarray, zero_bin: float = 0.5) -> tuple[list[np.ndarray], int]:
    """Columns as decoded, one after the other, and the bytes."""
    lod, quantise = levels(len(steps)), ZeroBin(zero_bin).quantise
    earlier, writer, written = Earlier(), SymbolWriter(), []
    for values in columns:
        column = GradedColumn(steps, lod, earlier)
        written.append(column.code(writer, Target(values, quantise)))
    data = writer.getvalue()
    earlier, reader = Earlier(), SymbolReader(data, 0)
    for expected in written:
        assert np.array_equal(GradedColumn(steps, lod, earlier).code(reader, None), expected)
    reader.finish()
    return written, len(data)


@pytest.mark.parametrize("count", [1, 2, 63, 64, 200, 5000])
def test_each_value_is_within_half_its_own_step(count: int) -> None:
    steps = np.random.default_rng(1).choice([1, 7, 60, 900], count)
    wanted = [waves(count), waves(count, 1) - 40_000]
    found, _ = code(wanted, steps)
    for values, decoded in zip(wanted, found, strict=True):
        assert (2 * np.abs(values - decoded) <= steps).all()


def test_a_zero_bin_leaves_more_to_the_prediction() -> None:
    steps = np.full(5000, 120)
    (plain,), size = code([waves(5000)], steps)
    (binned,), smaller = code([waves(5000)], steps, 0.6)
    assert smaller < size
    assert np.abs(binned - waves(5000)).max() <= 72
    assert np.abs(plain - waves(5000)).max() <= 60


def test_coarser_steps_take_fewer_bytes() -> None:
    fine = np.full(4000, 20)
    half = np.where(np.arange(4000) % 2, 20, 320)
    # two bits and more for each of 2000 symbols
    assert code([waves(4000)], half)[1] < code([waves(4000)], fine)[1] - 400


def test_columns_before_help() -> None:
    steps = np.full(3000, 10)
    alone = code([waves(3000)], steps)[1]
    assert code([waves(3000), waves(3000) * 2 + 5], steps)[1] < 1.6 * alone


def test_symbols_beyond_the_state_are_refused() -> None:
    steps = np.array([1, 1000])
    assert scaled_symbols(np.array([5, -7]), steps).tolist() == [5, -7000]
    for symbol in (1, -1):
        with pytest.raises(CorruptBitstream, match="too large for its step"):
            scaled_symbols(np.array([0, symbol * (2 * STATE_LIMIT // 1000 + 1)]), steps)


def test_values_beyond_the_state_are_refused() -> None:
    steps, lod = np.full(3, STATE_LIMIT), levels(3)
    target = Target(np.array([0, 0, 2 * STATE_LIMIT]), ZeroBin(0.5).quantise)
    with pytest.raises(CorruptBitstream, match="leaves the range"):
        GradedColumn(steps, lod, Earlier()).code(SymbolWriter(), target)

from __future__ import annotations

import numpy as np
import pytest

from dfcgs_codec.bitstream.constants import STATE_LIMIT
from dfcgs_codec.codec.graded_component import (
    Earlier,
    GradedColumn,
    Quantise,
    Target,
    scaled_symbols,
)
from dfcgs_codec.codec.symbol_reader import SymbolReader
from dfcgs_codec.encoder.analysis import ZeroBin
from dfcgs_codec.encoder.symbol_writer import SymbolWriter
from dfcgs_codec.encoder.trellis_search import AlternatingQuantiser
from dfcgs_codec.errors import CorruptBitstream
from dfcgs_codec.transform.lod import LevelsOfDetail, build_levels


def levels(count: int) -> LevelsOfDetail:
    along = np.arange(count)
    return build_levels(np.stack([along, along % 7, along % 5], axis=1))


def waves(count: int, seed: int = 0) -> np.ndarray:
    noise = np.random.default_rng(seed).normal(0, 40, count)
    return np.rint(9000 * np.sin(np.arange(count) / 90) + noise).astype(np.int64)


def nearest(zero_bin: float) -> Quantise:
    return lambda residual, steps, _: ZeroBin(zero_bin).quantise(residual, steps)


def code(
    columns: list[np.ndarray], steps: np.ndarray, zero_bin: float = 0.5, *, alternating: bool = False
) -> tuple[list[np.ndarray], int]:
    """Columns as decoded, one after the other, and the bytes."""
    lod, quantise = levels(len(steps)), nearest(zero_bin)
    if alternating:
        quantise = AlternatingQuantiser(ZeroBin(zero_bin)).quantise
    earlier, writer, written = Earlier(), SymbolWriter(), []
    for values in columns:
        column = GradedColumn(steps, lod, earlier, alternating)
        written.append(column.code(writer, Target(values, quantise)))
    data = writer.getvalue()
    earlier, reader = Earlier(), SymbolReader(data, 0)
    for expected in written:
        decoded = GradedColumn(steps, lod, earlier, alternating).code(reader, None)
        assert np.array_equal(decoded, expected)
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


@pytest.mark.parametrize(("step", "coarser"), [(15, 16), (40, 45), (110, 132)])
def test_two_quantisers_are_nearer_at_fewer_bytes(step: int, coarser: int) -> None:
    wanted = [waves(20_000), waves(20_000, 1) - 40_000]
    alone, size = code(wanted, np.full(20_000, step), 0.6)
    both, smaller = code(wanted, np.full(20_000, coarser), 0.6, alternating=True)
    assert smaller < size
    error, less = (np.mean((np.stack(found) - np.stack(wanted)) ** 2.0) for found in (alone, both))
    assert less < 0.98 * error


@pytest.mark.parametrize("count", [1, 500, 1023, 1024, 3000])
def test_two_quantisers_stay_within_a_step(count: int) -> None:
    steps = np.random.default_rng(1).choice([7, 60, 900], count)
    (found,), _ = code([waves(count)], steps, alternating=True)
    assert (np.abs(waves(count) - found) <= steps).all()


def test_columns_before_help() -> None:
    steps = np.full(3000, 10)
    alone = code([waves(3000)], steps)[1]
    assert code([waves(3000), waves(3000) * 2 + 5], steps)[1] < 1.6 * alone


def test_symbols_beyond_the_state_are_refused() -> None:
    steps = np.array([1, 1000])
    assert scaled_symbols(np.array([5, -7]), steps, alternating=False).tolist() == [5, -7000]
    for symbol in (1, -1):
        with pytest.raises(CorruptBitstream, match="too large for its step"):
            scaled_symbols(
                np.array([0, symbol * (2 * STATE_LIMIT // 1000 + 1)]), steps, alternating=symbol > 0
            )


def test_values_beyond_the_state_are_refused() -> None:
    steps, lod = np.full(3, STATE_LIMIT), levels(3)
    target = Target(np.array([0, 0, 2 * STATE_LIMIT]), nearest(0.5))
    with pytest.raises(CorruptBitstream, match="leaves the range"):
        GradedColumn(steps, lod, Earlier()).code(SymbolWriter(), target)


def test_columns_before_are_scaled_once_for_the_same_steps() -> None:
    earlier, fine, coarse = Earlier(), np.full(6, 2), np.full(6, 4)
    earlier.add(np.array([8, -4, 0, 2, 6, 1]))
    every_second = slice(None, None, 2)
    (found,), (magnitude,) = earlier.scaled(fine, every_second)
    assert found.tolist() == [4, 0, 3]
    earlier.add(np.array([-2, 0, 4, 0, 0, 0]))
    residuals, magnitudes = earlier.scaled(fine, every_second)
    assert residuals[0] is found
    assert magnitudes[0] is magnitude
    assert magnitudes[1].tolist() == [1, 2, 0]
    assert earlier.scaled(coarse, every_second)[0][1].tolist() == [-0.5, 1, 0]

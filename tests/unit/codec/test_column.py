from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from dfcgs_codec.bitstream.constants import STATE_LIMIT
from dfcgs_codec.codec.columns.coder import ColumnFacts, SymbolCoder
from dfcgs_codec.codec.columns.column import (
    Column,
    ColumnGoal,
    Earlier,
    code_integers,
    code_permutation,
    round_weighted,
    scaled_symbols,
    weighted_sum,
)
from dfcgs_codec.codec.columns.reader import SymbolReader
from dfcgs_codec.encoder.columns.column_evidence import ResidualsInSteps
from dfcgs_codec.encoder.columns.writer import SymbolWriter
from dfcgs_codec.encoder.intra.intra_plan import ColumnQuantiser
from dfcgs_codec.encoder.residual.quantise import ZeroBin
from dfcgs_codec.errors import CorruptBitstream
from dfcgs_codec.transform.lod import LevelsOfDetail, build_levels, order_levels
from tests.helpers import check_walk


def levels(count: int) -> LevelsOfDetail:
    along = np.arange(count)
    return build_levels(np.stack([along, along % 7, along % 5], axis=1))


def waves(count: int, seed: int = 0) -> np.ndarray:
    noise = np.random.default_rng(seed).normal(0, 40, count)
    return np.rint(9000 * np.sin(np.arange(count) / 90) + noise).astype(np.int64)


def code(
    columns: list[np.ndarray],
    steps: np.ndarray,
    zero_bin: float = 0.5,
    *,
    in_steps: bool = False,
    alternating: bool = False,
) -> tuple[list[np.ndarray], int]:
    """Columns as decoded, one after the other, and the bytes."""
    lod = levels(len(steps))
    earlier, writer, written = Earlier(), SymbolWriter(), []
    for values in columns:
        goal = ColumnGoal(values, ColumnQuantiser(values, ZeroBin(zero_bin), alternating).choose)
        written.append(Column(steps, lod, earlier, in_steps, alternating).code(writer, goal))
    data = writer.getvalue()
    earlier, reader = Earlier(), SymbolReader(data, 0)
    for expected in written:
        decoded = Column(steps, lod, earlier, in_steps, alternating).code(reader, None)
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


@pytest.mark.parametrize("count", [1, 64, 3000])
def test_values_in_steps_come_back_as_they_are(count: int) -> None:
    steps = np.random.default_rng(1).choice([1, 7, 64, 900], count)
    wanted = [waves(count) // steps * steps, waves(count, 1) // steps * steps]
    found, _ = code(wanted, steps, in_steps=True)
    assert np.array_equal(found, wanted)


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
    values = np.array([0, 0, 2 * STATE_LIMIT])
    goal = ColumnGoal(values, ColumnQuantiser(values, ZeroBin(0.5)).choose)
    with pytest.raises(CorruptBitstream, match="leaves the range"):
        Column(steps, lod).code(SymbolWriter(), goal)


def test_columns_before_are_scaled_once_for_the_same_steps() -> None:
    fine, coarse, residuals = np.full(6, 2), np.full(6, 4), [np.array([8, -4, 0, 2, 6, 1])]
    before, every_second = ResidualsInSteps(), slice(None, None, 2)

    def look(steps: np.ndarray) -> None:
        before.look(ColumnFacts(steps, steps, levels(6), residuals), every_second)

    look(fine)
    found, magnitude = before.values[0], before.magnitudes[0]
    assert found.tolist() == [4, 0, 3]
    residuals.append(np.array([-2, 0, 4, 0, 0, 0]))
    look(fine)
    assert before.values[0] is found
    assert before.magnitudes[0] is magnitude
    assert before.magnitudes[1].tolist() == [1, 2, 0]
    look(coarse)
    assert before.values[1].tolist() == [-0.5, 1, 0]


# --- integers that come back as they are ------------------------------------------------------------------


def check(target: np.ndarray, lod: LevelsOfDetail) -> int:
    """Round trip; returns bytes."""

    def code_both(coder: SymbolCoder, writing: bool) -> np.ndarray:
        return code_integers(coder, target if writing else None, lod, len(target))

    return check_walk(code_both, np.array_equal)


def smooth(count: int, seed: int = 0) -> np.ndarray:
    """A random walk: neighbours in order are alike."""
    return np.cumsum(np.random.default_rng(seed).integers(-9, 10, count))


@given(st.data())
def test_any_values(data: st.DataObject) -> None:
    limit = data.draw(st.sampled_from([0, 1, 100, STATE_LIMIT]))
    elements = st.integers(-limit, limit)
    target = data.draw(hnp.arrays(np.int64, st.integers(1, 90), elements=elements))
    check(target, order_levels(len(target)))


@pytest.mark.parametrize("count", [1, 2, 31, 33, 64, 65, 1000])
def test_any_count(count: int) -> None:
    check(smooth(count), levels(count))


def test_a_constant_costs_almost_nothing() -> None:
    assert check(np.full(5000, 12345), order_levels(5000)) <= 24


def test_neighbours_help_where_values_are_smooth() -> None:
    walk = smooth(4000)
    mixed = np.random.default_rng(1).permutation(walk)
    assert check(walk, order_levels(4000)) < 0.75 * check(mixed, order_levels(4000))


@pytest.mark.parametrize("count", [50, 2000, 31000])
def test_an_order_without_structure_costs_its_entropy(count: int) -> None:
    places = np.random.default_rng(0).permutation(count)
    writer = SymbolWriter()
    code_permutation(writer, places, order_levels(count), np.zeros(count, np.int64))
    assert 8 * len(writer.getvalue()) / count <= np.log2(count) + 1 + 200 / count


@pytest.mark.parametrize("row", [5, -1])
def test_an_order_that_is_no_permutation_is_corrupt(row: int) -> None:
    places = np.arange(50)
    places[7] = row
    with pytest.raises(CorruptBitstream, match="permutation"):
        code_permutation(SymbolWriter(), places, order_levels(50), np.zeros(50, np.int64))


def test_weighted_sum_skips_nothing_but_zeros() -> None:
    features = [np.array([1, 2]), np.array([10, 20]), np.array([100, 200])]
    assert weighted_sum(features, np.array([3, 0, -1])).tolist() == [-97, -194]
    assert weighted_sum([], np.zeros(0, np.int64)) == 0


def test_round_weighted_rounds_halves_up() -> None:
    values = np.array([127, 128, 129, -127, -128, -129])
    assert round_weighted(values, 8).tolist() == [0, 1, 1, 0, 0, -1]

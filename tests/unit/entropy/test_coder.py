from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dfcgs_codec.entropy.coder import (
    Model,
    RangeReader,
    RangeWriter,
    categorical,
    scale_model,
    split_model,
    uniform,
)
from dfcgs_codec.entropy.tables import Shape, frequencies_from_weights
from dfcgs_codec.errors import CorruptBitstream

LAPLACE = scale_model(Shape.LAPLACE, 20)


def random_symbols(model: Model, count: int, seed: int = 0) -> np.ndarray:
    """Symbols that follow the model."""
    rng = np.random.default_rng(seed)
    quantiles = rng.integers(0, 1 << 24, count)
    return np.searchsorted(np.cumsum(model.frequencies), quantiles, side="right")


def write(symbols: np.ndarray, model: Model) -> bytes:
    writer = RangeWriter()
    writer.code(symbols, model, len(symbols))
    return writer.getvalue()


def read(data: bytes, model: Model, count: int) -> np.ndarray:
    reader = RangeReader(data)
    symbols = reader.code(None, model, count)
    reader.finish()
    return symbols


def reference_decoder(data: bytes, steps: list[tuple[Model, int]]) -> list[int]:
    """The range decoder of the format in plain integers: 64-bit state, 32-bit words, 24-bit frequencies."""
    words = np.frombuffer(data, "<u4").tolist()
    mask = 2**64 - 1
    lower, width = 0, mask
    point = (words[0] << 32 | words[1]) if len(words) > 1 else words[0] << 32
    following = iter(words[2:])
    symbols = []
    for model, count in steps:
        starts = np.concatenate([[0], np.cumsum(model.frequencies)])
        for _ in range(count):
            scale = width >> 24
            quantile = ((point - lower) & mask) // scale
            symbol = int(np.searchsorted(starts, quantile, side="right")) - 1
            symbols.append(symbol)
            lower = (lower + scale * int(starts[symbol])) & mask
            width = scale * int(model.frequencies[symbol])
            if width < 2**32:
                lower, width = lower << 32 & mask, width << 32
                point = (point << 32 | next(following, 0)) & mask
    return symbols


@pytest.mark.parametrize(
    "model",
    [LAPLACE, scale_model(Shape.GAUSSIAN, 0), scale_model(Shape.HEAVY, 63), split_model(0, 7), uniform(2)],
)
def test_round_trip(model: Model) -> None:
    symbols = random_symbols(model, 3000)
    assert np.array_equal(read(write(symbols, model), model, 3000), symbols)


def test_an_independent_decoder_reads_the_same() -> None:
    rare = categorical(frequencies_from_weights(np.array([2**31 - 1, 1, 0, 5])))
    models = [LAPLACE, uniform(8), rare, uniform(1 << 16), scale_model(Shape.HEAVY, 60), split_model(3, 32)]
    writer = RangeWriter()
    expected = []
    for seed, model in enumerate(models):
        symbols = np.concatenate([random_symbols(model, 50, seed), np.arange(min(4, model.size))])
        expected += writer.code(symbols, model, len(symbols)).tolist()
    steps = [(model, 50 + min(4, model.size)) for model in models]
    assert reference_decoder(writer.getvalue(), steps) == expected


@pytest.mark.parametrize("size", [2, 16, 1024, 65536])
def test_uniform_frequencies_are_those_that_are_coded(size: int) -> None:
    model = uniform(size)
    assert model.frequencies.sum() == 1 << 24
    symbols = np.append(random_symbols(model, 100), size - 1)
    assert reference_decoder(write(symbols, model), [(model, 101)]) == symbols.tolist()


@given(st.data())
def test_random_models_and_symbols(data: st.DataObject) -> None:
    weights = data.draw(st.lists(st.integers(0, 2**31 - 1), min_size=2, max_size=40).filter(any))
    model = categorical(frequencies_from_weights(np.array(weights, np.int64)))
    symbols = np.array(data.draw(st.lists(st.integers(0, model.size - 1), max_size=50)), np.int64)
    stream = write(symbols, model)
    assert np.array_equal(read(stream, model, len(symbols)), symbols)
    if len(symbols):
        assert reference_decoder(stream, [(model, len(symbols))]) == symbols.tolist()


def test_exact_words() -> None:
    assert write(np.array([0, 1, 2, 3]), uniform(16)).hex() == "00002301"
    assert write(np.zeros(0, np.int64), LAPLACE) == b""


def test_the_length_is_the_entropy() -> None:
    symbols = random_symbols(LAPLACE, 5000)
    ideal = -np.log2(LAPLACE.frequencies[symbols] / 2**24).sum() / 8
    assert ideal <= len(write(symbols, LAPLACE)) <= ideal + 8


@pytest.mark.parametrize("symbol", [-1, LAPLACE.size])
def test_symbols_out_of_range_are_not_written(symbol: int) -> None:
    with pytest.raises(ValueError, match="outside"):
        write(np.array([0, symbol]), LAPLACE)


def test_the_writer_needs_as_many_symbols_as_announced() -> None:
    with pytest.raises(ValueError, match="3 symbols"):
        RangeWriter().code(np.zeros(2, np.int64), LAPLACE, 3)
    with pytest.raises(ValueError, match="3 symbols"):
        RangeWriter().code(None, LAPLACE, 3)


@pytest.mark.parametrize("frequencies", [[1 << 24, 0], [1 << 23, 1 << 22], [(1 << 24) + 1, -1]])
def test_bad_frequencies_are_refused(frequencies: list[int]) -> None:
    with pytest.raises(ValueError, match="sum to"):
        categorical(np.array(frequencies, np.int64))


@pytest.mark.parametrize("size", [0, 1, 3, 10, 65535, 1 << 17])
def test_bad_uniform_sizes_are_refused(size: int) -> None:
    with pytest.raises(ValueError, match="uniform"):
        uniform(size)


@pytest.mark.parametrize("length", [1, 2, 3, 5, 39])
def test_half_words_are_corrupt(length: int) -> None:
    with pytest.raises(CorruptBitstream, match="whole number of words") as caught:
        RangeReader(bytes(length), 77)
    assert caught.value.offset == 77


def test_unused_words_are_corrupt() -> None:
    data = write(random_symbols(LAPLACE, 200), LAPLACE)
    for spare in (b"\x01\x02\x03\x04" * 2, data):
        with pytest.raises(CorruptBitstream, match="unused words"):
            read(data + spare, LAPLACE, 200)
    with pytest.raises(CorruptBitstream, match="unused words"):
        read(data, LAPLACE, 100)


def test_wrong_words_decode_to_something_else_or_are_refused() -> None:
    symbols = random_symbols(LAPLACE, 200)
    data = write(symbols, LAPLACE)
    for position in range(len(data) - 4):
        for mask in (0x01, 0x80, 0xFF):
            wrong = bytearray(data)
            wrong[position] ^= mask
            try:
                same = np.array_equal(read(bytes(wrong), LAPLACE, 200), symbols)
            except CorruptBitstream:
                continue
            assert not same


def test_garbage_never_escapes_as_another_error() -> None:
    rng = np.random.default_rng(1)
    refused = 0
    for _ in range(300):
        data = rng.bytes(4 * int(rng.integers(0, 6)))
        try:
            found = read(data, LAPLACE, 100)
        except CorruptBitstream:
            refused += 1
            continue
        assert found.min() >= 0
        assert found.max() < LAPLACE.size
    assert refused > 0


def test_nothing_is_read_for_no_symbols() -> None:
    reader = RangeReader(b"")
    assert reader.code(None, LAPLACE, 0).shape == (0,)
    reader.finish()

"""Chapter 10: the package and the decoder of the text read the same symbols."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

from dfcgs_codec import CorruptBitstream
from dfcgs_codec.entropy import coder, tables
from dfcgs_codec.entropy.symbols import code_bits, code_escapes, code_residuals
from tests import spec_decoder


def _native_and_text(rng: np.random.Generator) -> tuple[coder.Model, Any]:
    """The same model, made by the package and by the decoder of the text."""
    kind = rng.integers(4)
    if kind == 0:
        size = 1 << int(rng.integers(1, 17))
        return coder.uniform(size), spec_decoder.uniform(size)
    if kind == 1:
        bias, count = int(rng.integers(16)), int(rng.integers(2, 33))
        return coder.split_model(bias, count), spec_decoder.split_model(bias, count)
    if kind == 2:
        weights = rng.integers(0, 1 << 24, int(rng.integers(2, 200))) * rng.integers(0, 2)
        weights[0] += 1
        native = coder.categorical(tables.frequencies_from_weights(weights))
        return native, spec_decoder.from_weights(weights.tolist())
    shape, scale = int(rng.integers(3)), int(rng.integers(64))
    return coder.scale_model(tables.Shape(shape), scale), spec_decoder.scale_model(shape, scale)


def _range_encode(symbols: list[int], models: list[Any]) -> bytes:
    """Annex C."""
    lower, width, num_words = 0, 2**64 - 1, 0
    for s, model in zip(symbols, models, strict=True):
        scale = width >> 24
        lower += scale * model.cumulative[s]
        width = scale * (model.cumulative[s + 1] - model.cumulative[s])
        if width < 2**32:
            lower, width, num_words = lower << 32, width << 32, num_words + 1
    if not symbols:
        return b""
    top = (lower + 2**32 - 1) >> 32
    words = [top >> 32 * i & 0xFFFFFFFF for i in range(num_words, -1, -1)]
    if (lower + width) >> 32 == top:
        words.append(0)
    return struct.pack(f"<{len(words)}I", *words)


@pytest.mark.parametrize("seed", range(40))
def test_range_coder_is_that_of_the_text(seed: int) -> None:
    rng = np.random.default_rng(seed)
    pairs = [_native_and_text(rng) for _ in range(int(rng.integers(0, 60)))]
    writer = coder.RangeWriter()
    symbols, models = [], []
    for native, text in pairs:
        # rare symbols make carries and long runs of equal words likely
        drawn = rng.choice([0, text.size - 1, int(rng.integers(text.size))], int(rng.integers(1, 12)))
        writer.code(drawn.astype(np.int64), native, len(drawn))
        symbols += drawn.tolist()
        models += [text] * len(drawn)
    data = writer.getvalue()
    assert _range_encode(symbols, models) == data
    stream = spec_decoder.RangeDecoder(data)
    assert [stream.decode(model) for model in models] == symbols
    stream.finish()
    # words that are zero at the end may be missing
    stripped = data
    while stripped.endswith(bytes(4)):
        stripped = stripped[:-4]
    for reader in (spec_decoder.RangeDecoder(stripped), coder.RangeReader(stripped)):
        if isinstance(reader, coder.RangeReader):
            found = [
                int(reader.code(None, native, 1)[0])
                for native, n in _counted(pairs, models)
                for _ in range(n)
            ]
        else:
            found = [reader.decode(model) for model in models]
        assert found == symbols


def _counted(pairs: list[tuple[Any, Any]], models: list[Any]) -> Iterator[tuple[coder.Model, int]]:
    """Package's models with the number of symbols that each codes."""
    place = 0
    for native, text in pairs:
        start = place
        while place < len(models) and models[place] is text:
            place += 1
        yield native, place - start


def _outcome(decode: Callable[[], list[int]], error: type[Exception]) -> list[int] | None:
    try:
        return decode()
    except error:
        return None


@pytest.mark.parametrize("seed", range(30))
def test_any_words_decode_alike_and_end_alike(seed: int) -> None:
    rng = np.random.default_rng(1000 + seed)
    words = rng.integers(0, 1 << 32, int(rng.integers(0, 6)), np.uint64)
    words[rng.random(len(words)) < 0.4] = (1 << 32) - 1
    data = words.astype("<u4").tobytes()
    pairs = [_native_and_text(rng) for _ in range(int(rng.integers(0, 14)))]

    def native() -> list[int]:
        reader = coder.RangeReader(data)
        found = [int(reader.code(None, model, 1)[0]) for model, _ in pairs]
        reader.finish()
        return found

    def text() -> list[int]:
        stream = spec_decoder.RangeDecoder(data)
        found = [stream.decode(model) for _, model in pairs]
        stream.finish()
        return found

    assert _outcome(native, CorruptBitstream) == _outcome(text, spec_decoder.Refused)


@pytest.mark.parametrize(
    ("words", "num_symbols", "whole"),
    [
        ([], 0, True),
        ([9, 2], 0, True),
        ([0, 0, 0], 0, False),
        ([], 5, True),
        ([1, 0xFFFFFFFE], 1, True),
        ([1, 0xFFFFFFFF], 1, False),
        ([2, 0], 1, False),
        ([0, 0, 0], 1, False),
    ],
)
def test_the_end_of_a_stream(words: list[int], num_symbols: int, whole: bool) -> None:
    data = struct.pack(f"<{len(words)}I", *words)
    reader, stream = coder.RangeReader(data), spec_decoder.RangeDecoder(data)
    assert reader.code(None, coder.uniform(2), num_symbols).tolist() == [0] * num_symbols
    assert [stream.decode(spec_decoder.uniform(2)) for _ in range(num_symbols)] == [0] * num_symbols
    for finish, error in ((reader.finish, CorruptBitstream), (stream.finish, spec_decoder.Refused)):
        if whole:
            finish()
        else:
            with pytest.raises(error):
                finish()


def test_a_quantile_beyond_the_models_is_refused() -> None:
    with pytest.raises(CorruptBitstream):
        coder.RangeReader(b"\xff" * 8).code(None, coder.uniform(2), 1)
    with pytest.raises(spec_decoder.Refused):
        spec_decoder.RangeDecoder(b"\xff" * 8).decode(spec_decoder.uniform(2))


@pytest.mark.parametrize("seed", range(12))
def test_residuals_escapes_and_bits_are_those_of_the_text(seed: int) -> None:
    rng = np.random.default_rng(2000 + seed)
    count = int(rng.integers(0, 80))
    wide = rng.integers(-(1 << 40), 1 << 40, count) >> rng.integers(8, 41, count)
    contexts = rng.integers(0, 5, count)
    chosen = rng.integers(0, 480, 5)
    chosen[:2] = rng.choice([0, 63, 64, 159], 2)
    escapes = rng.integers(0, (1 << 32) - 1, count) >> rng.integers(0, 33, count)
    width = int(rng.integers(0, 64))
    raw = rng.integers(0, 1 << 62, count) & ((1 << width) - 1)
    writer = coder.RangeWriter()
    code_residuals(writer, wide, contexts, chosen)
    code_escapes(writer, escapes, count)
    code_bits(writer, raw, width, count)
    stream = spec_decoder.RangeDecoder(writer.getvalue())
    assert stream.residuals(contexts.tolist(), dict(enumerate(chosen.tolist()))) == wide.tolist()
    assert stream.escapes(count) == escapes.tolist()
    assert stream.bits(width, count) == raw.tolist()
    stream.finish()

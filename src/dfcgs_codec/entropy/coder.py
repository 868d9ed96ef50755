"""The range coder: the only module that touches constriction (spec section 10).

`RangeWriter` and `RangeReader` share one method, `code`, so that whoever codes symbols does it once:
the writer takes them and hands them back, the reader ignores what it is given and finds them.
"""

from __future__ import annotations

from functools import cache
from typing import Any, Protocol

import constriction
import numpy as np

from dfcgs_codec.array_types import Int64
from dfcgs_codec.entropy.tables import FREQUENCY_BITS, Shape, scale_table, split_table
from dfcgs_codec.errors import CorruptBitstream

_MODELS = constriction.stream.model
_WORD_BYTES = 4
MAX_UNIFORM_BITS = 16


class Model:
    """A probability model of the symbols 0..size - 1; `frequencies` (int64) sum to 2**24."""

    def __init__(self, native: Any, frequencies: Int64) -> None:
        self.native = native
        self.frequencies = frequencies
        self.size = len(frequencies)


def categorical(frequencies: Int64) -> Model:
    """Model of the given 24-bit frequencies, all >= 1, sum 2**24."""
    if frequencies.min() < 1 or frequencies.sum() != 1 << FREQUENCY_BITS:
        raise ValueError("frequencies must be positive and sum to 2**24")
    # constriction adds 1 to every entry itself; perfect=True would use log and sorting
    native = _MODELS.Categorical((frequencies - 1).astype(np.float64), perfect=False)
    return Model(native, frequencies)


@cache
def uniform(size: int) -> Model:
    """Model of `size` equally likely symbols, a power of two, 2 <= size <= 2**16."""
    if not 2 <= size <= 1 << MAX_UNIFORM_BITS or size & (size - 1):
        raise ValueError(f"uniform model of {size} symbols")
    flat = np.full(size, (1 << FREQUENCY_BITS) // size, np.int64)
    return Model(_MODELS.Uniform(size), flat)


@cache
def scale_model(shape: Shape, base_scale: int) -> Model:
    """Model of `tables.scale_table`."""
    return categorical(scale_table(shape, base_scale))


@cache
def split_model(bias: int, count: int) -> Model:
    """Model of `tables.split_table`."""
    return categorical(split_table(bias, count))


class RangeCoder(Protocol):
    """Codes symbols in one direction or the other."""

    def code(self, symbols: Int64 | None, model: Model, count: int) -> Int64:
        """The `count` symbols (int64, 0 <= symbol < model.size), coded; a reader ignores `symbols`."""


class RangeWriter:
    """Encodes symbols to a stream."""

    def __init__(self) -> None:
        self._encoder = constriction.stream.queue.RangeEncoder()

    def code(self, symbols: Int64 | None, model: Model, count: int) -> Int64:
        """Encode; ValueError for symbols that the model does not have."""
        if symbols is None or len(symbols) != count:
            raise ValueError(f"{count} symbols are needed")
        if count:
            # negative ones are the largest without a sign
            if symbols.view(np.uint64).max() >= model.size:
                raise ValueError(f"symbol outside 0..{model.size - 1}")
            self._encoder.encode(np.ascontiguousarray(symbols, np.int32), model.native)
        return symbols

    def getvalue(self) -> bytes:
        """The stream: little-endian 32-bit words."""
        return np.asarray(self._encoder.get_compressed()).astype("<u4").tobytes()


class RangeReader:
    """Decodes symbols from a stream whose checksum was found right; `num_symbols` so far."""

    def __init__(self, data: bytes, offset: int | None = None) -> None:
        self._offset = offset
        if len(data) % _WORD_BYTES:
            raise CorruptBitstream("a range-coded stream is not a whole number of words", offset=offset)
        words = np.frombuffer(data, "<u4").astype(np.uint32)
        self._decoder = constriction.stream.queue.RangeDecoder(words)
        self.num_symbols = 0

    def code(self, symbols: Int64 | None, model: Model, count: int) -> Int64:
        """Decode `count` symbols."""
        if not count:
            return np.zeros(0, np.int64)
        self.num_symbols += count
        try:
            decoded = self._decoder.decode(model.native, count)
        except Exception as error:
            raise CorruptBitstream("range decoder lost its way", offset=self._offset) from error
        return np.asarray(decoded).astype(np.int64)

    def finish(self) -> None:
        """Refuse a stream of which a part was not used."""
        if not self._decoder.maybe_exhausted():
            raise CorruptBitstream("unused words in a range-coded stream", offset=self._offset)

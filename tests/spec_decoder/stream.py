"""Chapter 10: the range decoder, and what is made of its symbols."""

from __future__ import annotations

import struct
from bisect import bisect_right
from collections.abc import Iterator
from typing import TYPE_CHECKING

from tests.spec_decoder.basics import LAPLACE, require, sign, unfold
from tests.spec_decoder.tables import from_weights, scale_model, split_scale, uniform

if TYPE_CHECKING:
    from tests.spec_decoder.basics import Fields, Row
    from tests.spec_decoder.tables import Model


class RangeDecoder:
    """A stream (10.1 to 10.3)."""

    def __init__(self, data: bytes) -> None:
        require(len(data) % 4 == 0)
        self.words: tuple[int, ...] = struct.unpack(f"<{len(data) // 4}I", data)
        self.lower, self.range, self.next = 0, 2**64 - 1, 0
        self.point = self.read_word() << 32
        self.point |= self.read_word()

    def read_word(self) -> int:
        if self.next == len(self.words):
            return 0
        self.next += 1
        return self.words[self.next - 1]

    def decode(self, model: Model) -> int:
        scale = self.range >> 24
        quantile = ((self.point - self.lower) % 2**64) // scale
        require(quantile < 2**24)
        s = bisect_right(model.cumulative, quantile) - 1
        start, stop = model.cumulative[s : s + 2]
        self.lower = (self.lower + scale * start) % 2**64
        self.range = scale * (stop - start)
        if self.range < 2**32:
            self.lower = (self.lower << 32) % 2**64
            self.range <<= 32
            self.point = (self.point << 32) % 2**64 | self.read_word()
        return s

    def finish(self) -> None:
        require(self.next == len(self.words))
        require(self.range == 2**64 - 1 or (self.point - self.lower) % 2**64 < 2**33 - 1)

    def bits(self, width: int, count: int) -> Row:
        values = [0] * count
        for shift in range(0, width, 16):
            model = uniform(2 ** min(16, width - shift))
            for i in range(count):
                values[i] |= self.decode(model) << shift
        return values

    def escapes(self, count: int) -> Row:
        lengths = [self.decode(uniform(32)) for _ in range(count)]
        values = [0] * count
        for n in sorted(set(lengths)):
            rows = [i for i in range(count) if lengths[i] == n]
            for i, low in zip(rows, self.bits(n, len(rows)), strict=True):
                values[i] = low + 2**n - 1
        return values

    def count_value(self, limit: int) -> int:
        value = self.escapes(1)[0]
        require(value <= limit)
        return value

    def signed_value(self, limit: int) -> int:
        return unfold(self.count_value(2 * limit))

    def grouped(self, contexts: Row, models: dict[int, Model]) -> Row:
        values = [0] * len(contexts)
        for i in grouped_order(contexts):
            values[i] = self.decode(models[contexts[i]])
        return values

    def residuals(self, contexts: Row, tables: dict[int, int], explicit: list[Model] | None = None) -> Row:
        """10.10; a table of -1 - i is that of row i of `explicit` (17.1)."""
        order = grouped_order(contexts)
        values, escaped = [0] * len(contexts), []
        low_bits = {}
        for i in order:
            table = tables[contexts[i]]
            shape, scale = divmod(table, 160)
            base, low_bits[contexts[i]] = split_scale(scale) if table >= 0 else (0, 0)
            model = scale_model(shape, base) if table >= 0 else (explicit or [])[-1 - table]
            k = model.size // 2
            values[i] = self.decode(model) - k
            if abs(values[i]) == k:
                escaped.append(i)
        for i, excess in zip(escaped, self.escapes(len(escaped)), strict=True):
            values[i] += sign(values[i]) * excess
        for c in sorted(low_bits):
            rows = [i for i in order if contexts[i] == c] if low_bits[c] else []
            for i, low in zip(rows, self.bits(low_bits[c], len(rows)), strict=True):
                values[i] = (values[i] << low_bits[c]) | low
        return values

    def flat(self, table: int, count: int) -> Row:
        return self.residuals([0] * count, {0: table})

    # 11.2, 11.3: side information

    def read_weights(self, n: int) -> Row:
        index = self.count_value(64)
        if index == 64:
            return [0] * n
        w = self.flat(LAPLACE * 160 + index, n)
        require(all(abs(x) <= 4096 for x in w))
        return w

    def read_tables(self, num_contexts: int) -> dict[int, int]:
        first = self.count_value(num_contexts - 1)
        n = self.count_value(num_contexts - 1 - first) + 1
        shape_steps = self.flat(LAPLACE * 160 + 18, n)
        start = self.flat(LAPLACE * 160 + 50, 1)[0]
        scale_steps = self.flat(LAPLACE * 160 + 26, n - 1)
        tables = dict.fromkeys(range(num_contexts), LAPLACE * 160 + 26)
        shape, scale = LAPLACE, start + 26
        for j in range(n):
            shape += shape_steps[j]
            if j > 0:
                scale += scale_steps[j - 1] + 3
            require(0 <= shape <= 2 and 0 <= scale <= 159)
            tables[first + j] = shape * 160 + scale
        return tables

    def read_histograms(self, used: Row, size: int) -> dict[int, Model]:
        index = self.count_value(63)
        steps = iter(self.flat(LAPLACE * 160 + index, size * len(used)))
        level, models = 0, {}
        for c in used:
            w = []
            for _ in range(size):
                level += next(steps)
                require(0 <= level <= 63)
                down = 62 - level
                w.append(0 if level == 63 else (256, 304, 362, 431)[down % 4] << (down // 4))
            require(any(w))
            models[c] = from_weights(w)
        return models


def grouped_order(contexts: Row) -> Row:
    return sorted(range(len(contexts)), key=lambda i: (contexts[i], i))


def occurring(contexts: Row) -> Row:
    return sorted(set(contexts))


def open_streams(fields: Fields, count: int) -> Iterator[RangeDecoder]:
    lengths = [fields.uvarint() for _ in range(count)]
    for length in lengths:
        stream = RangeDecoder(fields.raw(length))
        yield stream
        stream.finish()
    require(fields.place == len(fields.data))

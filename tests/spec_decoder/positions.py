"""Section 11.1: the position tree."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from tests.spec_decoder.basics import GAUSSIAN, clip, require
from tests.spec_decoder.stream import occurring
from tests.spec_decoder.tables import split_model, uniform

if TYPE_CHECKING:
    from tests.spec_decoder.basics import Matrix, Row
    from tests.spec_decoder.stream import RangeDecoder


def split_small(stream: RangeDecoder, counts: Row) -> Row:
    def of(count: int) -> int:
        return 0 if count == 2 else 1 if count <= 4 else 2

    bias = {c: stream.decode(uniform(16)) for c in occurring([of(count) for count in counts])}
    return stream.grouped(counts, {c: split_model(bias[of(c)], c) for c in set(counts)})


def split_large(stream: RangeDecoder, counts: Row) -> Row:
    contexts = [c.bit_length() for c in counts]
    tables = {b: GAUSSIAN * 160 + clip(6 * b + 11, 0, 159) for b in contexts}
    return [r + (c >> 1) for r, c in zip(stream.residuals(contexts, tables), counts, strict=True)]


def split(stream: RangeDecoder, counts: Row) -> Row:
    lower = [0] * len(counts)
    for group, code in (
        ([i for i, c in enumerate(counts) if c <= 32], split_small),
        ([i for i, c in enumerate(counts) if c > 32], split_large),
    ):
        for i, value in zip(group, code(stream, [counts[i] for i in group]), strict=True):
            require(0 <= value <= counts[i])
            lower[i] = value
    return lower


def sorted_keys(stream: RangeDecoder, count: int, key_bits: int) -> Row:
    keys, remaining = [0] * count, [0] * count
    cells = [(0, count, 0)]
    for depth in range(key_bits, -1, -1):
        for first, number, key in cells:
            if number == 1:
                keys[first], remaining[first] = key << depth, depth
        cells = [cell for cell in cells if cell[1] > 1]
        if depth == 0 or not cells:
            break
        lower = split(stream, [number for _, number, _ in cells])
        halves = []
        for (first, number, key), low in zip(cells, lower, strict=True):
            halves += [(first, low, 2 * key), (first + low, number - low, 2 * key + 1)]
        cells = [cell for cell in halves if cell[1] > 0]
    for first, number, key in cells:
        keys[first : first + number] = [key] * number
    for d in occurring(remaining):
        rows = [i for i in range(count) if remaining[i] == d]
        for i, low in zip(rows, stream.bits(d, len(rows)), strict=True):
            keys[i] |= low
    return keys


@dataclass
class SortGrid:
    shift: int
    bits: int
    origin: Row
    has_excess: bool


def position_tree(stream: RangeDecoder, count: int, grid: SortGrid) -> Matrix:
    keys = sorted_keys(stream, count, 3 * grid.bits)
    cells = [
        [sum((key >> (3 * b + 2 - axis) & 1) << b for b in range(grid.bits)) for axis in range(3)]
        for key in keys
    ]
    top = 2**grid.bits - 1
    if grid.has_excess:
        for axis in range(3):
            at_low = [i for i in range(count) if cells[i][axis] == 0]
            at_high = [i for i in range(count) if cells[i][axis] == top]
            for i, below in zip(at_low, stream.escapes(len(at_low)), strict=True):
                cells[i][axis] -= below
            for i, above in zip(at_high, stream.escapes(len(at_high)), strict=True):
                cells[i][axis] += above
    low = stream.bits(grid.shift, 3 * count)
    return [
        [((cell[a] + grid.origin[a]) << grid.shift) | low[3 * i + a] for a in range(3)]
        for i, cell in enumerate(cells)
    ]

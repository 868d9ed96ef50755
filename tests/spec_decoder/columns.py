"""Sections 9.8 and 11.2: columns."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from tests.spec_decoder.basics import STATE_LIMIT, require, round_divide, round_shift, sign

if TYPE_CHECKING:
    from tests.spec_decoder.basics import Matrix, Row
    from tests.spec_decoder.lods import Lods
    from tests.spec_decoder.stream import RangeDecoder

CHAIN_LENGTH, FEWEST_SYMBOLS = 128, 512


def ladder(a: int, num_steps: int) -> int:
    if a == 0:
        return 0
    b = a.bit_length()
    return min(2 * b - 1 + (1 if a << 8 >= 181 << b else 0), num_steps - 1)


def turns_of_second(chain: Row) -> Row:
    """9.8: `a`, which is 1 where the symbol of a chain is of the second quantiser."""
    p = [0] * 3 + [k & 1 for k in chain]
    a = [0] * 3
    for t in range(3, len(p)):
        a.append(a[t - 1] ^ a[t - 3] ^ p[t - 2])
    return a[3:]


def quantisers_of(symbols: Row) -> Row:
    """9.8: of each symbol of a pass in which two quantisers take turns, 0 for the first, 1 for the second."""
    second = [0] * len(symbols)
    if len(symbols) >= FEWEST_SYMBOLS:
        num_chains = -(-len(symbols) // CHAIN_LENGTH)
        for j in range(num_chains):
            second[j::num_chains] = turns_of_second(symbols[j::num_chains])
    return second


class ColumnSteps(NamedTuple):
    """9.6: the step of each row of a column, and whether two quantisers take turns (9.8)."""

    step: Row
    alternates: bool = False
    in_steps: bool = False

    def worth(self, rows: Row, symbols: Row) -> Row:
        """What the symbols of a pass are worth; `rows` are those that they belong to."""
        second = quantisers_of(symbols) if self.alternates else [0] * len(symbols)
        values = []
        for row, k, is_second in zip(rows, symbols, second, strict=True):
            s = self.step[row]
            require(abs(k) <= 2 * STATE_LIMIT // s)
            values.append((2 * k - sign(k)) * s >> 1 if is_second else k * s)
        return values


def column(
    stream: RangeDecoder, lods: Lods, features: Matrix, sources: Matrix, steps: ColumnSteps | None = None
) -> tuple[Row, Row]:
    """Values and residuals of all rows."""
    steps = steps or ColumnSteps([1] * lods.count)
    center = stream.signed_value(STATE_LIMIT)
    weights = stream.read_weights(1 + len(features))
    size_weights = stream.read_weights(2 + len(sources))
    tables = stream.read_tables(32)
    value, residual = [0] * lods.count, [0] * lods.count

    def predict(row: int, mean: int) -> int:
        learned = sum(f[row] * w for f, w in zip(features, weights[1:], strict=True))
        p = center + round_shift((mean - (center << 8)) * weights[0] + (learned << 8), 16)
        return round_divide(p, steps.step[row]) * steps.step[row] if steps.in_steps else p

    def context(row: int, deviation: int) -> int:
        own = size_weights[1] * steps.step[row]
        own += sum(s[row] * w for s, w in zip(sources, size_weights[2:], strict=True))
        t = deviation * size_weights[0] + (own << 8)
        return ladder((max(t, 0) >> 11) // steps.step[row], 31)

    def code_pass(rows: range, contexts: Row, predictions: Row) -> None:
        worth = steps.worth(list(rows), stream.residuals(contexts, tables))
        for row, p, r in zip(rows, predictions, worth, strict=True):
            value[row], residual[row] = p + r, r
            require(abs(value[row]) <= STATE_LIMIT)

    if not (weights[0] or size_weights[0]):
        rows = range(lods.count)
        code_pass(rows, [context(i, 0) for i in rows], [predict(i, center << 8) for i in rows])
        return value, residual
    code_pass(lods.base, [31] * len(lods.base), [predict(i, center << 8) for i in lods.base])
    for rows, neighbours in lods.levels():
        found = [lods.statistics(i, neighbours(i), value) for i in rows]
        contexts = [context(i, deviation) for i, (_, deviation) in zip(rows, found, strict=True)]
        code_pass(rows, contexts, [predict(i, mean) for i, (mean, _) in zip(rows, found, strict=True)])
    return value, residual


def permutation(stream: RangeDecoder, lods: Lods) -> Row:
    value, _ = column(stream, lods, [], [])
    require(sorted(value) == list(range(lods.count)))
    return value

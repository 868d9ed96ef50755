"""Sections 9.8 and 11.2: columns."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, NamedTuple, Protocol

from tests.spec_decoder.basics import STATE_LIMIT, require, round_divide, round_shift, sign

if TYPE_CHECKING:
    from tests.spec_decoder.basics import Matrix, Row
    from tests.spec_decoder.lods import Lods
    from tests.spec_decoder.stream import RangeDecoder
    from tests.spec_decoder.tables import Model

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


class Rule(Protocol):
    """11.2: how the rows of a column are predicted, and what its symbols are worth."""

    tables: dict[int, int]
    models: list[Model]

    def of(self, row: int, statistics: tuple[int, int] | None) -> tuple[int, int]:
        """Prediction and context of a row; the base has no statistics."""
        ...

    def worth(self, rows: Row, symbols: Row) -> Row:
        """Residuals of the rows of a pass."""
        ...


def decoded(stream: RangeDecoder, lods: Lods, rule: Rule) -> tuple[Row, Row]:
    """11.2: values and residuals of all rows."""
    value, residual = [0] * lods.count, [0] * lods.count

    def code_pass(rows: range, found: list[tuple[int, int]]) -> None:
        k = stream.residuals([context for _, context in found], rule.tables, rule.models)
        for row, (prediction, _), r in zip(rows, found, rule.worth(list(rows), k), strict=True):
            value[row], residual[row] = prediction + r, r

    code_pass(lods.base, [rule.of(i, None) for i in lods.base])
    for rows, neighbours in lods.levels():
        code_pass(rows, [rule.of(i, lods.statistics(i, neighbours(i), value)) for i in rows])
    return value, residual


class StreamRule:
    """11.2: the rule whose weights and tables the stream carries."""

    models: ClassVar[list[Model]] = []

    def __init__(self, stream: RangeDecoder, features: Matrix, sources: Matrix, steps: ColumnSteps) -> None:
        self.features, self.sources, self.steps = features, sources, steps
        self.center = stream.signed_value(STATE_LIMIT)
        self.weights = stream.read_weights(1 + len(features))
        self.size_weights = stream.read_weights(2 + len(sources))
        self.tables = stream.read_tables(32)
        self.is_spatial = bool(self.weights[0] or self.size_weights[0])

    def of(self, row: int, statistics: tuple[int, int] | None) -> tuple[int, int]:
        mean, deviation = statistics or (self.center << 8, 0)
        step = self.steps.step[row]
        learned = sum(f[row] * w for f, w in zip(self.features, self.weights[1:], strict=True))
        p = self.center + round_shift((mean - (self.center << 8)) * self.weights[0] + (learned << 8), 16)
        prediction = round_divide(p, step) * step if self.steps.in_steps else p
        own = self.size_weights[1] * step
        own += sum(s[row] * w for s, w in zip(self.sources, self.size_weights[2:], strict=True))
        t = deviation * self.size_weights[0] + (own << 8)
        in_base = self.is_spatial and statistics is None
        return prediction, 31 if in_base else ladder((max(t, 0) >> 11) // step, 31)

    def worth(self, rows: Row, symbols: Row) -> Row:
        return self.steps.worth(rows, symbols)


def column(
    stream: RangeDecoder, lods: Lods, features: Matrix, sources: Matrix, steps: ColumnSteps | None = None
) -> tuple[Row, Row]:
    """11.2: a column by the rule whose weights and tables the stream carries."""
    rule = StreamRule(stream, features, sources, steps or ColumnSteps([1] * lods.count))
    value, residual = decoded(stream, lods if rule.is_spatial else lods.finest(0), rule)
    require(all(abs(v) <= STATE_LIMIT for v in value))
    return value, residual


def permutation(stream: RangeDecoder, lods: Lods) -> Row:
    value, _ = column(stream, lods, [], [])
    require(sorted(value) == list(range(lods.count)))
    return value

"""Chapter 17: the frozen prior."""

from __future__ import annotations

import operator
from collections.abc import Mapping
from itertools import accumulate
from typing import TYPE_CHECKING, NamedTuple

from tests.spec_decoder.basics import clip, round_shift
from tests.spec_decoder.columns import decoded
from tests.spec_decoder.models import rows_of
from tests.spec_decoder.tables import Model

if TYPE_CHECKING:
    from tests.spec_decoder.basics import Matrix, Row
    from tests.spec_decoder.lods import Lods
    from tests.spec_decoder.models import Array
    from tests.spec_decoder.stream import RangeDecoder


class PriorModel:
    """17.1."""

    def __init__(self, arrays: Mapping[str, Array]) -> None:
        def models(name: str) -> list[Model]:
            return [Model([0, *accumulate(row)]) for row in rows_of(arrays[name])]

        self.networks: dict[str, list[tuple[Matrix, Row, Row]]] = {}
        for name in ("flags", "columns", "control"):
            self.networks[name] = []
            while f"{name}.{len(self.networks[name])}.weight" in arrays:
                prefix = f"{name}.{len(self.networks[name])}."
                weight = rows_of(arrays[prefix + "weight"])
                layer = (weight, arrays[prefix + "bias"].values, arrays[prefix + "scale"].values)
                self.networks[name].append(layer)
        self.flags = dict(enumerate(models("flags.frequencies")))
        self.densities = dict(enumerate(models("densities.frequencies")))
        self.magnitudes = dict(enumerate(arrays["magnitudes.tables"].values))
        self.control_weights = rows_of(arrays["control.weights"])
        self.tables = {n: dict(enumerate(arrays[f"{n}.tables"].values)) for n in ("columns", "control")}
        self.rows = {n: models(f"{n}.frequencies") for n in ("columns", "control")}

    def kind(self, name: str, x: Row) -> int:
        """17.1: `class`."""
        for weight, bias, (shift, limit) in self.networks[name]:
            x = [
                clip((b + sum(map(operator.mul, row, x))) >> shift, 0, limit)
                for row, b in zip(weight, bias, strict=True)
            ]
        return x[0]


def cell_of(c: int, kind: int, fraction: int) -> int:
    """17.1: `cell`."""
    return (kind * 3 + fraction) * 18 + c if c < 18 else 4 * 3 * 18 + c - 18


def log(a: int) -> int:
    """17.2."""
    a = min(a, 2**24 - 1)
    b = a.bit_length()
    return 8 * b + ((a << 3) >> (b - 1)) - 8 if a > 0 else 0


def size(row: Row) -> int:
    """17.2."""
    return sum(abs(s) for s in row)


class PriorColumn(NamedTuple):
    """17.3: what a column is decoded with; `u` lacks what is found there."""

    name: str
    weights: Row
    features: Matrix
    common: Matrix
    kinds: Row
    u: Matrix


def column_inputs(before: int, earlier: Row, last: int) -> Row:
    """17.3: u, from the symbol before, those of the columns decoded before this one, and u[9]."""
    one, other = [0, 0, *earlier][-1], [0, 0, *earlier][-2]
    return [0, 0, 0, log(abs(before)), log(abs(one)), log(abs(other)), log(size(earlier)), 0, 0, last]


class PriorRule:
    """17.3."""

    def __init__(self, model: PriorModel, column: PriorColumn) -> None:
        self.model, self.column = model, column
        self.tables, self.models = model.tables[column.name], model.rows[column.name]
        self.is_flipped = [False] * len(column.common)

    def of(self, row: int, statistics: tuple[int, int] | None) -> tuple[int, int]:
        w, features, u = self.column.weights, self.column.features, list(self.column.u[row])
        expected = sum(f[row] * v for f, v in zip(features, w[1:], strict=True)) << 4
        u[0:3] = [0, 0, 64]
        if statistics is not None:
            mean, deviation = statistics
            expected += mean * w[0]
            u[0:3] = [log(deviation), log(abs(mean)), 0]
        prediction = round_shift(expected, 16)
        f = expected - (prediction << 16)
        kind = 0 if prediction != 0 else self.column.kinds[row]
        u[7], u[8] = log(abs(expected) >> 8), 64 if kind > 0 else 0
        fraction = 0 if abs(f) < 2**13 else 1 if abs(f) < 3 * 2**13 else 2
        self.is_flipped[row] = f < 0 and fraction > 0
        x = self.column.common[row] + [min(c, 255) for c in u]
        return prediction, cell_of(self.model.kind(self.column.name, x), kind, fraction)

    def worth(self, rows: Row, symbols: Row) -> Row:
        return [-k if self.is_flipped[i] else k for i, k in zip(rows, symbols, strict=True)]


def prior_column(stream: RangeDecoder, model: PriorModel, lods: Lods, column: PriorColumn) -> tuple[Row, Row]:
    """17.3: values and residuals of all rows."""
    return decoded(stream, lods.finest(5), PriorRule(model, column))

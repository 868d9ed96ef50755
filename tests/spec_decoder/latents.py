"""The networks of profile PAPER, and what they are told."""

from __future__ import annotations

import math
import operator
from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import accumulate
from typing import TYPE_CHECKING, NamedTuple

from tests.spec_decoder.basics import (
    COLUMNS,
    GAUSSIAN,
    OPACITY,
    POSITION,
    ROTATION,
    SCALE,
    SH_DC,
    STATE_LIMIT,
    clip,
    require,
    shift_left,
    sign,
    transposed,
)
from tests.spec_decoder.models import rows_of
from tests.spec_decoder.stream import RangeDecoder
from tests.spec_decoder.tables import Model

if TYPE_CHECKING:
    from tests.spec_decoder.basics import Fields, Matrix, Row
    from tests.spec_decoder.headers import Sequence
    from tests.spec_decoder.models import Array


class Layer(NamedTuple):
    weight: Matrix
    bias: Row
    shift: int
    limit: int
    leaky: int


class FrozenModel:
    """Arrays of a model, as networks and tables."""

    def __init__(self, arrays: Mapping[str, Array]) -> None:
        self.networks: dict[str, list[Layer]] = {}
        for name in ("hyper_synthesis", "grid_context", "appearance", "fusion", "synthesis", "refinement"):
            layers: list[Layer] = []
            while f"{name}.{len(layers)}.weight" in arrays:
                prefix = f"{name}.{len(layers)}."
                weight = rows_of(arrays[prefix + "weight"])
                layers.append(Layer(weight, arrays[prefix + "bias"].values, *arrays[prefix + "scale"].values))
            if layers:
                self.networks[name] = layers
        self.grid = rows_of(arrays["grid"]) if "grid_context" in self.networks else []
        self._frequencies: Matrix = []
        if "hyper_synthesis" in self.networks:
            self._frequencies = rows_of(arrays["hyper_frequencies"])

    def network(self, name: str, x: Row) -> Row:
        x = [clip(value, -32767, 32767) for value in x]
        for weight, bias, shift, limit, leaky in self.networks[name]:
            y = []
            for row, b in zip(weight, bias, strict=True):
                v = clip((b + sum(map(operator.mul, row, x))) >> shift, -limit, limit)
                y.append(v >> 7 if leaky and v < 0 else v)
            x = y
        return x

    def hyper_models(self) -> dict[int, Model]:
        return {c: Model([0, *accumulate(row)]) for c, row in enumerate(self._frequencies)}


class Normalisation:
    """B.3, from the positions of the I-frame."""

    def __init__(self, positions: Matrix) -> None:
        n = len(positions)
        self.center, extents = [], [1]
        for column in transposed(positions):
            s = sorted(column)
            middle = s[n // 2]
            self.center.append(middle)
            extents += [s[min(n - 1, n * 95 // 100)] - middle, middle - s[n * 5 // 100]]
        self.size = (max(extents) - 1).bit_length()

    def normal(self, q: Row) -> Row:
        return [
            clip(shift_left(a - b, 15 - self.size), -(2**17), 2**17)
            for a, b in zip(q, self.center, strict=True)
        ]


def grid_row(corner: Row, side: int) -> int:
    """B.4."""
    x, y, z = corner
    if side**3 <= 4096:
        return x + side * (y + side * z)
    return (x ^ (y * 2654435761) ^ (z * 805459861)) & 4095


def place_features(normal: Row, grid: Matrix) -> Row:
    """B.4; `grid` has the rows of all levels."""
    t = [clip(c, -(2**15), 2**15 - 1) + 2**15 for c in normal]
    place = []
    for level in range(6):
        b = level + 2
        cell = [c >> (16 - b) for c in t]
        f = [(c >> (8 - b)) & 255 for c in t]
        total = [0] * 4
        for corner in range(8):
            d = [corner >> axis & 1 for axis in range(3)]
            row = grid[4096 * level + grid_row([a + e for a, e in zip(cell, d, strict=True)], 2**b + 1)]
            weight = math.prod(v if e else 256 - v for v, e in zip(f, d, strict=True))
            total = [a + weight * value for a, value in zip(total, row, strict=True)]
        place += [value >> 18 for value in total]
    return place


@dataclass
class Priors:
    """B.4: of the Gaussians of a reference frame, made when they are needed."""

    model: FrozenModel
    planes: dict[int, Matrix]
    normalisation: Normalisation
    sequence: Sequence
    _found: dict[int, Row] = field(default_factory=dict)

    def of(self, i: int) -> Row:
        if i not in self._found:
            prior = [0] * 16
            if "grid_context" in self.model.networks:
                place = place_features(self.normalisation.normal(self.planes[POSITION][i]), self.model.grid)
                prior = self.model.network("grid_context", place)
            if "appearance" in self.model.networks:
                appearance = self.model.network("appearance", self._look(i))
                prior = [a + b for a, b in zip(prior, appearance, strict=True)]
            self._found[i] = [clip(c, -32767, 32767) for c in prior]
        return self._found[i]

    def _look(self, i: int) -> Row:
        e = self.sequence.exponents
        size_log = ((self.normalisation.size + e[POSITION]) * 45426) >> 6
        look = [shift_left(c, e[SCALE] + 10) - size_log for c in self.planes[SCALE][i]]
        look += [c >> 12 for c in self.planes[ROTATION][i]]
        look.append(shift_left(self.planes[OPACITY][i][0], e[OPACITY] + 10))
        for attribute in self.sequence.attributes[SH_DC:]:
            look += [shift_left(c, e[SH_DC] + 12) for c in self.planes[attribute][i]]
        return look + [0] * (56 - len(look))


def hyper_latents(stream: RangeDecoder, model: FrozenModel, n: int) -> Matrix:
    """B.5: z."""
    values = stream.grouped([i % 16 for i in range(16 * n)], model.hyper_models())
    values = [value - 31 for value in values]
    escaped = [i for i, value in enumerate(values) if abs(value) == 31]
    for i, excess in zip(escaped, stream.escapes(len(escaped)), strict=True):
        values[i] += sign(values[i]) * excess
    return [values[16 * k : 16 * k + 16] for k in range(n)]


def latent_motions(
    model: FrozenModel, gaussian: Row, prior: Priors, payloads: tuple[Fields | None, Fields]
) -> tuple[Matrix, tuple[int, int]]:
    """B.2, B.5: m, and what B.7 spreads with."""
    hyper, fields = payloads
    n = len(gaussian)
    h = [[0] * 16] * n
    if hyper is not None:
        stream = RangeDecoder(hyper.data)
        h = [model.network("hyper_synthesis", z) for z in hyper_latents(stream, model, n)]
        stream.finish()
    num_coded, step_log2 = fields.uvarint(), fields.svarint()
    spread = fields.uvarint(), fields.svarint()
    require(num_coded == n and -4 <= step_log2 <= 6)
    require(1 <= spread[0] <= 128 and abs(spread[1]) <= 28)
    stream = RangeDecoder(fields.raw(len(fields.data) - fields.place))
    u = [model.network("fusion", h[k] + prior.of(gaussian[k])) for k in range(n)]
    scales = [clip(((c + 32) >> 6) - 6 * step_log2, 0, 159) for row in u for c in row[16:]]
    values = stream.residuals(scales, {scale: GAUSSIAN * 160 + scale for scale in range(160)})
    stream.finish()
    motions = []
    for k in range(n):
        y = [
            clip((clip(value, -32767, 32767) << (6 + step_log2)) + mean, -32767, 32767)
            for value, mean in zip(values[16 * k : 16 * k + 16], u[k][:16], strict=True)
        ]
        motions.append(model.network("synthesis", y))
    return motions, spread


def motion_of_output(m: Row, size: int) -> Row:
    """B.6."""
    m = [shift_left(c, size - 16) for c in m[:3]] + [c << 8 for c in m[3:]]
    return [clip(c, -2 * STATE_LIMIT, 2 * STATE_LIMIT) for c in m]


def refined(planes: dict[int, Matrix], changes: Matrix, sequence: Sequence) -> dict[int, Matrix]:
    """B.6, with what the network makes of each Gaussian."""
    planes, start = dict(planes), 0
    for attribute in sequence.attributes[SH_DC + 1 :]:
        stop = start + COLUMNS[attribute]
        planes[attribute] = [
            [
                clip(a + shift_left(c, -12 - sequence.exponents[SH_DC]), -STATE_LIMIT, STATE_LIMIT)
                for a, c in zip(row, change[start:stop], strict=True)
            ]
            for row, change in zip(planes[attribute], changes, strict=True)
        ]
        start = stop
    return planes

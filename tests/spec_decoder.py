"""A decoder written from bitstream_spec.md alone: plain Python integers, nothing from the package.

It is slow and checks little; it exists to show that the text is complete. Functions carry the names of the
text's pseudo-code, and comments cite its sections.
"""

from __future__ import annotations

import hashlib
import math
import operator
import struct
import zlib
from bisect import bisect_right
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from itertools import accumulate
from typing import NamedTuple, TypeVar

STATE_LIMIT = 2**29 - 1
GAUSSIAN, LAPLACE, HEAVY = 0, 1, 2
POSITION, SCALE, ROTATION, OPACITY, SH_DC = 0, 1, 2, 3, 4
MOTION, TOPOLOGY, VISIBILITY, LATENT, REFINEMENT, ESCAPE = 1, 2, 4, 8, 16, 32
MAIN, PAPER = 0, 1
COLUMNS = (3, 3, 4, 1, 3, 9, 15, 21)
Row = list[int]
Matrix = list[list[int]]
T = TypeVar("T")


class Refused(Exception):
    """The file does not conform."""


class ModelMismatch(Refused):
    """The file wants a model that the decoder does not have."""

    code = "model-mismatch"


def require(condition: bool) -> None:
    if not condition:
        raise Refused


# --- 1.2 arithmetic ---------------------------------------------------------------------------------------


def clip(a: int, low: int, high: int) -> int:
    return min(max(a, low), high)


def sign(a: int) -> int:
    return (a > 0) - (a < 0)


def round_divide(a: int, b: int) -> int:
    return (2 * a + b) // (2 * b)


def round_shift(a: int, n: int) -> int:
    return (a + (1 << (n - 1))) >> n


def unfold(u: int) -> int:
    return u >> 1 if u % 2 == 0 else -(u >> 1) - 1


# --- 2 fields ---------------------------------------------------------------------------------------------


class Fields:
    def __init__(self, data: bytes) -> None:
        self.data = data
        self.place = 0

    def raw(self, count: int) -> bytes:
        require(self.place + count <= len(self.data))
        self.place += count
        return self.data[self.place - count : self.place]

    def u8(self) -> int:
        return self.raw(1)[0]

    def uvarint(self) -> int:
        value = 0
        for i in range(10):
            byte = self.u8()
            value |= (byte & 127) << 7 * i
            if byte < 128:
                require(not (byte == 0 and i > 0) and value < 2**64)
                return value
        raise Refused

    def svarint(self) -> int:
        return unfold(self.uvarint())


def blake(data: bytes) -> bytes:
    return hashlib.blake2b(data, digest_size=16).digest()


# --- 10.4 to 10.6 models ----------------------------------------------------------------------------------


class Model:
    def __init__(self, cumulative: list[int]) -> None:
        self.cumulative = cumulative
        self.size = len(cumulative) - 1
        require(cumulative[0] == 0 and cumulative[-1] == 1 << 24)

    def frequencies(self) -> list[int]:
        return [b - a for a, b in zip(self.cumulative, self.cumulative[1:], strict=False)]


@cache
def uniform(size: int) -> Model:
    return Model([s * (2**24 // size) for s in range(size + 1)])


def from_weights(w: Row) -> Model:
    sums = [0, *accumulate(w)]
    return Model([c * (2**24 - len(w)) // sums[-1] + s for s, c in enumerate(sums)])


def from_cdf(c: Row) -> Model:
    size = len(c) - 1
    return Model([(c[s] * (2**24 - size) >> 32) + s for s in range(size)] + [2**24])


SPLIT_ALPHAS = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64, 96, 128, 256, 1024)
TWICE_REACH = (11, 16, 24)
# fmt: off
INVERSE_SIGMAS = (
    21137968, 18831788, 16777216, 14946800, 13316085, 11863283, 10568984, 9415894, 8388608, 7473400,
    6658043, 5931642, 5284492, 4707947, 4194304, 3736700, 3329021, 2965821, 2642246, 2353974, 2097152,
    1868350, 1664511, 1482910, 1321123, 1176987, 1048576, 934175, 832255, 741455, 660561, 588493, 524288,
    467088, 416128, 370728, 330281, 294247, 262144, 233544, 208064, 185364, 165140, 147123, 131072,
    116772, 104032, 92682, 82570, 73562, 65536, 58386, 52016, 46341, 41285, 36781, 32768, 29193, 26008,
    23170, 20643, 18390, 16384, 14596,
)
# fmt: on


@cache
def normal() -> Row:
    density = 0x662114CF50D942343F2CF1402EAE38BF
    ratio = 0xFFFFF800001FFFFFAAAAAB5555544444
    shrink = 0xFFFFF000007FFFFD55555FFFFFDDDDDE
    values, total = [2**31], 0
    for i in range(1, 9217):
        following = density * ratio >> 128
        ratio = ratio * shrink >> 128
        total += density + following
        values.append((2**127 + (total >> 11) + following * i // (12 * 1024**3) + 2**95) >> 96)
        density = following
    return values


@cache
def exponential() -> Row:
    values, tail = [], 2**127
    for _ in range(24577):
        values.append((2**128 - tail + 2**95) >> 96)
        tail = tail * 0xFFC007FF555FFF777D279E7B87ACECDF >> 128
    return values


def interpolate(master: Row, m: int) -> int:
    i = min(m >> 10, len(master) - 2)
    f = min(m - (i << 10), 1024)
    return master[i] + ((master[i + 1] - master[i]) * f >> 10)


def cdf(shape: int, scale: int, e: int) -> int:
    if scale < 0:
        m = (abs(e) * INVERSE_SIGMAS[scale + 6] >> 1) << 1
    elif scale > 63:
        m = (abs(e) * INVERSE_SIGMAS[scale - 6] >> 1) >> 1
    else:
        m = abs(e) * INVERSE_SIGMAS[scale] >> 1
    if shape == LAPLACE:
        m = m * 1482910 >> 20
    value = interpolate(exponential() if shape == LAPLACE else normal(), m)
    return value if e > 0 else 2**32 - value


@cache
def scale_model(shape: int, scale: int) -> Model:
    k = min(511, 2 + (TWICE_REACH[shape] << 19) // INVERSE_SIGMAS[scale])
    c = [0]
    for s in range(1, 2 * k + 1):
        e = 2 * (s - k) - 1
        if shape == HEAVY:
            c.append((cdf(LAPLACE, scale - 6, e) + cdf(LAPLACE, scale + 6, e)) >> 1)
        else:
            c.append(cdf(shape, scale, e))
    return from_cdf([*c, 2**32])


def split_scale(scale: int) -> tuple[int, int]:
    if scale < 64:
        return scale, 0
    return 58 + (scale - 64) % 6, (scale - 64) // 6 + 1


@cache
def split_model(bias: int, count: int) -> Model:
    a = SPLIT_ALPHAS[bias]
    rising = [1]
    for i in range(count):
        rising.append(rising[-1] * (a + 8 * i))
    w = [math.comb(count, k) * rising[k] * rising[count - k] for k in range(count + 1)]
    total = sum(w)
    return from_weights([(x << 30) // total for x in w])


# --- 10 range decoder and what is made of its symbols -----------------------------------------------------


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


# --- 9 geometry -------------------------------------------------------------------------------------------


def from_stereo(p: Row) -> Row:
    p = [clip(c, -(2**18), 2**18) for c in p]
    s = sum(c * c for c in p)
    d = 2**36 + s
    return [round_divide((2**36 - s) << 24, d)] + [round_divide(c << 43, d) for c in p]


def multiply(a: Row, b: Row) -> Row:
    w, x, y, z = a
    s, i, j, k = b
    return [
        round_shift(w * s - x * i - y * j - z * k, 24),
        round_shift(w * i + x * s + y * k - z * j, 24),
        round_shift(w * j - x * k + y * s + z * i, 24),
        round_shift(w * k + x * j - y * i + z * s, 24),
    ]


def normalise(a: Row) -> Row:
    length = max(math.isqrt(sum(c * c for c in a)), 1)
    return [round_divide(c << 24, length) for c in a]


def num_lods(n: int, most: int = 8) -> int:
    count = 0
    while count < most and n >> (count + 1) >= 32:
        count += 1
    return count


@dataclass
class Lods:
    """Levels of detail of `count` rows; distance weights with `positions`, else equal ones (9.2)."""

    count: int
    positions: Matrix | None = None
    most: int = 8
    _weights: dict[int, Row] = field(default_factory=dict)

    def finest(self, most: int) -> Lods:
        """17.3: of the levels only these count."""
        return replace(self, most=most)

    @property
    def base(self) -> range:
        return range(0, self.count, 2 ** num_lods(self.count, self.most))

    def levels(self) -> Iterator[tuple[range, Callable[[int], Row]]]:
        """The rows of each level, and a function that gives the neighbours of a row."""
        for lod in range(num_lods(self.count, self.most) - 1, -1, -1):
            step = 2 ** (lod + 1)
            last = (self.count - 1) // step

            def neighbours(row: int, lod: int = lod, step: int = step, last: int = last) -> Row:
                i = (row - 2**lod) // step
                return [clip(i + k - 3, 0, last) * step for k in range(8)]

            yield range(2**lod, self.count, step), neighbours

    def weights(self, row: int, neighbours: Row) -> Row:
        if self.positions is None:
            return [32] * 8
        if row not in self._weights:
            self._weights[row] = distance_weights(
                self.positions[row], [self.positions[n] for n in neighbours]
            )
        return self._weights[row]

    def statistics(self, row: int, neighbours: Row, values: Row) -> tuple[int, int]:
        weight = self.weights(row, neighbours)
        mean = sum(values[n] * w for n, w in zip(neighbours, weight, strict=True))
        middle = round_shift(mean, 8)
        return mean, sum(abs(values[n] - middle) * w for n, w in zip(neighbours, weight, strict=True))


def distance_weights(q: Row, neighbours: Matrix) -> Row:
    inverse = []
    for other in neighbours:
        d = [min(abs(a - b), 1 << 20) for a, b in zip(other, q, strict=True)]
        inverse.append(2**32 // (math.isqrt(sum(c * c for c in d)) + 1))
    total = sum(inverse)
    weight = [(x << 8) // total for x in inverse]
    weight[inverse.index(max(inverse))] += 256 - sum(weight)
    return weight


# --- 9.8, 11.2 columns -----------------------------------------------------------------------------------

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


# --- 11.1 position tree -----------------------------------------------------------------------------------


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


# --- 8 states ---------------------------------------------------------------------------------------------


@dataclass
class State:
    planes: dict[int, Matrix]
    order: Row | None = None
    verbatim: dict[int, Matrix] | None = None
    escapes: bytes = b""

    @property
    def positions(self) -> Matrix:
        return self.planes[POSITION]

    def hash(self) -> bytes:
        """8.5."""
        data = b"".join(digest(self.planes[a]) for a in sorted(self.planes))
        if self.order is not None:
            data += digest([[place] for place in self.order])
        for patterns in (self.verbatim or {}).values():
            data += b"".join(struct.pack(f"<{len(row)}I", *row) for row in patterns)
        return blake(data + self.escapes)


def digest(plane: Matrix) -> bytes:
    return blake(b"".join(struct.pack(f"<{len(row)}i", *row) for row in plane))


def permutation(stream: RangeDecoder, lods: Lods) -> Row:
    value, _ = column(stream, lods, [], [])
    require(sorted(value) == list(range(lods.count)))
    return value


def transposed(columns: Matrix) -> Matrix:
    return [list(row) for row in zip(*columns, strict=True)]


def axis_flip(q: Row, f: int) -> Row:
    """9.4."""
    w, x, y, z = q
    return [[w, x, y, z], [-x, w, z, -y], [-y, -z, w, x], [-z, y, -x, w]][f]


def scaled(symbols: Matrix, step: int) -> Matrix:
    """9.3: symbols of all attributes keep a limit, ROTATION included."""
    require(all(abs(value) <= 2 * STATE_LIMIT // step for row in symbols for value in row))
    return [[value * step for value in row] for row in symbols]


def in_range(plane: Matrix) -> Matrix:
    require(all(abs(value) <= STATE_LIMIT for row in plane for value in row))
    return plane


@dataclass
class IntraHeader:
    """What section 5 says of coded Gaussians, section 6.2 of births."""

    grid: SortGrid
    steps: dict[int, int]
    coarse_log2: int
    levels: dict[int, int]
    thin_octaves: int
    alternating: int

    @property
    def num_streams(self) -> int:
        return len(self.steps) + 2


class Intra(NamedTuple):
    """Gaussians of an I-frame, or births; `anchors` are those of 9.2, `cover` the cover classes."""

    state: State
    anchors: Matrix
    cover: Row


# --- 12 P-frames ------------------------------------------------------------------------------------------


@dataclass
class Activity:
    symbols: Matrix
    density: Row
    magnitude: Row
    #: 12.1, of each Gaussian: `running`, then `memory` of each column
    memory: Matrix

    def of(self, change: Callable[[Matrix], Matrix], num_blocks: int) -> Activity:
        """15.2, 15.4: of other Gaussians; classes become 0."""
        return Activity(change(self.symbols), [0] * num_blocks, [0] * num_blocks, change(self.memory))


def num_blocks(n: int) -> int:
    return -(-n >> 6)


def remember(memory: Row, symbols: Row) -> Row:
    """12.1: `running` and `memory` of a Gaussian, from those before."""
    running = memory[0] - (memory[0] >> 2) + (min(size(symbols), 2**20) << 2)
    faded = [m - 16 * s for m, s in zip(memory[1:], symbols, strict=True)]
    return [running, *(m - (m >> 2) for m in faded)]


def magnitudes(stream: RangeDecoder, model: PriorModel, density: Row, before: Row) -> Row:
    """12.2."""
    blocks = [b for b, d in enumerate(density) if d > 0]
    magnitude = [0] * len(density)
    if blocks:
        contexts = [density[b] + (4 if before[b] > 0 else 0) for b in blocks]
        for b, r in zip(blocks, stream.residuals(contexts, model.magnitudes), strict=True):
            magnitude[b] = clip(before[b] + r, 0, 23)
    return magnitude


def inter_attribute(stream: RangeDecoder, gof: Lods, density_beside: Row, prior: Prior) -> Activity:
    """12."""
    before, model = prior.before, prior.model
    contexts = [4 * d + e for d, e in zip(before.density, density_beside, strict=True)]
    density = stream.grouped(contexts, model.densities)
    magnitude = magnitudes(stream, model, density, before.magnitude)
    n, num_columns = len(before.symbols), len(before.symbols[0])
    block = [i >> 6 for i in range(n)]
    densities = [density[b] for b in block]
    classes = [(before.density[b], density[b], magnitude[b]) for b in block]
    inputs = [prior.common(i, classes[i]) if densities[i] else [] for i in range(n)]
    rows = coded_rows(stream, model, gof, densities, inputs)
    lods = gof if len(rows) == n else Lods(len(rows))
    flagged = [densities[i] != 3 for i in rows]
    old = Activity([before.symbols[i] for i in rows], [], [], [before.memory[i] for i in rows])
    columns = columns_of(stream, model, lods, old, ([inputs[i] for i in rows], flagged))
    symbols = [[0] * num_columns for _ in range(n)]
    for j, i in enumerate(rows):
        symbols[i] = [column[j] for column in columns]
    memory = [remember(m, row) for m, row in zip(before.memory, symbols, strict=True)]
    return Activity(symbols, density, magnitude, memory)


# --- 9.5 steps that follow visibility ---------------------------------------------------------------------

OCTAVES_PER_LOG = 23637
# fmt: off
ALPHA_WEIGHTS = (
    -364, -352, -341, -329, -317, -306, -294, -283, -271, -260, -248, -237, -225, -214, -203, -191,
    -180, -169, -157, -146, -135, -124, -114, -103, -93, -83, -74, -65, -56, -49, -41, -35,
    -29, -24, -20, -16, -13, -10, -8, -7, -5, -4, -3, -3, -2, -2, -1, -1,
    -1, -1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0,
)
ROUNDNESS_WEIGHTS = (-81, -30, -5, 12, 25, 37, 47, 56, 66, 74, 83, 91, 99, 108, 116, 124)
MULTIPLIERS = (
    256, 304, 362, 431, 512, 609, 724, 861, 1024, 1218, 1448, 1722, 2048, 2435, 2896, 3444, 4096,
)
# fmt: on


COVER_WEIGHT, MAX_COARSENESS = 16, 16


def octaves_of(s: Row, exponents: dict[int, int]) -> Row:
    """Of each axis, in sixteenths."""
    shift = clip(10 - exponents[SCALE], 0, 63)
    return [(OCTAVES_PER_LOG * c) >> shift for c in s]


def alpha_weight(o: int, exponents: dict[int, int]) -> int:
    quarter = expand(o, exponents[OPACITY]) >> (-2 - exponents[OPACITY])
    return ALPHA_WEIGHTS[clip(quarter + 32, 0, 63)]


def roundness(r: int) -> int:
    return ROUNDNESS_WEIGHTS[max(r, 0) >> 2] if max(r, 0) >> 2 < 16 else 2 * r


def visibility_weight(attribute: int, s: Row, o: int, exponents: dict[int, int]) -> int:
    """Of a Gaussian, from its SCALE and OPACITY; less what its cover class takes."""
    _, middle, longest = sorted(octaves_of(s, exponents))
    alpha, area = alpha_weight(o, exponents), longest + middle
    if attribute == POSITION:
        return alpha
    if attribute == OPACITY:
        return area
    return alpha + area + (roundness(longest - middle) if attribute == ROTATION else 0)


def coarser(changes: Matrix, multipliers: Row) -> Matrix:
    """Of each Gaussian's changes, with its multiplier."""
    return [
        [round_shift(change * multiplier, 8) for change in row]
        for row, multiplier in zip(changes, multipliers, strict=True)
    ]


@dataclass
class Steps:
    """The steps of a P-frame, and its `visibility_level` of each attribute if it has the tool VISIBILITY."""

    steps: dict[int, int]
    levels: dict[int, int]
    exponents: dict[int, int]
    cover: Row

    def coarseness(self, attribute: int, reference: State) -> Row:
        """9.5: of each Gaussian, in quarter octaves; 0 without the tool."""
        if attribute not in self.levels:
            return [0] * len(reference.positions)
        level, coarseness = self.levels[attribute], []
        for s, (o,), c in zip(reference.planes[SCALE], reference.planes[OPACITY], self.cover, strict=True):
            weight = visibility_weight(attribute, s, o, self.exponents) - COVER_WEIGHT * c
            coarseness.append(clip((level - weight) >> 3, 0, MAX_COARSENESS))
        return coarseness

    def changes(self, attribute: int, symbols: Matrix, reference: State) -> Matrix:
        """9.3 and 9.4: what symbols are worth."""
        changes = scaled(symbols, self.steps[attribute])
        return coarser(changes, [MULTIPLIERS[c] for c in self.coarseness(attribute, reference)])


def reconstruct_inter(activity: dict[int, Activity], steps: Steps, reference: State) -> State:
    """9.3; SCALE and OPACITY of the predicted frame are those of the reference frame (9.5)."""
    if not activity:
        return reference
    planes = dict(reference.planes)
    for attribute, found in activity.items():
        plane, changes = planes[attribute], steps.changes(attribute, found.symbols, reference)
        if attribute == ROTATION:
            planes[attribute] = [
                normalise(multiply(q, from_stereo(change))) if any(r) else q
                for q, r, change in zip(plane, found.symbols, changes, strict=True)
            ]
        else:
            planes[attribute] = in_range(
                [[a + b for a, b in zip(*rows, strict=True)] for rows in zip(plane, changes, strict=True)]
            )
    return State(planes, reference.order)


# --- 9.6, 11.4, 11.5 coded I-frames -----------------------------------------------------------------------

MAX_COVER, MAX_TURN_WEIGHT, SPIN_WEIGHT, MAX_TURN_STEP = 15, 64, 16, 2**16


class Look(NamedTuple):
    """9.6: what weights of a Gaussian are made from."""

    alpha: int
    area: int
    hidden: int
    is_needle: bool
    long: int
    flat: int

    @property
    def seen(self) -> int:
        return ((self.alpha + self.area) >> 1) - self.hidden


def look_of(s: Row, o: int, c: int, exponents: dict[int, int]) -> Look:
    axis = octaves_of(s, exponents)
    is_needle = axis[0] - axis[1] > axis[1] - axis[2]
    long = roundness(axis[0] - axis[1])
    flat = min(roundness(axis[1] - axis[2] if is_needle else axis[0] - axis[2]), MAX_TURN_WEIGHT)
    area = sum(axis) - min(axis)
    return Look(alpha_weight(o, exponents), area, COVER_WEIGHT * c, is_needle, long, flat)


def step_of(header: IntraHeader, attribute: int, weight: int) -> int:
    multiplier = MULTIPLIERS[clip((header.levels[attribute] - weight) >> 3, 0, MAX_COARSENESS)]
    return round_shift(header.steps[attribute] * multiplier, 8)


def is_alternating(header: IntraHeader, attribute: int) -> bool:
    return bool(header.alternating >> attribute & 1)


def dot(a: Row, b: Row) -> int:
    return sum(map(operator.mul, a, b))


def axes_of(q: Row) -> Matrix:
    """11.5."""

    def t(v: int) -> int:
        return round_shift(v, 32)

    w, x, y, z = q
    return [
        [32768 - t(y * y + z * z), t(x * y + w * z), t(x * z - w * y)],
        [t(x * y - w * z), 32768 - t(x * x + z * z), t(y * z + w * x)],
        [t(x * z + w * y), t(y * z - w * x), 32768 - t(x * x + y * y)],
    ]


class Expected(NamedTuple):
    """11.5: `frame`, `tilt_expected` and `spin_expected` of a row; the base has but the first."""

    frame: Row
    tilt: int | None
    spin: int | None


def expected_turn(is_needle: bool, axes: list[Matrix], weight: Row) -> Expected:
    """11.5, from the neighbours' axes and weights."""
    nearest = weight.index(max(weight))

    def line(a: int) -> Row:
        total = [0] * 3
        for own, w in zip(axes, weight, strict=True):
            signed = -w if dot(own[a], axes[nearest][a]) < 0 else w
            total = [t + c * signed for t, c in zip(total, own[a], strict=True)]
        return total

    p = 0 if is_needle else 2
    total = line(p)
    length = math.isqrt(dot(total, total))
    pole = [32768 if c == p else 0 for c in range(3)]
    if length > 0:
        pole = [round_divide(c << 15, length) for c in total]
    if pole[p] < 0:
        pole = [-c for c in pole]
    near = sum(abs(dot(own[p], pole)) * w for own, w in zip(axes, weight, strict=True))
    tilt_expected = max(2**38 - near, 0) >> 2

    x, y, z = pole
    if is_needle:
        tilted = normalise([(32768 + x) << 9, 0, -z << 9, y << 9])
    else:
        tilted = normalise([(32768 + z) << 9, -y << 9, x << 9, 0])
    m, turned = [c >> 8 for c in line(1)], axes_of(tilted)
    along = dot(m, turned[1]) >> 15
    across = dot(m, turned[2]) >> 15 if is_needle else -dot(m, turned[0]) >> 15
    if along < 0:
        along, across = -along, -across
    length = math.isqrt(along * along + across * across)
    w = (length + along if length > 0 else 32768) << 9
    spun = normalise([w, across << 9, 0, 0] if is_needle else [w, 0, 0, across << 9])
    return Expected(normalise(multiply(tilted, spun)), tilt_expected, max(32768 - length, 0) << 21)


def turn_context(is_needle: bool, expected: int | None, step: int) -> int:
    """11.5; nothing is expected in the base."""
    first = 32 if is_needle else 0
    if expected is None:
        return first + 31
    square = (expected << 5 >> 3) // (step * step)
    return first + min((ladder(square, 64) + 1) >> 1, 30)


def turned_by(frame: Row, is_needle: bool, turn: Row) -> Row:
    """11.5, with what two tilts and the spin are worth."""
    t0, t1, s = turn
    tilt = from_stereo([0, t0, t1] if is_needle else [t0, t1, 0])
    spin = from_stereo([s, 0, 0] if is_needle else [0, 0, s])
    return normalise(multiply(multiply(frame, tilt), spin))


def turns(
    stream: RangeDecoder, lods: Lods, is_needle: list[bool], steps: tuple[ColumnSteps, ColumnSteps]
) -> Matrix:
    """11.5: quaternions; `steps` are those of tilts and of spins."""
    tilt_tables, spin_tables = stream.read_tables(64), stream.read_tables(64)
    flip_models = stream.read_histograms([0], 4) if stream.decode(uniform(2)) else None
    tilts, spins = steps
    quaternion: Matrix = [[] for _ in range(lods.count)]
    axes: list[Matrix] = [[] for _ in range(lods.count)]

    def code_pass(rows: range, expected: list[Expected]) -> None:
        c = [turn_context(is_needle[i], e.tilt, tilts.step[i]) for i, e in zip(rows, expected, strict=True)]
        d = [turn_context(is_needle[i], e.spin, spins.step[i]) for i, e in zip(rows, expected, strict=True)]
        # 9.8: the tilts, first and second, are one pass, the spins another
        tilt = tilts.worth([*rows, *rows], stream.residuals(c + c, tilt_tables))
        spin = spins.worth(list(rows), stream.residuals(d, spin_tables))
        flips = [0] * len(rows) if flip_models is None else stream.grouped([0] * len(rows), flip_models)
        first, second = tilt[: len(rows)], tilt[len(rows) :]
        for i, e, *turn in zip(rows, expected, first, second, spin, strict=True):
            quaternion[i] = turned_by(e.frame, is_needle[i], turn)
            axes[i] = axes_of(quaternion[i])
        for i, f in zip(rows, flips, strict=True):
            quaternion[i] = axis_flip(quaternion[i], f)

    code_pass(lods.base, [Expected([2**24, 0, 0, 0], None, None)] * len(lods.base))
    for rows, neighbours in lods.levels():
        expected = []
        for i in rows:
            near = neighbours(i)
            expected.append(expected_turn(is_needle[i], [axes[j] for j in near], lods.weights(i, near)))
        code_pass(rows, expected)
    return quaternion


def position_bits(stream: RangeDecoder, index: Matrix, octaves: Row, coarse_log2: int) -> Matrix:
    """11.4."""
    index = [list(row) for row in index]
    for n in range(1, coarse_log2 + 1):
        rows = [i for i, o in enumerate(octaves) if o == coarse_log2 - n]
        low = stream.bits(n, 3 * len(rows))
        for j, i in enumerate(rows):
            index[i] = [index[i][axis] << n | low[3 * j + axis] for axis in range(3)]
    return index


def coded_intra(
    streams: Iterator[RangeDecoder],
    n: int,
    header: IntraHeader,
    coding: tuple[dict[int, int], bool],
) -> Intra:
    """11.4; `coding` is the exponents and `has_permutation`."""
    exponents, has_permutation = coding
    coarse_log2, position_step = header.coarse_log2, header.steps[POSITION]
    limit = 2 * STATE_LIMIT // position_step
    coarse = position_tree(next(streams), n, header.grid)
    require(all(abs(c) <= limit for row in coarse for c in row))
    lods = Lods(n, coarse)
    order = permutation(next(streams), lods) if has_permutation else None
    cover, _ = column(next(streams), lods, [], [])
    require(all(0 <= c <= MAX_COVER for c in cover))

    def columns(attribute: int, residuals: Matrix, step: Row) -> Matrix:
        stream, values = next(streams), []
        for c in range(COLUMNS[attribute]):
            is_thin = attribute == SCALE and c == 2 and header.thin_octaves > 0
            alternates = is_alternating(header, attribute)
            sources = [[abs(r) for r in residual] for residual in residuals]
            steps = ColumnSteps(step, alternates and not is_thin, not alternates)
            value, residual = column(stream, lods, residuals, sources, steps)
            values.append(value)
            residuals.append(residual)
        return transposed(values)

    planes: dict[int, Matrix] = {POSITION: []}
    coded = columns(SCALE, [], [step_of(header, SCALE, -COVER_WEIGHT * c) for c in cover])
    planes[SCALE] = in_range([thin_axis(row, header.thin_octaves, exponents[SCALE]) for row in coded])
    # alpha plays no part in the steps of OPACITY
    looks = [look_of(s, 0, c, exponents) for s, c in zip(planes[SCALE], cover, strict=True)]
    steps = [step_of(header, OPACITY, (look.area >> 1) - look.hidden) for look in looks]
    planes[OPACITY] = columns(OPACITY, [], steps)
    looks = [
        look_of(s, o, c, exponents) for s, (o,), c in zip(planes[SCALE], planes[OPACITY], cover, strict=True)
    ]
    level = header.levels[POSITION]
    octaves = [clip((level - ((look.alpha >> 1) - look.hidden)) >> 5, 0, coarse_log2) for look in looks]
    index = position_bits(next(streams), coarse, octaves, coarse_log2)
    require(all(abs(c) <= limit for row in index for c in row))
    planes[POSITION] = in_range(
        [
            [(c * position_step << o) + (((1 << o) - 1) * position_step >> 1) for c in row]
            for row, o in zip(index, octaves, strict=True)
        ]
    )
    planes[ROTATION] = turns(next(streams), lods, [k.is_needle for k in looks], turn_steps(header, looks))
    residuals: Matrix = []
    for attribute in sorted(header.steps)[SH_DC:]:
        steps = [step_of(header, attribute, look.seen) for look in looks]
        planes[attribute] = columns(attribute, residuals, steps)
    anchors = [[round_divide(c, position_step) for c in row] for row in planes[POSITION]]
    return Intra(State(planes, order), anchors, cover)


def turn_steps(header: IntraHeader, looks: list[Look]) -> tuple[ColumnSteps, ColumnSteps]:
    """9.6: of tilts and of spins."""
    tilts, spins = [], []
    for look in looks:
        tilt, spin = (look.long, look.flat) if look.is_needle else (look.flat, look.long)
        tilts.append(min(step_of(header, ROTATION, look.seen + tilt), MAX_TURN_STEP))
        spins.append(min(step_of(header, ROTATION, look.seen + spin - SPIN_WEIGHT), MAX_TURN_STEP))
    alternates = is_alternating(header, ROTATION)
    return ColumnSteps(tilts, alternates), ColumnSteps(spins, alternates)


# --- 13 verbatim I-frames ---------------------------------------------------------------------------------


def float_column(stream: RangeDecoder, n: int) -> Row:
    """Bit patterns."""
    pattern, contexts = [0] * n, [0] * n
    for shift in (24, 16, 8, 0):
        if stream.decode(uniform(2)) == 0:
            plane = stream.bits(8, n)
        else:
            plane = stream.grouped(contexts, stream.read_histograms(occurring(contexts), 256))
        pattern = [p | byte << shift for p, byte in zip(pattern, plane, strict=True)]
        contexts = [0] * n
        if shift == 24:
            center = stream.decode(uniform(256))
            contexts = [clip((byte & 127) - center, -4, 3) + 4 for byte in plane]
    return pattern


def float_of(pattern: int) -> float:
    value: float = struct.unpack("<f", struct.pack("<I", pattern))[0]
    return value


def to_grid(value: float, exponent: int, origin: int = 0) -> int:
    if math.isnan(value):
        return 0
    if math.isinf(value):
        return STATE_LIMIT if value > 0 else -STATE_LIMIT
    # Python's round goes to even; scaling by a power of two is exact in binary64
    return clip(round(math.ldexp(value, -exponent)) - origin, -STATE_LIMIT, STATE_LIMIT)


KNOTS = (28, 42, 54, 66, 77, 88, 99)
THIN_OCTAVE = 11


def opacity_knots(e: int) -> tuple[Row, Row]:
    """8.3."""
    logit_knots, companded_knots = [0], [0]
    for i in range(1, 8):
        logit_knots.append(KNOTS[i - 1] << (-4 - e))
        companded_knots.append(companded_knots[-1] + ((logit_knots[i] - logit_knots[i - 1]) >> (i - 1)))
    return logit_knots, companded_knots


def compress(v: int, e: int) -> int:
    logit_knots, companded_knots = opacity_knots(e)
    zone = sum(knot <= abs(v) for knot in logit_knots[1:])
    half = (1 << zone) >> 1
    return sign(v) * (companded_knots[zone] + ((abs(v) - logit_knots[zone] + half) >> zone))


def expand(c: int, e: int) -> int:
    logit_knots, companded_knots = opacity_knots(e)
    zone = sum(knot <= abs(c) for knot in companded_knots[1:])
    return sign(c) * (logit_knots[zone] + ((abs(c) - companded_knots[zone]) << zone))


def expand_thinness(c: int, octaves: int, e: int) -> int:
    """9.7."""
    thin_knots = [i * (THIN_OCTAVE << (-4 - e)) for i in range(octaves + 1)]
    flat_knots = [0]
    for i in range(1, octaves + 1):
        flat_knots.append(flat_knots[i - 1] + (thin_knots[1] >> (i - 1)))
    zone = sum(knot <= abs(c) for knot in flat_knots[1:])
    return sign(c) * (thin_knots[zone] + ((abs(c) - flat_knots[zone]) << zone))


def thin_axis(row: Row, octaves: int, e: int) -> Row:
    """9.7: the scales of a Gaussian from the values of its columns."""
    if not octaves:
        return row
    return [row[0], row[1], row[1] - expand_thinness(row[2], octaves, e)]


def float_quaternion(row: list[float]) -> Row:
    if not all(map(math.isfinite, row)) or not any(row):
        return [1 << 24, 0, 0, 0]
    exponent = math.frexp(max(abs(c) for c in row))[1]
    return normalise([round(math.ldexp(c, 24 - exponent)) for c in row])


def verbatim_state(patterns: dict[int, Matrix], exponents: dict[int, int], origin: Row) -> dict[int, Matrix]:
    planes = {}
    for attribute, rows in patterns.items():
        values = [[float_of(p) for p in row] for row in rows]
        e = exponents[min(attribute, SH_DC)]
        if attribute == ROTATION:
            planes[attribute] = [float_quaternion(row) for row in values]
        elif attribute == POSITION:
            planes[attribute] = [
                [to_grid(v, e, o) for v, o in zip(row, origin, strict=True)] for row in values
            ]
        elif attribute == OPACITY:
            planes[attribute] = [[compress(to_grid(row[0], e), e)] for row in values]
        else:
            planes[attribute] = [[to_grid(value, e) for value in row] for row in values]
    return planes


def verbatim_intra(
    streams: Iterator[RangeDecoder], n: int, sequence: Sequence, has_permutation: bool
) -> State:
    attributes = sequence.attributes
    patterns: dict[int, Matrix] = {}
    order = None
    for attribute in attributes:
        stream = next(streams)
        patterns[attribute] = transposed([float_column(stream, n) for _ in range(COLUMNS[attribute])])
        if attribute == POSITION and has_permutation:
            order = permutation(next(streams), Lods(n))
    return State(verbatim_state(patterns, sequence.exponents, sequence.origin), order, patterns)


# --- 14 motion --------------------------------------------------------------------------------------------


@dataclass
class ControlHeader:
    """What section 5 says of control points."""

    spacing: int
    shift: int


@dataclass
class Gathered:
    """A point with the control points that it gathers from (14.2) and what it has learnt (14.6)."""

    rank: Row
    weight: Row
    effort: Row = field(default_factory=lambda: [0] * 5)
    choice: int = 0

    def candidates(self, each: Matrix) -> Matrix:
        """The blend, then what each of the control points gives."""
        columns = transposed(each)
        blend = [round_shift(sum(w * x for w, x in zip(self.weight, c, strict=True)), 12) for c in columns]
        return [blend, *each]

    def learn(self, actual: Row, displacements: Matrix, translation_step: int) -> None:
        for j in range(5):
            error = sum(abs(d - a) for d, a in zip(displacements[j], actual, strict=True))
            kind = ladder(error // (4 * translation_step), 64)
            self.effort[j] += 16 * kind - (self.effort[j] >> 2)
        judged = [self.effort[0] - 16, *self.effort[1:]]
        self.choice = judged.index(min(judged))


@dataclass
class MotionSymbols:
    """14.3: a mode for each block, who follows, six symbols of each control point."""

    mode: Row
    follows: list[bool]
    symbols: Matrix


def squared_distance(a: Row, b: Row) -> int:
    return sum((x - y) ** 2 for x, y in zip(a, b, strict=True))


def farthest(cells: Matrix, wanted: int) -> Row:
    chosen = [0]
    distance = [squared_distance(cell, cells[0]) for cell in cells]
    while len(chosen) < wanted and max(distance) > 0:
        chosen.append(distance.index(max(distance)))
        latest = cells[chosen[-1]]
        distance = [min(d, squared_distance(c, latest)) for d, c in zip(distance, cells, strict=True)]
    return chosen


def gather(cell: Row, others: Matrix) -> Gathered:
    squared = [squared_distance(cell, other) for other in others]
    count, asked = min(4, len(others)), min(5, len(others))
    rank = sorted(range(len(others)), key=lambda j: (squared[j], j))[:asked]
    distance = [math.isqrt(squared[j]) for j in rank]
    edge = max(distance[asked - 1] if asked > count else 2 * distance[asked - 1], 1)
    square = [(2**10 - (distance[k] << 10) // edge) ** 2 for k in range(count)]
    total = max(sum(square), 1)
    weight = [(s << 12) // total for s in square] + [0] * (4 - count)
    weight[0] += 2**12 - sum(weight)
    return Gathered(rank[:count] + [rank[0]] * (4 - count), weight)


def matrix(v: Row) -> Matrix:
    w, x, y, z = from_stereo(v)
    m = [
        [-(y * y + z * z), x * y - w * z, x * z + w * y],
        [x * y + w * z, -(x * x + z * z), y * z - w * x],
        [x * z - w * y, y * z + w * x, -(x * x + y * y)],
    ]
    return [[round_shift(e, 27) for e in row] for row in m]


class MotionField:
    """Control points of a GoF, and the Gaussians bound to them."""

    def __init__(self, positions: Matrix, control: ControlHeader, prior: PriorModel | None) -> None:
        n = len(positions)
        self.prior = prior
        self.middle, self.shift = positions[n // 2], control.shift
        cells = [self.cell(p) for p in positions]
        self.gaussian = farthest(cells, min(max(1, n // control.spacing), 16384))
        count = len(self.gaussian)
        own_cells = [cells[i] for i in self.gaussian]
        self.cells = cells
        self.points = [gather(cell, own_cells) for cell in cells]
        self.pivot = [list(positions[i]) for i in self.gaussian]
        # 14.1: levels begin at 0, 1, 4, 16, ...; those of the first gather from none
        starts = [0, *(4**level for level in range(count) if 4**level < count)]
        self.binding: list[Gathered | None] = []
        #: the level of each control point, and where it ends
        self.levels: list[tuple[int, int]] = []
        for level, (start, stop) in enumerate(zip(starts, [*starts[1:], count], strict=True)):
            for cell in own_cells[start:stop]:
                self.levels.append((level, stop))
                self.binding.append(gather(cell, own_cells[:start]) if start > 0 else None)
        self.habit_t, self.habit_v = zeros(count), zeros(count)
        self.t, self.v, self.matrices = zeros(count), zeros(count), [zeros(3)] * count
        self.translation_step = 1
        self.last = MotionSymbols([], [False] * n, [[0] * 6 for _ in range(count)])

    def cell(self, position: Row) -> Row:
        return [
            clip((a - b) >> self.shift, -(2**20), 2**20) for a, b in zip(position, self.middle, strict=True)
        ]

    def keep(self, kept: Row) -> None:
        """15.2."""
        self.cells = [self.cells[i] for i in kept]
        self.points = [self.points[i] for i in kept]
        self.last = replace(self.last, mode=[], follows=[self.last.follows[i] for i in kept])

    def insert(self, births: Matrix, rows: list[Place]) -> None:
        """15.4, from the positions of births."""
        cells = [self.cell(position) for position in births]
        own_cells = [self.cell(pivot) for pivot in self.pivot]
        self.points = merged(rows, self.points, [gather(cell, own_cells) for cell in cells])
        self.cells = merged(rows, self.cells, cells)
        follows = merged(rows, self.last.follows, [False] * len(births))
        self.last = replace(self.last, mode=[], follows=follows)

    def decode(self, fields: Fields) -> MotionSymbols:
        """6.3, 14.3; moves the control points."""
        steps = (fields.uvarint(), fields.uvarint())
        require(1 <= steps[0] <= STATE_LIMIT and steps[1] <= 2**18)
        streams = open_streams(fields, 2)
        mode, follows = self._followers(next(streams))
        symbols = self._symbols(next(streams), steps)
        require(next(streams, None) is None)
        self.last = MotionSymbols(mode, follows, symbols)
        self._move(symbols, steps)
        return self.last

    def _followers(self, stream: RangeDecoder) -> tuple[Row, list[bool]]:
        n = len(self.points)
        before, followed = self.last.mode, self.last.follows
        if len(before) != num_blocks(n):
            before = [0] * num_blocks(n)
        mode = stream.grouped(before, stream.read_histograms(occurring(before), 3))
        follows = [mode[i >> 6] == 1 for i in range(n)]
        rows = [i for i in range(n) if mode[i >> 6] == 2]
        if rows:
            contexts = [int(followed[i]) for i in rows]
            flags = stream.grouped(contexts, stream.read_histograms(occurring(contexts), 2))
            for i, flag in zip(rows, flags, strict=True):
                follows[i] = flag == 1
        return mode, follows

    def _symbols(self, stream: RangeDecoder, steps: tuple[int, int]) -> Matrix:
        """14.3."""
        rows = sorted(range(len(self.pivot)), key=lambda k: self.gaussian[k])
        symbols = [[0] * 6 for _ in self.pivot]
        num_columns = 6 if steps[1] > 0 else 3
        columns = self._columns(stream, rows, (num_columns, steps))
        for c, column in enumerate(columns):
            for k, s in zip(rows, column, strict=True):
                require(abs(s) <= 2 * STATE_LIMIT // steps[min(c // 3, 1)])
                symbols[k][c] = s
        return symbols

    def _columns(self, stream: RangeDecoder, rows: Row, coding: tuple[int, tuple[int, int]]) -> Iterator[Row]:
        """14.3; `coding` is the number of columns and the steps."""
        num_columns, steps = coding
        model = self.prior
        assert model is not None
        habits = [self._habit(k, steps) for k in rows]
        inputs = [self._prior_inputs(k, habit) for k, habit in zip(rows, habits, strict=True)]
        columns: Matrix = []
        residuals: Matrix = []
        for c in range(num_columns):
            before = [self.last.symbols[k][c] for k in rows]
            weights = model.control_weights[c]
            column = PriorColumn(
                "control",
                [*weights[: 1 + c], *weights[-2:]],
                [
                    *([16 * r for r in residual] for residual in residuals),
                    [16 * s for s in before],
                    [habit[c] for habit in habits],
                ],
                inputs,
                [0] * len(rows),
                [
                    column_inputs(s, [column[j] for column in columns], 64 if c >= 3 else 0)
                    for j, s in enumerate(before)
                ],
            )
            value, residual = prior_column(stream, model, Lods(len(rows)), column)
            yield value
            columns.append(value)
            residuals.append(residual)

    def _habit(self, k: int, steps: tuple[int, int]) -> Row:
        """14.3: the expected change in six columns."""
        turns = [16 * h // steps[1] if steps[1] > 0 else 0 for h in self.habit_v[k]]
        return [*(16 * h // steps[0] for h in self.habit_t[k]), *turns]

    def _prior_inputs(self, k: int, habit: Row) -> Row:
        """14.3: x."""
        level, stop = self.levels[k]
        x = [16 * level, log(size(self.last.symbols[k])), log(size(habit))]
        point = self.binding[k]
        if point is None:
            x += [0, 0]
        else:
            efforts = [effort >> 4 for effort in point.effort]
            x += [efforts[point.choice], max(efforts) - min(efforts)]
        x.append(64 if stop == len(self.pivot) else 0)
        return [min(value, 255) for value in x]

    def _displace(self, k: int, x: Row) -> Row:
        offset = [a - b for a, b in zip(x, self.pivot[k], strict=True)]
        return [
            self.t[k][a]
            + round_shift(sum(e * o for e, o in zip(self.matrices[k][a], offset, strict=True)), 20)
            for a in range(3)
        ]

    def displacements(self, point: Gathered, x: Row) -> Matrix:
        return point.candidates([self._displace(k, x) for k in point.rank])

    def turns(self, point: Gathered) -> Matrix:
        return point.candidates([self.v[k] for k in point.rank])

    def _move(self, symbols: Matrix, steps: tuple[int, int]) -> None:
        """14.4."""
        self.translation_step, turn_step = steps
        for k, point in enumerate(self.binding):
            t, v = [0] * 3, [0] * 3
            if point is not None:
                t = self.displacements(point, self.pivot[k])[point.choice]
                v = self.turns(point)[point.choice]
            s, limit = symbols[k], 2 * STATE_LIMIT
            self.t[k] = [clip(t[a] + s[a] * self.translation_step, -limit, limit) for a in range(3)]
            self.v[k] = [0] * 3
            if turn_step > 0:
                self.v[k] = [clip(v[a] + s[3 + a] * turn_step, -(2**18), 2**18) for a in range(3)]
            self.matrices[k] = matrix(self.v[k])

    def carry(self, reference: State, follows: list[bool]) -> State:
        """14.5."""
        planes = dict(reference.planes)
        positions, rotations = list(planes[POSITION]), list(planes[ROTATION])
        for i, point in enumerate(self.points):
            if not follows[i]:
                continue
            displacement = self.displacements(point, positions[i])[point.choice]
            positions[i] = [
                clip(x + d, -STATE_LIMIT, STATE_LIMIT)
                for x, d in zip(positions[i], displacement, strict=True)
            ]
            turn = self.turns(point)[point.choice]
            if any(turn):
                rotations[i] = normalise(multiply(from_stereo(turn), rotations[i]))
        planes[POSITION], planes[ROTATION] = positions, rotations
        return State(planes, reference.order)

    def learn(self, reference: Matrix, decoded: Matrix) -> None:
        """14.6, from positions."""
        for i, point in enumerate(self.points):
            if self.last.follows[i]:
                actual = [a - b for a, b in zip(decoded[i], reference[i], strict=True)]
                point.learn(actual, self.displacements(point, reference[i]), self.translation_step)
        # pivots move when all control points have learnt: displacements are those of this frame
        for k, own in enumerate(self.binding):
            self.habit_t[k], self.habit_v[k] = self.t[k], self.v[k]
            if own is not None:
                displacements = self.displacements(own, self.pivot[k])
                own.learn(self.t[k], displacements, self.translation_step)
                chosen_t, chosen_v = displacements[own.choice], self.turns(own)[own.choice]
                self.habit_t[k] = [a - b for a, b in zip(self.t[k], chosen_t, strict=True)]
                self.habit_v[k] = [a - b for a, b in zip(self.v[k], chosen_v, strict=True)]
        self.pivot = [
            [clip(x + d, -STATE_LIMIT, STATE_LIMIT) for x, d in zip(*pair, strict=True)]
            for pair in zip(self.pivot, self.t, strict=True)
        ]


def zeros(count: int) -> Matrix:
    return [[0] * 3 for _ in range(count)]


# --- 15 topology ------------------------------------------------------------------------------------------


@dataclass
class Place:
    """Where a row of a frame comes from: the `index`-th survivor or birth."""

    is_birth: bool
    index: int


@dataclass
class Topology:
    """What a TOPOLOGY chunk says; `places` less those that are expected."""

    kept: Row
    births: Intra | None
    places: Row | None


def merged(rows: list[Place], survivors: list[T], births: list[T]) -> list[T]:
    return [(births if row.is_birth else survivors)[row.index] for row in rows]


def cell_key(cell: Row) -> int:
    """15.3."""
    x, y, z = (min(c + 2**20, 2**21 - 1) for c in cell)
    return sum(
        (x >> b & 1) << (3 * b + 2) | (y >> b & 1) << (3 * b + 1) | (z >> b & 1) << 3 * b for b in range(21)
    )


def interleaved(survivors: Matrix, births: Matrix) -> list[Place]:
    """15.3, from cells."""
    rising = accumulate((cell_key(cell) for cell in survivors), max)
    rows = [(key, 0, i) for i, key in enumerate(rising)]
    rows += [(cell_key(cell), 1, j) for j, cell in enumerate(births)]
    return [Place(birth == 1, index) for _, birth, index in sorted(rows)]


@dataclass
class Gof:
    """What is kept from frame to frame."""

    state: State
    anchors: Matrix
    cover: Row
    anchor_step: int
    control: ControlHeader
    prior: PriorModel | None = None

    def __post_init__(self) -> None:
        self.history: dict[int, Activity] = {}
        self.lods = Lods(len(self.anchors), self.anchors)
        self._intra = self.state.positions
        self.normalisation = Normalisation(self._intra)
        self._motion: MotionField | None = None
        self._spreading: Spreading | None = None

    @property
    def motion(self) -> MotionField:
        """Made when it is first needed, from the I-frame (14)."""
        if self._motion is None:
            self._motion = MotionField(self._intra, self.control, self.prior)
        return self._motion

    @property
    def spreading(self) -> Spreading:
        """The same of profile PAPER (16.6)."""
        if self._spreading is None:
            self._spreading = Spreading(self._intra, self.control)
        return self._spreading

    @property
    def points(self) -> list[Gathered]:
        """12.3: efforts and choices of the Gaussians; 0 where nothing has moved."""
        return self._motion.points if self._motion else [Gathered([], [])] * len(self.anchors)

    def _anchored(self, anchors: Matrix) -> None:
        self.anchors, self.lods = anchors, Lods(len(anchors), anchors)

    def keep(self, kept: Row) -> None:
        """15.2."""
        if len(kept) == len(self.anchors):
            return
        planes = {a: [plane[i] for i in kept] for a, plane in self.state.planes.items()}
        order = None
        if self.state.order is not None:
            old = [self.state.order[i] for i in kept]
            ranks = {place: rank for rank, place in enumerate(sorted(old))}
            order = [ranks[place] for place in old]
        self.motion.keep(kept)
        self.state = State(planes, order)
        self._anchored([self.anchors[i] for i in kept])
        self.cover = [self.cover[i] for i in kept]
        for attribute, activity in self.history.items():
            count = num_blocks(len(kept))
            self.history[attribute] = activity.of(lambda rows: [rows[i] for i in kept], count)

    def settle(self, topology: Topology) -> None:
        """15.4: births and places."""
        rows = [Place(False, i) for i in range(len(self.anchors))]
        if topology.births is not None:
            rows = self._insert(topology.births)
        expected = list(range(len(rows)))
        if self.state.order is not None:
            survivors = self.state.order
            births = [len(survivors) + j for j in range(len(rows) - len(survivors))]
            expected = merged(rows, survivors, births)
            self.state.order = expected
        if topology.places is not None:
            self.state.order = [a + b for a, b in zip(topology.places, expected, strict=True)]
            require(sorted(self.state.order) == list(range(len(rows))))

    def _insert(self, births: Intra) -> list[Place]:
        born = births.state.positions
        rows = interleaved(self.motion.cells, [self.motion.cell(position) for position in born])
        self.motion.insert(born, rows)
        planes = {a: merged(rows, plane, births.state.planes[a]) for a, plane in self.state.planes.items()}
        self.state = State(planes, self.state.order)
        anchors = [[round_divide(x, self.anchor_step) for x in p] for p in born]
        self._anchored(merged(rows, self.anchors, anchors))
        self.cover = merged(rows, self.cover, births.cover)
        for attribute, activity in self.history.items():
            count = num_blocks(len(rows))
            self.history[attribute] = activity.of(
                lambda old: merged(rows, old, [[0] * len(old[0]) for _ in born]), count
            )
        return rows


# --- 16 the network of profile PAPER ----------------------------------------------------------------------


class Array(NamedTuple):
    """An array of integers: `|i1`, `<i2`, `<i4` or `<i8`; values with the last index running fastest."""

    dtype: str
    shape: tuple[int, ...]
    values: Row


Models = Mapping[str, Mapping[str, Array | tuple[str, tuple[int, ...], Row]]]
#: 16.1: formats of `struct`
INTEGERS = {"|i1": "b", "<i2": "h", "<i4": "i", "<i8": "q"}


def read_model(data: bytes) -> dict[str, Array]:
    """16.1: a model from the bytes of its file."""
    arrays, place = {}, 0
    while place < len(data):
        texts = []
        for _ in range(3):
            end = data.index(0, place)
            texts.append(data[place:end].decode("ascii"))
            place = end + 1
        name, dtype, sizes = texts
        require(dtype in INTEGERS)
        shape = tuple(int(size) for size in sizes.strip("()").split(",") if size)
        layout = f"<{math.prod(shape)}{INTEGERS[dtype]}"
        arrays[name] = Array(dtype, shape, list(struct.unpack_from(layout, data, place)))
        place += struct.calcsize(layout)
    return arrays


def model_hash(arrays: Mapping[str, Array]) -> bytes:
    """16.1; the file has its first 8 bytes."""
    whole = hashlib.sha256()
    for name in sorted(arrays, key=str.encode):
        dtype, shape, values = arrays[name]
        whole.update(name.encode() + b"\0" + dtype.encode() + b"\0" + str(tuple(shape)).encode() + b"\0")
        whole.update(struct.pack(f"<{len(values)}{INTEGERS[dtype]}", *values))
    return whole.digest()


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


def rows_of(array: Array) -> Matrix:
    """The last index along a row, all others as one."""
    columns = array.shape[-1]
    return [array.values[i : i + columns] for i in range(0, len(array.values), columns)]


def find_model(sequence: Sequence, models: Models, networks: tuple[str, ...]) -> dict[str, Array]:
    """A model of the profile has `networks`."""
    if sequence.model_id not in models:
        raise ModelMismatch
    arrays = {name: Array(*array) for name, array in models[sequence.model_id].items()}
    if model_hash(arrays)[:8] != sequence.model_hash:
        raise ModelMismatch
    if not all(f"{name}.0.weight" in arrays for name in networks):
        raise ModelMismatch
    return arrays


def shift_left(a: int, n: int) -> int:
    return a << n if n >= 0 else a >> -n


class Normalisation:
    """16.2, from the positions of the I-frame."""

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
    """16.3."""
    x, y, z = corner
    if side**3 <= 4096:
        return x + side * (y + side * z)
    return (x ^ (y * 2654435761) ^ (z * 805459861)) & 4095


def place_features(normal: Row, grid: Matrix) -> Row:
    """16.3; `grid` has the rows of all levels."""
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
    """16.3: of the Gaussians of a reference frame, made when they are needed."""

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
    """16.4: z."""
    values = stream.grouped([i % 16 for i in range(16 * n)], model.hyper_models())
    values = [value - 31 for value in values]
    escaped = [i for i, value in enumerate(values) if abs(value) == 31]
    for i, excess in zip(escaped, stream.escapes(len(escaped)), strict=True):
        values[i] += sign(values[i]) * excess
    return [values[16 * k : 16 * k + 16] for k in range(n)]


def latent_motions(
    model: FrozenModel, gaussian: Row, prior: Priors, payloads: tuple[Fields | None, Fields]
) -> tuple[Matrix, tuple[int, int]]:
    """6.5, 16.4: m, and what 16.6 spreads with."""
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
    """16.5."""
    m = [shift_left(c, size - 16) for c in m[:3]] + [c << 8 for c in m[3:]]
    return [clip(c, -2 * STATE_LIMIT, 2 * STATE_LIMIT) for c in m]


def refined(planes: dict[int, Matrix], changes: Matrix, sequence: Sequence) -> dict[int, Matrix]:
    """16.5, with what the network makes of each Gaussian."""
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


#: 16.6
DECAY = [
    *(16773120, 16769026, 16760840, 16744480, 16711808, 16646655, 16517109, 16261035),
    *(15760736, 14805841, 13066109, 10175896, 6171993, 2270549, 307285, 5628),
]


def decayed(x: int) -> int:
    if x >= 2**16:
        return 0
    r = 2**24
    for b in range(16):
        if x >> b & 1:
            r = round_shift(r * DECAY[b], 24)
    return r


def neighbours(cell: Row, cells: Matrix, num_neighbours: int, decay_exponent: int) -> list[tuple[int, int]]:
    """16.6: Gaussians of the I-frame and their weights."""
    squared = [squared_distance(cell, other) for other in cells]
    nearest = sorted(range(len(cells)), key=lambda i: (squared[i], i))[: min(num_neighbours, len(cells))]
    shift = decay_exponent + 8
    distance = [math.isqrt(squared[i] << 8) for i in nearest]
    beyond = [d - distance[0] for d in distance]
    left = [decayed(b << shift if shift >= 0 else b >> -shift) for b in beyond]
    weight = [(v << 16) // sum(left) for v in left]
    weight[0] += 2**16 - sum(weight)
    return list(zip(nearest, weight, strict=True))


class Spreading:
    """16.6: control points of a GoF, and over whom they spread their motion."""

    def __init__(self, positions: Matrix, control: ControlHeader) -> None:
        middle = positions[len(positions) // 2]
        self.cells = [
            [clip((a - b) >> control.shift, -(2**20), 2**20) for a, b in zip(p, middle, strict=True)]
            for p in positions
        ]
        self.gaussian = farthest(self.cells, min(max(1, len(positions) // control.spacing), 16384))
        self._found: dict[tuple[int, int], list[list[tuple[int, int]]]] = {}

    def _neighbours(self, spread: tuple[int, int]) -> list[list[tuple[int, int]]]:
        """Of each control point; they stay for the GoF."""
        if spread not in self._found:
            self._found[spread] = [neighbours(self.cells[i], self.cells, *spread) for i in self.gaussian]
        return self._found[spread]

    def moved(self, reference: State, motions: Matrix, spread: tuple[int, int]) -> State:
        """With the seven components of each control point."""
        total = [[0] * 7 for _ in self.cells]
        for m, found in zip(motions, self._neighbours(spread), strict=True):
            for i, weight in found:
                total[i] = [a + weight * b for a, b in zip(total[i], m, strict=True)]
        planes = dict(reference.planes)
        positions, rotations = list(planes[POSITION]), list(planes[ROTATION])
        for i, row in enumerate(total):
            received = [round_shift(value, 16) for value in row]
            positions[i] = [clip(positions[i][c] + received[c], -STATE_LIMIT, STATE_LIMIT) for c in range(3)]
            r = [rotations[i][c] + clip(received[3 + c], -(2**24), 2**24) for c in range(4)]
            if any(received[3:]) and any(r):
                rotations[i] = normalise(r)
        planes[POSITION], planes[ROTATION] = positions, rotations
        return State(planes, reference.order)


# --- 17 the frozen prior of profile MAIN ------------------------------------------------------------------


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


def prior_column(stream: RangeDecoder, model: PriorModel, lods: Lods, column: PriorColumn) -> tuple[Row, Row]:
    """17.3: values and residuals of all rows."""
    w, features = column.weights, column.features
    value, residual = [0] * lods.count, [0] * lods.count
    lods = lods.finest(5)

    def found(row: int, statistics: tuple[int, int] | None) -> tuple[int, int, bool]:
        """Prediction, context, whether the residual is flipped."""
        u = list(column.u[row])
        expected = sum(f[row] * v for f, v in zip(features, w[1:], strict=True)) << 4
        u[0:3] = [0, 0, 64]
        if statistics is not None:
            mean, deviation = statistics
            expected += mean * w[0]
            u[0:3] = [log(deviation), log(abs(mean)), 0]
        prediction = round_shift(expected, 16)
        f = expected - (prediction << 16)
        kind = 0 if prediction != 0 else column.kinds[row]
        u[7], u[8] = log(abs(expected) >> 8), 64 if kind > 0 else 0
        fraction = 0 if abs(f) < 2**13 else 1 if abs(f) < 3 * 2**13 else 2
        x = column.common[row] + [min(c, 255) for c in u]
        return prediction, cell_of(model.kind(column.name, x), kind, fraction), f < 0 and fraction > 0

    def code_pass(rows: range, neighbours: Callable[[int], Row] | None) -> None:
        several = [found(i, lods.statistics(i, neighbours(i), value) if neighbours else None) for i in rows]
        contexts = [context for _, context, _ in several]
        r = stream.residuals(contexts, model.tables[column.name], model.rows[column.name])
        for i, (prediction, _, flipped), s in zip(rows, several, r, strict=True):
            residual[i] = -s if flipped else s
            value[i] = prediction + residual[i]

    code_pass(lods.base, None)
    for rows, neighbours in lods.levels():
        code_pass(rows, neighbours)
    return value, residual


@dataclass
class Prior:
    """12.3: what a stream of a RESIDUAL chunk is decoded with."""

    model: PriorModel
    points: list[Gathered]
    follows: list[bool]
    #: activity in the frame before, and in this frame so far
    past: dict[int, Activity]
    present: dict[int, Activity]
    attribute: int = POSITION
    before: Activity = field(default_factory=lambda: Activity([], [], [], []))
    coarseness: Row = field(default_factory=list)

    def common(self, i: int, classes: tuple[int, int, int]) -> Row:
        """x of a Gaussian; `classes` of its block: density before, density, magnitude."""
        point, (running, *memory) = self.points[i], self.before.memory[i]
        efforts = [effort >> 4 for effort in point.effort]
        x = [efforts[point.choice], min(efforts), max(efforts) - min(efforts)]
        x += [64 if point.choice == 0 else 0, 64 if self.follows[i] else 0, 2 * self.coarseness[i]]
        x += [log(size(self.before.symbols[i])), log(running), log(size(memory))]
        x += [factor * c for factor, c in zip((16, 16, 4), classes, strict=True)]
        sources = [self.present.get(a) for a in range(SH_DC + 1)]
        sources += [self.past.get(a) if a != self.attribute else None for a in (POSITION, ROTATION)]
        x += [log(size(activity.symbols[i])) if activity else 0 for activity in sources]
        x += [64 if min(self.attribute, SH_DC + 1) == a else 0 for a in range(SH_DC + 2)]
        return [min(value, 255) for value in x]


def coded_rows(stream: RangeDecoder, model: PriorModel, lods: Lods, density: Row, inputs: Matrix) -> Row:
    """12.4; `density` of each Gaussian's block."""
    s = [256 if d == 3 else 0 for d in density]
    lods = lods.finest(5)

    def code_pass(rows: range, neighbours: Callable[[int], Row] | None) -> None:
        flagged = [i for i in rows if density[i] in (1, 2)]
        contexts = []
        for i in flagged:
            u = [0, 64]
            if neighbours:
                u = [lods.statistics(i, neighbours(i), s)[0] >> 9, 0]
            contexts.append(model.kind("flags", inputs[i] + u))
        for i, flag in zip(flagged, stream.grouped(contexts, model.flags), strict=True):
            s[i] = 256 * flag

    code_pass(lods.base, None)
    for rows, neighbours in lods.levels():
        code_pass(rows, neighbours)
    return [i for i, share in enumerate(s) if share]


def columns_of(
    stream: RangeDecoder, model: PriorModel, lods: Lods, old: Activity, rows: tuple[Matrix, list[bool]]
) -> Matrix:
    """12.5; of coded rows the activity before, the common inputs and whether there is a flag."""
    inputs, flagged = rows
    columns: Matrix = []
    residuals: Matrix = []
    num_columns = len(old.symbols[0]) if old.symbols else 0
    for c in range(num_columns):
        weights = stream.read_weights(3 + c)
        features = [[16 * r for r in residual] for residual in residuals]
        features += [[16 * symbols[c] for symbols in old.symbols], [memory[1 + c] for memory in old.memory]]
        earlier = [[column[j] for column in columns] for j in range(lods.count)]
        kinds = [
            4 - min(num_columns - c, 3) if flag and not any(symbols) else 0
            for flag, symbols in zip(flagged, earlier, strict=True)
        ]
        u = [
            column_inputs(symbols[c], here, 16 * min(num_columns - c, 4))
            for symbols, here in zip(old.symbols, earlier, strict=True)
        ]
        column = PriorColumn("columns", weights, features, inputs, kinds, u)
        value, residual = prior_column(stream, model, lods, column)
        columns.append(value)
        residuals.append(residual)
    return columns


# --- 3 to 7 files -----------------------------------------------------------------------------------------


@dataclass
class Sequence:
    sh_degree: int
    num_frames: int
    frame_numbers: Row
    exponents: dict[int, int]
    profile: int = MAIN
    model_id: str = ""
    model_hash: bytes = b""
    origin: Row = field(default_factory=lambda: [0, 0, 0])
    is_double: bool = False
    level: int = 3

    @property
    def attributes(self) -> Row:
        return list(range(SH_DC + 1 + self.sh_degree))


@dataclass
class Frame:
    index: int
    frame_hash: bytes
    state: State
    sequence: Sequence

    def output(self) -> dict[str, list[float]]:
        """8.4: float32 values of each PLY property, in output order."""
        return output(self.state, self.sequence)


def sequence_header(fields: Fields) -> Sequence:
    version, profile, level, sh_degree, order = (fields.u8() for _ in range(5))
    require(
        version == 11 and profile in (MAIN, PAPER) and level in (1, 2, 3) and sh_degree <= 3 and order <= 2
    )
    num_frames = fields.uvarint()
    fields.uvarint()
    require(num_frames > 0 and fields.uvarint() > 0)
    numbers: Row = []
    end = 0
    for _ in range(fields.uvarint()):
        first = end + fields.uvarint()
        end = first + fields.uvarint() + 1
        numbers += range(first, end)
    require(len(numbers) == num_frames)
    position, scale, opacity, color = (fields.svarint() for _ in range(4))
    origin = [fields.svarint() for _ in range(3)]
    precision = fields.u8()
    require(all(abs(o) <= 1 << 52 for o in origin) and precision <= 1)
    model_id = fields.raw(fields.uvarint())
    require(len(model_id) <= 64 and model_id.isascii())
    hashed = fields.raw(8)
    require(fields.place == len(fields.data))
    exponents = {POSITION: position, SCALE: scale, ROTATION: -24, OPACITY: opacity, SH_DC: color}
    found = Sequence(sh_degree, num_frames, numbers, exponents, profile, model_id.decode("ascii"), hashed)
    return replace(found, origin=origin, is_double=precision == 1, level=level)


def chunks(data: bytes) -> Iterator[tuple[int, int, Fields]]:
    """Type, frame index and payload of each chunk."""
    require(data[:8] == bytes.fromhex("894447530d0a1a0a"))
    fields = Fields(data)
    fields.place = 8
    kind = 0
    while kind != 0x7F:
        start = fields.place
        kind, frame_index, length = fields.u8(), fields.uvarint(), fields.uvarint()
        payload = fields.raw(length)
        crc = zlib.crc32(data[start : fields.place])
        require(fields.raw(4) == struct.pack("<I", crc))
        if kind in (0x01, 0x10, 0x20, 0x21, 0x22, 0x23, 0x24, 0x25, 0x7E, 0x7F):
            yield kind, frame_index, Fields(payload)
        else:
            require(kind & 0x80 != 0)
    require(fields.place == len(data))


def open_streams(fields: Fields, count: int) -> Iterator[RangeDecoder]:
    lengths = [fields.uvarint() for _ in range(count)]
    for length in lengths:
        stream = RangeDecoder(fields.raw(length))
        yield stream
        stream.finish()
    require(fields.place == len(fields.data))


def sort_grid(fields: Fields) -> SortGrid:
    shift, bits = fields.u8(), fields.u8()
    origin = [fields.svarint() for _ in range(3)]
    return SortGrid(shift, bits, origin, bool(fields.u8()))


def intra_header(fields: Fields, sequence: Sequence) -> IntraHeader:
    """5, from `sort_shift` to `alternating`."""
    grid = sort_grid(fields)
    steps = {attribute: fields.uvarint() for attribute in sequence.attributes}
    require(all(1 <= step <= STATE_LIMIT for step in steps.values()))
    coarse_log2 = fields.u8()
    levels = {attribute: fields.svarint() for attribute in sequence.attributes}
    require(coarse_log2 <= 8 and all(abs(level) <= STATE_LIMIT for level in levels.values()))
    thin_octaves = fields.u8()
    require(thin_octaves <= 8 and (not thin_octaves or sequence.exponents[SCALE] <= -11))
    alternating = fields.u8()
    require(alternating & ~sum(1 << a for a in sequence.attributes if a != POSITION) == 0)
    return IntraHeader(grid, steps, coarse_log2, levels, thin_octaves, alternating)


def intra_frame(fields: Fields, sequence: Sequence) -> tuple[bytes, Gof | None, bool]:
    """Hash, the GoF that begins, and whether escapes follow; None for a frame without Gaussians."""
    frame_hash, kind = fields.raw(16), fields.u8()
    n = fields.uvarint()
    if n == 0:
        require(kind == 1 and fields.place == len(fields.data))
        return frame_hash, None, False
    has_permutation, has_escapes = bool(fields.u8()), fields.u8()
    require(has_escapes <= (1 if kind == 1 else 0))
    control = ControlHeader(fields.uvarint(), fields.u8())
    require(control.spacing >= 1 and control.shift <= 31)
    require(min(n // control.spacing, 16384) <= (4096 if sequence.level == 1 else 16384))
    coding = (sequence.exponents, has_permutation)
    if kind == 1:
        header = intra_header(fields, sequence)
        streams = open_streams(fields, header.num_streams + has_permutation)
        gof = Gof(*coded_intra(streams, n, header, coding), header.steps[POSITION], control)
    else:
        require(kind == 0)
        streams = open_streams(fields, len(sequence.attributes) + has_permutation)
        state = verbatim_intra(streams, n, sequence, has_permutation)
        gof = Gof(state, state.positions, [0] * n, 1, control)
    require(next(streams, None) is None)
    return frame_hash, gof, bool(has_escapes)


def check_escapes(fields: Fields, sequence: Sequence, n: int) -> bytes:
    """6.6: the payload, where it is as it should be and not without escapes."""
    escapes = list(read_escapes(Fields(fields.data), sequence))
    places = [(row, column) for row, column, _ in escapes]
    require(places == sorted(set(places)) and all(row < n for row, _ in places))
    require(all(column < sum(COLUMNS[a] for a in sequence.attributes) for _, column in places))
    return fields.data if escapes else b""


def read_escapes(fields: Fields, sequence: Sequence) -> Iterator[tuple[int, int, float]]:
    count = fields.uvarint()
    require(6 * count <= len(fields.data))
    rows: Row = []
    for _ in range(count):
        rows.append((rows[-1] if rows else 0) + fields.uvarint())
    columns = [fields.u8() for _ in range(count)]
    for row, column in zip(rows, columns, strict=True):
        is_double = column < 3 and sequence.is_double
        value: float = struct.unpack("<d" if is_double else "<f", fields.raw(8 if is_double else 4))[0]
        yield row, column, value
    require(fields.place == len(fields.data))


def topology_chunk(fields: Fields, sequence: Sequence, n: int) -> Topology:
    """6.2, 15.1."""
    num_removals, has_permutation, num_births = fields.uvarint(), fields.u8(), fields.uvarint()
    require(num_removals < n and has_permutation <= 1)
    header = intra_header(fields, sequence) if num_births else None
    num_streams = header.num_streams if header else 0
    streams = open_streams(fields, (num_removals > 0) + num_streams + has_permutation)
    removed, births, places = [0] * n, None, None
    if num_removals:
        stream = next(streams)
        removed = stream.grouped([0] * n, stream.read_histograms([0], 2))
        require(sum(removed) == num_removals)
    if header:
        births = coded_intra(streams, num_births, header, (sequence.exponents, False))
    if has_permutation:
        places, _ = column(next(streams), Lods(n - num_removals + num_births), [], [])
    require(next(streams, None) is None)
    return Topology([i for i in range(n) if not removed[i]], births, places)


class Decoder:
    """Frames of a file, from its beginning; `models` by id."""

    def __init__(self, data: bytes, models: Models | None = None) -> None:
        self._chunks = chunks(data)
        kind, _, fields = next(self._chunks)
        require(kind == 0x01)
        self.sequence = sequence_header(fields)
        self._model: FrozenModel | None = None
        self._prior: PriorModel | None = None
        if self.sequence.profile == PAPER:
            networks: tuple[str, ...] = ("fusion", "synthesis")
            self._model = FrozenModel(find_model(self.sequence, models or {}, networks))
        else:
            networks = ("flags", "columns", "control")
            self._prior = PriorModel(find_model(self.sequence, models or {}, networks))

    def frames(self) -> Iterator[Frame]:
        expected = 0
        gof: Gof | None = None
        empty = State({a: [] for a in self.sequence.attributes})
        for kind, frame_index, fields in self._chunks:
            if kind in (0x7E, 0x7F):
                continue
            require(frame_index == expected)
            if kind == 0x10:
                frame_hash, gof, has_escapes = intra_frame(fields, self.sequence)
                if gof is not None:
                    gof.prior = self._prior
                if gof is not None and has_escapes:
                    self._escape(frame_index, gof)
            else:
                require(kind == 0x20 and expected > 0)
                if gof is None:
                    frame_hash = fields.raw(16)
                    require(fields.raw(2) == bytes(2) and fields.place == len(fields.data))
                elif self._model is None:
                    frame_hash = self._inter_frame(fields, frame_index, gof)
                else:
                    frame_hash = self._paper_frame(fields, frame_index, gof, self._model)
            yield Frame(frame_index, frame_hash, empty if gof is None else gof.state, self.sequence)
            expected += 1
        require(expected == self.sequence.num_frames)

    def _following(self, kind: int, frame_index: int) -> Fields:
        """The payload of a chunk that belongs to the INTER_FRAME chunk before it (3.2)."""
        found, index, fields = next(self._chunks)
        require(found == kind and index == frame_index)
        return fields

    def _escape(self, frame_index: int, gof: Gof) -> None:
        """6.6."""
        fields = self._following(0x25, frame_index)
        escapes = check_escapes(fields, self.sequence, len(gof.state.positions))
        gof.state = State(gof.state.planes, gof.state.order, None, escapes)

    def _inter_frame(self, fields: Fields, frame_index: int, gof: Gof) -> bytes:
        frame_hash, tools, mask = fields.raw(16), fields.u8(), fields.u8()
        attributes = [a for a in self.sequence.attributes if mask >> a & 1]
        require(
            tools & ~(MOTION | TOPOLOGY | VISIBILITY | ESCAPE) == 0
            and mask < 1 << len(self.sequence.attributes)
        )
        require(mask > 0 or not tools & VISIBILITY)
        steps = {attribute: fields.uvarint() for attribute in attributes}
        levels = {attribute: fields.svarint() for attribute in attributes if tools & VISIBILITY}
        require(all(abs(level) <= STATE_LIMIT for level in levels.values()))
        require(fields.place == len(fields.data))
        if tools or mask:
            # 9.3: no float32 values with any tool, VISIBILITY alone included, and no escapes but its own
            gof.state = State(gof.state.planes, gof.state.order)
        topology, motion = None, None
        if tools & TOPOLOGY:
            n = len(gof.state.positions)
            topology = topology_chunk(self._following(0x23, frame_index), self.sequence, n)
            gof.keep(topology.kept)
        reference = gof.state.positions
        if tools & MOTION:
            motion = gof.motion.decode(self._following(0x22, frame_index))
            gof.state = gof.motion.carry(gof.state, motion.follows)
        activity: dict[int, Activity] = {}
        frame_steps = Steps(steps, levels, self.sequence.exponents, gof.cover)
        if mask:
            fields = self._following(0x24, frame_index)
            activity = residual(fields, gof, frame_steps, motion)
        gof.history = activity
        gof.state = reconstruct_inter(activity, frame_steps, gof.state)
        if motion:
            gof.motion.learn(reference, gof.state.positions)
        if topology:
            gof.settle(topology)
        if tools & ESCAPE:
            self._escape(frame_index, gof)
        return frame_hash

    def _paper_frame(self, fields: Fields, frame_index: int, gof: Gof, model: FrozenModel) -> bytes:
        """16."""
        frame_hash, tools, mask = fields.raw(16), fields.u8(), fields.u8()
        require(
            tools & ~(LATENT | REFINEMENT | ESCAPE) == 0 and mask == 0 and fields.place == len(fields.data)
        )
        require("refinement" in model.networks or not tools & REFINEMENT)
        if not tools:
            return frame_hash
        reference = State(gof.state.planes, gof.state.order)  # 9.3: no float32 values
        prior = Priors(model, reference.planes, gof.normalisation, self.sequence)
        gof.state = reference
        if tools & LATENT:
            hyper = None
            if "hyper_synthesis" in model.networks:
                hyper = self._following(0x21, frame_index)
            fields = self._following(0x22, frame_index)
            motions, spread = latent_motions(model, gof.spreading.gaussian, prior, (hyper, fields))
            size = gof.normalisation.size
            in_units = [motion_of_output(m, size) for m in motions]
            gof.state = gof.spreading.moved(reference, in_units, spread)
        if tools & REFINEMENT:
            changes = [model.network("refinement", prior.of(i)) for i in range(len(reference.positions))]
            gof.state = State(refined(gof.state.planes, changes, self.sequence), gof.state.order)
        if tools & ESCAPE:
            self._escape(frame_index, gof)
        return frame_hash


def residual(fields: Fields, gof: Gof, steps: Steps, motion: MotionSymbols | None) -> dict[int, Activity]:
    """6.4; `motion`: if the frame has that tool."""
    n = len(gof.state.positions)
    count = num_blocks(n)

    def nothing(num_columns: int) -> Activity:
        memory = [[0] * (1 + num_columns) for _ in range(n)]
        return Activity([[0] * num_columns for _ in range(n)], [0] * count, [0] * count, memory)

    activity: dict[int, Activity] = {}
    beside = motion.mode if motion else [0] * count
    follows = motion.follows if motion else [False] * n
    assert gof.prior is not None
    prior = Prior(gof.prior, gof.points, follows, gof.history, activity)
    attributes = sorted(steps.steps)
    streams = open_streams(fields, len(attributes))
    for attribute, stream in zip(attributes, streams, strict=True):
        before = gof.history.get(attribute)
        if before is None:
            before = nothing(3 if attribute == ROTATION else COLUMNS[attribute])
        coarseness = steps.coarseness(attribute, gof.state)
        prior = replace(prior, attribute=attribute, before=before, coarseness=coarseness)
        activity[attribute] = inter_attribute(stream, gof.lods, beside, prior)
        beside = activity[attribute].density
    return activity


# --- 8.4 output -------------------------------------------------------------------------------------------


def to_float32(value: int, exponent: int) -> float:
    rounded: float = struct.unpack("<f", struct.pack("<f", math.ldexp(value, exponent)))[0]
    return rounded


def float_planes(state: State, sequence: Sequence) -> dict[int, list[list[float]]]:
    if state.verbatim is not None:
        return {a: [[float_of(p) for p in row] for row in rows] for a, rows in state.verbatim.items()}
    planes = {}
    for attribute, rows in state.planes.items():
        e = sequence.exponents[min(attribute, SH_DC)]
        if attribute == OPACITY:
            rows = [[expand(row[0], e)] for row in rows]
        if attribute == POSITION:
            places = [[value + o for value, o in zip(row, sequence.origin, strict=True)] for row in rows]
            convert = math.ldexp if sequence.is_double else to_float32
            planes[attribute] = [[convert(value, e) for value in row] for row in places]
            continue
        planes[attribute] = [[to_float32(value, e) for value in row] for row in rows]
    return planes


def escaped(state: State, sequence: Sequence) -> dict[int, list[list[float]]]:
    """With the exact values of escapes in their places."""
    planes = float_planes(state, sequence)
    if state.escapes:
        for row, column, value in read_escapes(Fields(state.escapes), sequence):
            for attribute in sorted(planes):
                if column < COLUMNS[attribute]:
                    planes[attribute][row][column] = value
                    break
                column -= COLUMNS[attribute]
    return planes


def output(state: State, sequence: Sequence) -> dict[str, list[float]]:
    planes = escaped(state, sequence)
    names = {
        POSITION: ["x", "y", "z"],
        SCALE: ["scale_0", "scale_1", "scale_2"],
        ROTATION: ["rot_0", "rot_1", "rot_2", "rot_3"],
        OPACITY: ["opacity"],
        SH_DC: ["f_dc_0", "f_dc_1", "f_dc_2"],
    }
    columns = {
        name: [row[c] for row in planes[attribute]]
        for attribute, group in names.items()
        for c, name in enumerate(group)
    }
    coefficients = (0, 3, 8, 15)
    total = coefficients[sequence.sh_degree]
    for channel in range(3):
        for m in range(total):
            band = 1 if m < 3 else 2 if m < 8 else 3
            k = m - coefficients[band - 1]
            columns[f"f_rest_{channel * total + m}"] = [row[3 * k + channel] for row in planes[SH_DC + band]]
    if state.order is None:
        return columns
    places = state.order
    return {
        name: [v for _, v in sorted(zip(places, values, strict=True))] for name, values in columns.items()
    }

"""Section 11.5: rotations of a coded I-frame."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

from tests.spec_decoder.basics import dot, round_divide, round_shift
from tests.spec_decoder.columns import ladder
from tests.spec_decoder.state import from_stereo, multiply, normalise
from tests.spec_decoder.tables import uniform

if TYPE_CHECKING:
    from tests.spec_decoder.basics import Matrix, Row
    from tests.spec_decoder.columns import ColumnSteps
    from tests.spec_decoder.lods import Lods
    from tests.spec_decoder.stream import RangeDecoder


def axis_flip(q: Row, f: int) -> Row:
    """9.4."""
    w, x, y, z = q
    return [[w, x, y, z], [-x, w, z, -y], [-y, -z, w, x], [-z, y, -x, w]][f]


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

"""Sections 10.4 to 10.6: models of symbols."""

from __future__ import annotations

import math
from functools import cache
from itertools import accumulate
from typing import TYPE_CHECKING

from tests.spec_decoder.basics import CONSTANTS, HEAVY, LAPLACE, require

if TYPE_CHECKING:
    from tests.spec_decoder.basics import Row


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


SPLIT_ALPHAS: Row = CONSTANTS["10.4"]["SPLIT_ALPHAS"]

TWICE_REACH = (11, 16, 24)

INVERSE_SIGMAS: Row = CONSTANTS["10.5"]["INVERSE_SIGMAS"]


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

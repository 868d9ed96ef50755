"""Section 11.4: coded I-frames, and births."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

from tests.spec_decoder.basics import (
    COLUMNS,
    OPACITY,
    POSITION,
    ROTATION,
    SCALE,
    SH_DC,
    STATE_LIMIT,
    clip,
    in_range,
    require,
    round_divide,
    transposed,
)
from tests.spec_decoder.columns import ColumnSteps, column, permutation
from tests.spec_decoder.lods import Lods
from tests.spec_decoder.positions import position_tree
from tests.spec_decoder.state import State
from tests.spec_decoder.steps import (
    COVER_WEIGHT,
    MAX_COVER,
    MAX_TURN_STEP,
    SPIN_WEIGHT,
    is_alternating,
    look_of,
    step_of,
    thin_axis,
)
from tests.spec_decoder.turns import turns

if TYPE_CHECKING:
    from tests.spec_decoder.basics import Matrix, Row
    from tests.spec_decoder.positions import SortGrid
    from tests.spec_decoder.steps import Look
    from tests.spec_decoder.stream import RangeDecoder


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

"""Chapter 12: passes of a P-frame."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from tests.spec_decoder.basics import COLUMNS, POSITION, ROTATION, SH_DC, clip
from tests.spec_decoder.lods import Lods
from tests.spec_decoder.prior import PriorColumn, column_inputs, log, prior_column, size
from tests.spec_decoder.stream import open_streams

if TYPE_CHECKING:
    from tests.spec_decoder.basics import Fields, Matrix, Row
    from tests.spec_decoder.gathering import Gathered
    from tests.spec_decoder.gof import Gof
    from tests.spec_decoder.motion import MotionSymbols
    from tests.spec_decoder.prior import PriorModel
    from tests.spec_decoder.steps import Steps
    from tests.spec_decoder.stream import RangeDecoder


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


@dataclass
class Prior:
    """12.3: what a stream of a RESIDUAL chunk is decoded with."""

    model: PriorModel
    points: list[Gathered]
    follows: list[bool]
    #: activity in the frame before
    past: dict[int, Activity]
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
        sources = [self.past.get(a) if a != self.attribute else None for a in (POSITION, ROTATION)]
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
    prior = Prior(gof.prior, gof.points, follows, gof.history)
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

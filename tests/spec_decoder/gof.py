"""Chapter 2: what is kept from frame to frame; sections 15.2 and 15.4."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from tests.spec_decoder.basics import require, round_divide
from tests.spec_decoder.gathering import Gathered
from tests.spec_decoder.inter import num_blocks
from tests.spec_decoder.lods import Lods
from tests.spec_decoder.motion import MotionField
from tests.spec_decoder.state import State
from tests.spec_decoder.topology import Place, interleaved, merged

if TYPE_CHECKING:
    from tests.spec_decoder.basics import Matrix, Row
    from tests.spec_decoder.gathering import ControlHeader
    from tests.spec_decoder.inter import Activity
    from tests.spec_decoder.intra import Intra
    from tests.spec_decoder.prior import PriorModel
    from tests.spec_decoder.topology import Topology


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
        self._motion: MotionField | None = None

    @property
    def motion(self) -> MotionField:
        """Made when it is first needed, from the I-frame (14)."""
        if self._motion is None:
            self._motion = MotionField(self._intra, self.control, self.prior)
        return self._motion

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

"""Carrying the Gaussians of a GoF along with the control points that they follow (spec section 14.5)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from dfcgs_codec.array_types import Float64, Int64
from dfcgs_codec.bitstream.constants import STATE_LIMIT, Attribute
from dfcgs_codec.bitstream.frame_headers import ControlHeader
from dfcgs_codec.bitstream.motion_header import MotionHeader
from dfcgs_codec.codec.motion.control_points import ControlPrior
from dfcgs_codec.codec.motion.field import FieldMotion, MotionField
from dfcgs_codec.codec.motion.followers import Binding
from dfcgs_codec.codec.motion.walk import MotionShape, MotionSymbols
from dfcgs_codec.codec.residual.classes import nonzero_rows
from dfcgs_codec.codec.state.planes import FrameState, Plane
from dfcgs_codec.core import procedures
from dfcgs_codec.model.context_model import ContextModel
from dfcgs_codec.transform.control_points import CELL_LIMIT, control_cells, gather_from
from dfcgs_codec.transform.morton import morton_keys
from dfcgs_codec.transform.pieces import pieces
from dfcgs_codec.transform.rotation import from_stereo, multiply, normalise


@dataclass(frozen=True)
class Gathered:
    """What is learnt from: `rows` (F,) that followed, candidates `moves` (5, 3, F), step of translations."""

    rows: Int64
    moves: Float64
    field_motion: FieldMotion
    binding: Binding
    step: int


@dataclass(frozen=True)
class Carried:
    """A frame's motion applied: the `state` predicted, and how it was `gathered`."""

    state: FrameState
    gathered: Gathered


@dataclass(frozen=True)
class GofMotion:
    """Control points and followers of a GoF before a frame, and the last motion symbols.

    `cells` (N, 3): where the Gaussians were when they came; all cells are about `center`, with `shift`.
    """

    field: MotionField
    binding: Binding
    symbols: MotionSymbols
    cells: Int64
    center: Int64
    shift: int

    @staticmethod
    def of(positions: Int64, control: ControlHeader) -> GofMotion:
        """At the I-frame, from its decoded positions (N, 3)."""
        center = positions[len(positions) >> 1]
        cells = control_cells(positions, center, control.shift)
        field = MotionField.of(positions, cells, control)
        binding = Binding.of(gather_from(cells, cells[field.gaussians]))
        symbols = MotionSymbols.none(field.num_points, len(positions))
        return GofMotion(field, binding, symbols, cells, center, control.shift)

    def cells_of(self, positions: Int64) -> Int64:
        """Cells (rows, 3) of `positions`."""
        return control_cells(positions, self.center, self.shift)

    def keys_of(self, cells: Int64) -> Int64:
        """Morton keys (rows,) that births are sorted in by."""
        return morton_keys(np.minimum(cells + CELL_LIMIT, 2 * CELL_LIMIT - 1))

    def keys(self) -> Int64:
        """Those of the Gaussians that are there."""
        return self.keys_of(self.cells)

    def survivors(self, kept: Int64) -> GofMotion:
        """Without the Gaussians that are not among the rows `kept`."""
        return replace(
            self,
            binding=self.binding.of_rows(kept),
            symbols=self.symbols.merged(0, kept),
            cells=self.cells[kept],
        )

    def with_births(self, cells: Int64, source: Int64) -> GofMotion:
        """With Gaussians at `cells`, bound to where control points are now; see `FrameState.merge`."""
        births = Binding.of(gather_from(cells, self.cells_of(self.field.pivots)))
        return replace(
            self,
            binding=self.binding.merge(births, source),
            symbols=self.symbols.merged(len(cells), source),
            cells=np.concatenate([self.cells, cells])[source],
        )

    def shape(self, header: MotionHeader, model: ContextModel | None) -> MotionShape:
        """What the symbol walk needs; `model`: the frozen prior of the sequence."""
        order = np.argsort(self.field.gaussians, kind="stable")
        assert model is not None
        prior = ControlPrior.of(model, self.field, header, self.symbols.control)
        return MotionShape(order, header.num_columns, prior)

    def carry(self, header: MotionHeader, symbols: MotionSymbols, reference: FrameState) -> Carried:
        """Prediction of a frame from the decoded `reference` and its motion."""
        moved = self.field.move(header, lambda rows, *_: symbols.control[rows])
        rows = np.flatnonzero(symbols.follows)
        binding = self.binding.of_rows(rows)
        planes = dict(reference.planes)
        positions = reference.planes[Attribute.POSITION].wide()
        some = positions.take(rows, axis=0)
        moves = binding.moves(moved.motion, some.T.astype(np.float64))
        some += binding.chosen(moves).T.astype(np.int64)
        positions[rows] = np.clip(some, -STATE_LIMIT, STATE_LIMIT, out=some)
        planes[Attribute.POSITION] = Plane(positions)
        if header.is_rigid:
            rotations = reference.planes[Attribute.ROTATION].wide()
            rotations[rows] = turned(rotations.take(rows, axis=0), binding.turns(moved.motion))
            planes[Attribute.ROTATION] = Plane(rotations)
        gathered = Gathered(rows, moves, moved, binding, header.translation_step)
        return Carried(replace(reference, planes=planes, verbatim=None), gathered)

    def after(
        self, carried: Carried, symbols: MotionSymbols, states: tuple[FrameState, FrameState]
    ) -> GofMotion:
        """Before the next frame; `states`: the reference and what was decoded."""
        gathered = carried.gathered
        old, new = (state.planes[Attribute.POSITION].values.take(gathered.rows, axis=0) for state in states)
        actual = new.T.astype(np.float64) - old.T
        learnt = gathered.binding.learn(gathered.moves, actual, gathered.step)
        field = self.field.after(gathered.field_motion, gathered.step)
        return replace(
            self, field=field, binding=self.binding.with_rows(gathered.rows, learnt), symbols=symbols
        )


@dataclass(frozen=True, eq=False)
class ControlSource:
    """What a GoF's motion begins with: positions of its I-frame, and how control points are chosen there."""

    positions: Plane
    control: ControlHeader

    @cached_property
    def motion(self) -> GofMotion:
        """The motion of the GoF before its first frame that moves."""
        return GofMotion.of(self.positions.wide(), self.control)


def turned(quaternions: Int64, vectors: Int64) -> Int64:
    """Quaternions (N, 4) turned from the left by `vectors` (N, 3); those of zero vectors keep their bits."""
    if procedures.is_worth(len(quaternions)):
        return procedures.turned(quaternions, vectors)
    return _turned(quaternions, vectors)


def _turned(quaternions: Int64, vectors: Int64) -> Int64:
    result = quaternions.copy()
    for part in pieces(len(result)):
        some, by = result[part], vectors[part]
        rows = np.flatnonzero(nonzero_rows(by))
        some[rows] = normalise(multiply(from_stereo(by[rows]), some[rows]))
    return result

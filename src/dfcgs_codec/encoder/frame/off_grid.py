"""Values that the grids of a sequence do not hold: found in the input, kept exactly beside the coded frame.

So are positions of one or two Gaussians that lie apart from all others. These then spoil nothing: on the grid
they stand where they stood before, or at a corner of the scene, and the decoder puts the exact values there.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dfcgs_codec.array_types import Bool, Floats, Int64, UInt64
from dfcgs_codec.bitstream.constants import STATE_LIMIT, Precision
from dfcgs_codec.bitstream.escapes import Escapes
from dfcgs_codec.bitstream.sequence_header import UnitExponents
from dfcgs_codec.codec.state.planes import array_of_columns, columns_of
from dfcgs_codec.encoder.plan.position_grid import far_ones
from dfcgs_codec.gaussians import GaussianCloud

#: largest magnitude that a grid is taken to hold: errors of coarse steps must not lead out of the state
_HELD = STATE_LIMIT - (1 << 25)
_NO_ROTATION = (1.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Grids:
    """The grids of a sequence, and which values they hold."""

    units: UnitExponents

    def split(
        self, cloud: GaussianCloud, before: GaussianCloud | None = None
    ) -> tuple[GaussianCloud, Escapes | None]:
        """`cloud` with values that the grids hold, its positions taken from the origin, and all others.

        The rows of these are those of the input; `before`: the frame before, as this gave it.
        """
        held = None
        if before is not None and before.num_gaussians == cloud.num_gaussians:
            held = before.positions
        found: dict[str, Floats] = {}
        rows: list[Int64] = []
        columns: list[Int64] = []
        patterns: list[UInt64] = []
        for name, first, values in columns_of(cloud):
            limit = self._limit(name)
            on_grid = self._taken_from_origin(values) if name == "positions" else values
            off = _off_grid(on_grid, name, limit)
            if off is not None:
                on_grid = _stand_ins(on_grid, off, name, limit, held)
                row, column = np.nonzero(off)
                rows.append(row)
                columns.append(first + column)
                patterns.append(_patterns(values[off], self._is_wide(name)))
            if on_grid is not values:
                found[name] = array_of_columns(name, on_grid, getattr(cloud, name).shape)
        if not found:
            return cloud, None
        split = replace(cloud, **found)
        if not rows:
            return split, None
        row, column = np.concatenate(rows), np.concatenate(columns)
        order = np.lexsort((column, row))
        pattern = np.concatenate(patterns)[order]
        return split, Escapes(row[order], column[order], pattern, self.units.precision)

    def _limit(self, name: str) -> float:
        units = self.units
        exponents = {"positions": units.position, "scales": units.scale, "opacities": units.opacity}
        return float(_HELD) * 2.0 ** exponents.get(name, units.color)

    def _taken_from_origin(self, positions: Floats) -> Floats:
        if not any(self.units.origin):
            return positions
        origin = np.array(self.units.origin, np.float64) * 2.0**self.units.position
        return positions.astype(np.float64) - origin

    def _is_wide(self, name: str) -> bool:
        return name == "positions" and self.units.precision == Precision.FLOAT64


def _off_grid(values: Floats, name: str, limit: float) -> Bool | None:
    """Which of `values` (N, C) the grid does not hold; None where it holds all."""
    if not values.size:
        return None
    if name == "rotations":
        largest = np.abs(values).max(axis=1)
        if largest.min() > 0 and largest.max() < np.inf:
            return None
        off = ~np.isfinite(values).all(axis=1) | (values == 0).all(axis=1)
        return np.broadcast_to(off[:, None], values.shape) if off.any() else None
    # comparisons are false for NaN, above too
    if name != "positions" and values.min() >= -limit and values.max() <= limit:
        return None
    held = np.abs(values) <= limit
    if name != "positions":
        return None if held.all() else ~held
    rows: Bool = np.asarray(held.all(axis=1))
    rows[rows] = ~far_ones(values[rows])
    return None if rows.all() else np.broadcast_to(~rows[:, None], values.shape)


def _corner(positions: Floats, off: Bool) -> Floats:
    """Where a far Gaussian disturbs nobody: the last corner of the box around all others.

    There it is last in canonical order, so that all others keep their places; farther out it would spoil the
    control points.
    """
    near = positions[~off[:, 0]]
    return near.max(axis=0) if len(near) else np.zeros(3)


def _stand_ins(values: Floats, off: Bool, name: str, limit: float, held: Floats | None) -> Floats:
    """What stands on the grid in their place; `held` are the positions before."""
    if name == "rotations":
        return np.where(off, np.array(_NO_ROTATION, values.dtype), values)
    if name == "positions":
        return np.where(off, _corner(values, off) if held is None else held, values).astype(values.dtype)
    # predictions from values at the very border would leave the state
    border = np.clip(np.where(np.isnan(values), 0, values), -limit / 16, limit / 16)
    return np.where(off, border, values).astype(values.dtype)


def _patterns(values: Floats, is_wide: bool) -> UInt64:
    kinds = (np.float64, np.uint64) if is_wide else (np.float32, np.uint32)
    if values.dtype == kinds[0]:
        return values.view(kinds[1]).astype(np.uint64)
    with np.errstate(over="ignore", invalid="ignore"):
        return values.astype(kinds[0]).view(kinds[1]).astype(np.uint64)


def in_gof_order(escapes: Escapes, members: Int64) -> Escapes:
    """With the rows that stand in GoF order; `members` (N,) are the rows of the input in that order."""
    place = np.empty(len(members), np.int64)
    place[members] = np.arange(len(members))
    rows = place[escapes.rows]
    order = np.lexsort((escapes.columns, rows))
    return replace(
        escapes, rows=rows[order], columns=escapes.columns[order], patterns=escapes.patterns[order]
    )

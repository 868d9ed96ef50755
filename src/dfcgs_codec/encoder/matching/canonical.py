"""Choosing, for each Gaussian, the cheapest of the 24 ways to name its axes.

Turning a Gaussian by a quarter or third turn about its own axes and exchanging its scales to match leaves
it the same. Axes sorted by scale and the turn with the largest w make scales and rotations
cheaper by about 5 bits. The choice is made once for a tracked sequence and carried along, so that a decoded
sequence never flips between names.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dfcgs_codec.array_types import Float32, Float64, Int64
from dfcgs_codec.bitstream.constants import Attribute
from dfcgs_codec.transform.rotation import CELLS, ONE, multiply, normalise

Planes = dict[Attribute, Int64]

#: rank order of the scales -> quaternion whose turn brings axis order[j] to place j
_EXCHANGES = {
    (0, 1, 2): (1, 0, 0, 0),
    (1, 2, 0): (1, 1, 1, 1),
    (2, 0, 1): (1, -1, -1, -1),
    (1, 0, 2): (1, 0, 0, 1),
    (0, 2, 1): (1, 1, 0, 0),
    (2, 1, 0): (1, 0, 1, 0),
}


def product(a: Float64, b: Float64) -> Float64:
    """Products of quaternions (N, 4), w first."""
    w, x, y, z = a.T
    s, i, j, k = b.T
    columns = [
        w * s - x * i - y * j - z * k,
        w * i + x * s + y * k - z * j,
        w * j - x * k + y * s + z * i,
        w * k + x * j - y * i + z * s,
    ]
    return np.stack(columns, axis=1)


@dataclass(frozen=True)
class AxisNames:
    """New axis j of a Gaussian is its old axis order[j]; rotations are multiplied by `turns`, Q1.24.

    `order` (N, 3), `turns` (N, 4).
    """

    order: Int64
    turns: Int64

    def take(self, rows: Int64) -> AxisNames:
        """Those of some Gaussians."""
        return AxisNames(self.order[rows], self.turns[rows])

    def merge(self, births: AxisNames, source: Int64) -> AxisNames:
        """With those of `births`: row i of the result is row source[i] of these and those."""
        return AxisNames(
            np.concatenate([self.order, births.order])[source],
            np.concatenate([self.turns, births.turns])[source],
        )

    def rename(self, planes: Planes) -> Planes:
        """The same Gaussians under their new names; rows of planes as those of the names."""
        renamed = dict(planes)
        if Attribute.SCALE in planes:
            renamed[Attribute.SCALE] = np.take_along_axis(planes[Attribute.SCALE], self.order, axis=1)
        if Attribute.ROTATION in planes:
            renamed[Attribute.ROTATION] = normalise(multiply(planes[Attribute.ROTATION], self.turns))
        return renamed

    def rename_scales(self, scales: Float32) -> Float32:
        """The same for float values (N, 3)."""
        return np.take_along_axis(scales, self.order, axis=1)

    def rename_rotations(self, rotations: Float32) -> Float32:
        """The same for float quaternions (N, 4), made unit ones."""
        wide = rotations.astype(np.float64)
        # their length carries no meaning, and a long one would overflow float32 below
        unit = wide / np.linalg.norm(wide, axis=1, keepdims=True)
        return product(unit, self.turns / ONE).astype(np.float32)


def choose_axis_names(planes: Planes) -> AxisNames:
    """Axes by falling scale, and of the four turns that this leaves the one with the largest w."""
    order = np.argsort(-planes[Attribute.SCALE], axis=1, kind="stable")
    exchange = np.empty((len(order), 4), np.int64)
    for ranks, quaternion in _EXCHANGES.items():
        rows = (order == np.array(ranks)).all(axis=1)
        length = np.linalg.norm(quaternion)
        exchange[rows] = np.rint(np.array(quaternion) * (ONE / length)).astype(np.int64)
    exchanged = multiply(planes[Attribute.ROTATION], exchange)
    flips = CELLS[np.abs(exchanged).argmax(axis=1)] * np.array([ONE, -ONE, -ONE, -ONE])
    return AxisNames(order, multiply(exchange, flips))

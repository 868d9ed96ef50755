"""Input frames on the grids of the state; what did not change is not computed again."""

from __future__ import annotations

import numpy as np

from dfcgs_codec.array_types import Int64
from dfcgs_codec.bitstream.constants import Attribute
from dfcgs_codec.bitstream.sequence_header import UnitExponents
from dfcgs_codec.codec.intra.verbatim import grid_values
from dfcgs_codec.codec.state.planes import FrameState
from dfcgs_codec.gaussians import GaussianCloud

Planes = dict[Attribute, Int64]


def wide_planes(state: FrameState) -> Planes:
    """The planes of a state as int64."""
    return {attribute: plane.wide() for attribute, plane in state.planes.items()}


def ordered(planes: Planes, order: Int64) -> Planes:
    """Rows of each plane in the given order."""
    return {attribute: values.take(order, axis=0) for attribute, values in planes.items()}


_FIELDS = ("positions", "scales", "rotations", "opacities", "sh_dc", "sh_rest")


class Targets:
    """Turns frames into planes of grid integers (N, C), int64, in input order."""

    def __init__(self, units: UnitExponents) -> None:
        self._units = units
        self._last: tuple[GaussianCloud, dict[str, Planes]] | None = None

    def planes(self, cloud: GaussianCloud) -> Planes:
        """The planes of `cloud`, whose values the grids hold.

        Arrays equal to those of the frame asked for before give the same planes, not copies.
        """
        found = {field: self._of_field(cloud, field) for field in _FIELDS}
        self._last = (cloud, found)
        return {attribute: plane for planes in found.values() for attribute, plane in planes.items()}

    def _of_field(self, cloud: GaussianCloud, field: str) -> Planes:
        values = getattr(cloud, field)
        if self._last is not None and np.array_equal(values, getattr(self._last[0], field)):
            return self._last[1][field]
        return grid_values(cloud, field, self._units)

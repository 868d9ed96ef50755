"""Input frames on the grids of the state; what did not change is not computed again."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from dfcgs_codec.bitstream.constants import STATE_LIMIT, Attribute
from dfcgs_codec.bitstream.sequence_header import UnitExponents
from dfcgs_codec.codec.dpb import FrameState
from dfcgs_codec.codec.verbatim import state_of
from dfcgs_codec.errors import InputError
from dfcgs_codec.gaussians import GaussianCloud

Int64 = npt.NDArray[np.int64]
Planes = dict[Attribute, Int64]


def wide_planes(state: FrameState) -> Planes:
    """The planes of a state as int64."""
    return {attribute: plane.wide() for attribute, plane in state.planes.items()}


def ordered(planes: Planes, order: Int64) -> Planes:
    """Rows of each plane in the given order."""
    return {attribute: values[order] for attribute, values in planes.items()}


class Targets:
    """Turns frames into planes of grid integers (N, C), int64, in input order."""

    def __init__(self, units: UnitExponents) -> None:
        self._units = units

    def planes(self, cloud: GaussianCloud) -> Planes:
        """The planes of `cloud`; InputError for values that the grids cannot hold."""
        units = self._units
        _check_range("positions", cloud.positions, units.position)
        _check_range("scales", cloud.scales, units.scale)
        _check_range("opacities", cloud.opacities, units.opacity)
        _check_range("sh_dc", cloud.sh_dc, units.color)
        _check_range("sh_rest", cloud.sh_rest, units.color)
        return wide_planes(state_of(cloud, units))


def _check_range(name: str, values: npt.NDArray[np.float32], exponent: int) -> None:
    """Refuse what would be clipped."""
    largest = float(np.abs(values).max()) if values.size else 0.0
    limit = STATE_LIMIT * 2.0**exponent
    if largest > limit:
        raise InputError(
            f"{name} reach {largest:g}, but the grid planned from the first frame ends at {limit:g}; "
            "remove such Gaussians or choose coarser steps (a higher --qp or --bound)"
        )

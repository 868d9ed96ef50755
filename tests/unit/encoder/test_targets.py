from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dfcgs_codec.bitstream.constants import STATE_LIMIT, Attribute
from dfcgs_codec.bitstream.sequence_header import UnitExponents
from dfcgs_codec.codec.verbatim import state_of
from dfcgs_codec.encoder.targets import Targets, ordered
from dfcgs_codec.errors import InputError
from tests.helpers import make_cloud

UNITS = UnitExponents(-10, -12, -12, -14)


def test_planes_are_those_of_the_state() -> None:
    cloud = make_cloud(30, 2)
    planes = Targets(UNITS).planes(cloud)
    for attribute, plane in state_of(cloud, UNITS).planes.items():
        assert planes[attribute].dtype == np.int64
        assert np.array_equal(planes[attribute], plane.values)


@pytest.mark.parametrize(
    ("field", "exponent"),
    [("positions", -10), ("scales", -12), ("opacities", -12), ("sh_dc", -14), ("sh_rest", -14)],
)
@pytest.mark.parametrize("sign", [-1, 1])
def test_what_would_be_clipped_is_refused_by_name(field: str, exponent: int, sign: int) -> None:
    cloud = make_cloud(10, 1)
    values = getattr(cloud, field).copy()
    values[4] = sign * STATE_LIMIT * 2.0**exponent * 0.999
    Targets(UNITS).planes(replace(cloud, **{field: values}))
    values[4] = sign * STATE_LIMIT * 2.0**exponent * 1.001
    with pytest.raises(InputError, match=f"{field} reach"):
        Targets(UNITS).planes(replace(cloud, **{field: values}))


def test_ordered_keeps_attributes_together() -> None:
    planes = Targets(UNITS).planes(make_cloud(5))
    order = np.array([4, 0, 3, 1, 2])
    found = ordered(planes, order)
    for attribute in (Attribute.POSITION, Attribute.OPACITY):
        assert np.array_equal(found[attribute], planes[attribute][order])

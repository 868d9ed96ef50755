from __future__ import annotations

import numpy as np

from dfcgs_codec.bitstream.constants import Attribute
from dfcgs_codec.bitstream.sequence_header import UnitExponents
from dfcgs_codec.codec.intra.verbatim import state_of
from dfcgs_codec.encoder.frame.targets import Targets, ordered
from lab.small_clouds import make_cloud

UNITS = UnitExponents(-10, -12, -12, -14)


def test_planes_are_those_of_the_state() -> None:
    cloud = make_cloud(30, 2)
    planes = Targets(UNITS).planes(cloud)
    for attribute, plane in state_of(cloud, UNITS).planes.items():
        assert planes[attribute].dtype == np.int64
        assert np.array_equal(planes[attribute], plane.values)


def test_ordered_keeps_attributes_together() -> None:
    planes = Targets(UNITS).planes(make_cloud(5))
    order = np.array([4, 0, 3, 1, 2])
    found = ordered(planes, order)
    for attribute in (Attribute.POSITION, Attribute.OPACITY):
        assert np.array_equal(found[attribute], planes[attribute][order])

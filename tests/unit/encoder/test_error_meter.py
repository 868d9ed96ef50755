from __future__ import annotations

from dataclasses import replace

import numpy as np

from dfcgs_codec.bitstream.constants import Attribute
from dfcgs_codec.bitstream.sequence_header import UnitExponents
from dfcgs_codec.codec.state.planes import FrameState, Plane
from dfcgs_codec.encoder.frame.error_meter import ErrorMeter
from dfcgs_codec.encoder.frame.targets import Targets
from dfcgs_codec.encoder.matching.canonical import choose_axis_names
from dfcgs_codec.encoder.matching.identity import Members
from lab.small_clouds import make_cloud

UNITS = UnitExponents(-12, -14, -14, -14)


def test_errors_are_those_of_the_decoded_values() -> None:
    cloud = make_cloud(60, 2)
    planes = Targets(UNITS).planes(cloud)
    rows = np.random.default_rng(0).permutation(60)
    members = Members(rows, choose_axis_names(planes).take(rows))
    target = members.target(planes)
    planes_of_state = {a: Plane(values) for a, values in target.items()}
    meter = ErrorMeter(UNITS)
    exact = meter.measure(cloud, members, target, FrameState(planes_of_state))
    assert max(statistics.maximum for statistics in exact.values()) < 1e-3
    shifted = target[Attribute.POSITION] + np.array([3 << 12, 0, 4 << 12])
    state = FrameState(planes_of_state | {Attribute.POSITION: Plane(shifted)})
    found = meter.measure(cloud, members, target, state)
    assert abs(found["position"].mean - 5) < 1e-3
    # what did not change is not measured again
    assert all(found[name] is exact[name] for name in exact if name != "position")


def test_float_values_are_not_taken_for_the_grid_s() -> None:
    cloud = make_cloud(30)
    coarse = UnitExponents(-4, -12, -12, -12)
    members, meter = Members(np.arange(30), None), ErrorMeter(coarse)
    target = members.target(Targets(coarse).planes(cloud))
    state = FrameState({a: Plane(values) for a, values in target.items()}, verbatim=cloud)
    assert meter.measure(cloud, members, target, state)["position"].maximum == 0
    after = meter.measure(cloud, members, target, replace(state, verbatim=None))
    assert after["position"].maximum > 0.01


def test_another_input_is_measured_again() -> None:
    cloud = make_cloud(30)
    targets, members, meter = Targets(UNITS), Members(np.arange(30), None), ErrorMeter(UNITS)
    planes = targets.planes(cloud)
    target = members.target(planes)
    state = FrameState({a: Plane(values) for a, values in target.items()})
    assert meter.measure(cloud, members, target, state)["colour"].maximum < 1e-3
    brighter = replace(cloud, sh_dc=cloud.sh_dc + 1)
    again = members.target(targets.planes(brighter), (planes, target))
    assert again[Attribute.POSITION] is target[Attribute.POSITION]
    assert meter.measure(brighter, members, again, state)["colour"].maximum > 0.28

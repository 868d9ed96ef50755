from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dfcgs_codec.bitstream.constants import Attribute
from dfcgs_codec.bitstream.sequence_header import UnitExponents
from dfcgs_codec.codec.intra.verbatim import state_of
from dfcgs_codec.codec.state.planes import FrameState, Plane, output
from dfcgs_codec.encoder.matching.canonical import choose_axis_names
from dfcgs_codec.gaussians import GaussianCloud
from lab.small_clouds import make_cloud
from tests.helpers import covariances, rotation_degrees, shape_errors

UNITS = UnitExponents(-20, -20, -20, -20)


def planes_of(cloud: GaussianCloud) -> dict[Attribute, np.ndarray]:
    return {a: p.wide() for a, p in state_of(cloud, UNITS).planes.items()}


def renamed(cloud: GaussianCloud) -> GaussianCloud:
    planes = planes_of(cloud)
    found = choose_axis_names(planes).rename(planes)
    return output(FrameState({a: Plane(v) for a, v in found.items()}), UNITS)


@pytest.fixture(scope="module")
def cloud() -> GaussianCloud:
    return make_cloud(2000)


def test_the_covariance_is_the_same(cloud: GaussianCloud) -> None:
    before, after = covariances(cloud), covariances(renamed(cloud))
    size = np.abs(before).max(axis=(1, 2))
    assert (np.abs(after - before).max(axis=(1, 2)) / size).max() < 1e-4


def test_the_shape_is_the_same_under_another_name(cloud: GaussianCloud) -> None:
    degrees, scales = shape_errors(cloud, renamed(cloud))
    assert degrees.max() < 1e-4
    assert scales.max() < 1e-5


def test_scales_fall_and_w_is_largest(cloud: GaussianCloud) -> None:
    found = renamed(cloud)
    assert (np.diff(found.scales, axis=1) <= 0).all()
    magnitude = np.abs(found.rotations)
    assert (magnitude[:, 0] >= magnitude.max(axis=1) - 1e-6).all()


def test_nothing_but_axes_changes(cloud: GaussianCloud) -> None:
    planes = planes_of(cloud)
    found = choose_axis_names(planes).rename(planes)
    for attribute in (Attribute.POSITION, Attribute.OPACITY, Attribute.SH_DC):
        assert found[attribute] is planes[attribute]


def test_all_names_of_a_gaussian_become_one() -> None:
    cloud = replace(make_cloud(1), scales=np.array([[-3, -4, -6]], np.float32))
    target = renamed(cloud)
    for turn in Rotation.create_group("O"):
        axes = np.abs(turn.as_matrix()).argmax(axis=0)
        q = (Rotation.from_quat(cloud.rotations[:, [1, 2, 3, 0]]) * turn).as_quat()[:, [3, 0, 1, 2]]
        other = replace(cloud, rotations=q.astype(np.float32), scales=cloud.scales[:, axes])
        assert np.allclose(covariances(other), covariances(cloud), rtol=1e-4, atol=1e-9)
        assert np.array_equal(renamed(other).scales, target.scales)
        q_target, q_other = target.rotations[0], renamed(other).rotations[0]
        assert min(np.abs(q_target - q_other).max(), np.abs(q_target + q_other).max()) < 1e-5


def test_names_of_one_frame_can_be_carried_to_another(cloud: GaussianCloud) -> None:
    names = choose_axis_names(planes_of(cloud))
    other = make_cloud(2000, 0, 9)
    found = names.rename(planes_of(other))
    after = output(FrameState({a: Plane(v) for a, v in found.items()}), UNITS)
    size = np.abs(covariances(other)).max(axis=(1, 2))
    assert (np.abs(covariances(after) - covariances(other)).max(axis=(1, 2)) / size).max() < 1e-4


def test_floats_are_renamed_like_integers(cloud: GaussianCloud) -> None:
    names = choose_axis_names(planes_of(cloud))
    found = replace(
        cloud, scales=names.rename_scales(cloud.scales), rotations=names.rename_rotations(cloud.rotations)
    )
    expected = renamed(cloud)
    assert np.abs(found.scales - expected.scales).max() < 1e-5
    assert rotation_degrees(found, expected).max() < 1e-4
    assert np.allclose(covariances(found), covariances(cloud), rtol=1e-4, atol=1e-9)


@pytest.mark.parametrize("length", [1e-30, 1e30, 3e38])
def test_the_length_of_a_quaternion_does_not_matter(cloud: GaussianCloud, length: float) -> None:
    largest = np.abs(cloud.rotations).max(axis=1, keepdims=True)
    other = replace(cloud, rotations=(cloud.rotations / largest) * np.float32(length))
    names = choose_axis_names(planes_of(other))
    assert np.isfinite(other.rotations).all()
    found = replace(other, rotations=names.rename_rotations(other.rotations))
    assert rotation_degrees(found, renamed(other)).max() < 1e-3


def test_equal_scales_are_left_in_order() -> None:
    cloud = replace(make_cloud(50), scales=np.full((50, 3), -4, np.float32))
    order = choose_axis_names(planes_of(cloud)).order
    assert (order == [0, 1, 2]).all()

"""Ellipses in images, against the formulas written out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dfcgs_codec.encoder.images.projection import BLUR, project
from dfcgs_codec.encoder.images.splats import Splats
from dfcgs_codec.gaussians import GaussianCloud
from dfcgs_codec.views.camera import ViewCamera
from lab.small_clouds import make_cloud
from lab.small_room import gaussians, looking
from tests.helpers import covariances

CAMERA = looking((1.0, -2.0, -6.0), (0.1, 0.2, 0.3), (320, 240), 250.0)


def written_out(cloud: GaussianCloud, camera: ViewCamera) -> tuple[np.ndarray, np.ndarray]:
    """Middles (N, 2) and covariances (N, 2, 2) by the derivative of the projection."""
    x, y, z = local = (cloud.positions @ camera.rotation.T + camera.world_to_camera[:3, 3]).T
    middles = np.stack([camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy], axis=1)
    shapes = []
    for (px, py, pz), world in zip(local.T, covariances(cloud), strict=True):
        slope = np.array(
            [[camera.fx / pz, 0, -camera.fx * px / pz**2], [0, camera.fy / pz, -camera.fy * py / pz**2]]
        )
        turned = slope @ camera.rotation
        shapes.append(turned @ world @ turned.T + BLUR * np.eye(2))
    return middles, np.array(shapes)


def test_ellipses_are_those_of_the_projection_s_derivative() -> None:
    cloud = replace(make_cloud(50), positions=make_cloud(50).positions * np.float32(0.4))
    camera = ViewCamera(320, 240, 250.0, 300.0, 155.0, 131.0, CAMERA.world_to_camera)
    found = project(Splats.of(cloud), camera, 0.01)
    middles, shapes = written_out(cloud, camera)
    assert found.middle == pytest.approx(middles, rel=1e-6)
    for name, i, j in (("a", 0, 0), ("b", 0, 1), ("c", 1, 1)):
        assert getattr(found, name) == pytest.approx(shapes[:, i, j], rel=1e-4, abs=1e-3)
    assert found.is_before.all()


def test_only_what_is_before_the_camera_has_a_place() -> None:
    points = np.array([[0, 0, 0], [2.0, -4.2, -12.3]])
    found = project(Splats.of(gaussians(points, 0.1, 0.9)), CAMERA, 0.01)
    assert found.is_before.tolist() == [True, False]
    assert found.depth[0] == pytest.approx(CAMERA.rotation[2] @ (points[0] - CAMERA.position))
    reach = found.reach(np.array([0.9, 0.9]))
    assert (reach[0] > 0).all()
    assert (reach[1] == -np.inf).all()


def test_the_reach_is_where_the_least_opacity_is_drawn() -> None:
    found = project(Splats.of(gaussians(np.zeros((3, 3)), 0.1, 0.9)), CAMERA, 0.01)
    alpha = np.array([0.9, 0.01, 0.5 / 255])
    reach = found.reach(alpha)
    for row in (0, 1):
        edge = alpha[row] * np.exp(-0.5 * reach[row] ** 2 / np.array([found.a[row], found.c[row]]))
        assert edge == pytest.approx(1 / 255)
    assert (reach[2] == -np.inf).all(), "never drawn"


def test_projections_far_aside_stay_finite() -> None:
    # all but in the plane of the camera
    forward, right = CAMERA.rotation[2], CAMERA.rotation[0]
    points = np.stack([CAMERA.position + 0.02 * forward + away * right for away in (0.0, 1.0, 1e3)])
    found = project(Splats.of(gaussians(points, 0.5, 0.9)), CAMERA, 0.01)
    assert np.isfinite([found.a, found.b, found.c]).all()
    assert (found.a * found.c > found.b**2).all()

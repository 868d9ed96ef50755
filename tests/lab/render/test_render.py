"""The renderer on cases whose answer is known by hand; cameras; refusals."""

from __future__ import annotations

import math

import numpy as np
import pytest

pytest.importorskip("numba", reason="the renderer is compiled by numba, from the eval extra")

from lab.render import Camera, look_at, orbit, render, render_backward
from tests.lab.render.render_scenes import forward_camera, plain_cloud, random_cloud

RED, GREEN, BLUE = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
GREY = (0.25, 0.5, 0.75)


def test_one_gaussian_at_the_centre_is_the_formula():
    camera = forward_camera()
    found = render(plain_cloud([[0, 0, 4]], [RED], [0.8], [0.2]), camera, GREY)
    y, x = np.mgrid[-16:17, -16:17]
    variance = (40.0 / 4 * 0.2) ** 2 + 0.3
    alpha = 0.8 * np.exp(-(x * x + y * y) / (2 * variance))
    alpha[alpha < 1 / 255] = 0
    np.testing.assert_allclose(found.alpha, alpha, atol=1e-6)
    expected = alpha[:, :, None] * RED + (1 - alpha[:, :, None]) * GREY
    np.testing.assert_allclose(found.colour, expected, atol=1e-6)
    assert found.colour.shape == (33, 33, 3)
    assert found.colour.dtype == found.alpha.dtype == np.float32


@pytest.mark.parametrize("order", [[0, 1], [1, 0]])
def test_the_nearer_gaussian_covers_the_farther_in_any_order_of_the_cloud(order):
    positions, colours = np.array([[0, 0, 2], [0, 0, 5]]), np.array([RED, BLUE])
    cloud = plain_cloud(positions[order], colours[order], [0.6, 0.6], [0.3, 0.3])
    middle = render(cloud, forward_camera()).colour[16, 16]
    np.testing.assert_allclose(middle, [0.6, 0, 0.4 * 0.6], atol=1e-5)


def test_equal_depths_are_drawn_in_the_order_of_the_cloud():
    cloud = plain_cloud([[0, 0, 3]] * 3, [GREEN, RED, BLUE], [0.5] * 3, [0.3] * 3)
    np.testing.assert_allclose(render(cloud, forward_camera()).colour[16, 16], [0.25, 0.5, 0.125], atol=1e-5)


def test_two_gaussians_at_the_alpha_cap_end_at_the_transmittance_stop():
    cloud = plain_cloud([[0, 0, 2], [0, 0, 3]], [RED, GREEN], [0.99999, 0.99999], [0.5, 0.5])
    rendering = render(cloud, forward_camera(), (0, 0, 1))
    # 0.001 is left after the first; the second would leave 1e-6, so it is left out
    np.testing.assert_allclose(rendering.colour[16, 16], [0.999, 0, 0.001], atol=1e-6)


@pytest.mark.parametrize("position", [[0, 0, -3], [0, 0, 0], [0, 0, 0.005], [900, 0, 3], [0, -900, 3]])
def test_what_the_camera_cannot_see_is_the_background(position):
    cloud = plain_cloud([position], [RED], [0.9], [0.1])
    rendering = render(cloud, forward_camera(), GREY)
    assert (rendering.colour == np.float32(GREY)).all()
    assert (rendering.alpha == 0).all()
    for array in render_backward(rendering, np.ones((33, 33, 3), np.float32)):
        assert not array.any()


def test_zero_opacity_is_the_background():
    cloud = plain_cloud([[0, 0, 3]], [RED], [1e-9], [0.3])
    assert (render(cloud, forward_camera(), GREY).colour == np.float32(GREY)).all()


def test_a_tiny_gaussian_is_the_low_pass_filter():
    found = render(plain_cloud([[0, 0, 4]], [RED], [0.8], [1e-12]), forward_camera()).alpha
    assert found[16, 16] == pytest.approx(0.8, abs=1e-6)
    assert found[16, 17] == pytest.approx(0.8 * math.exp(-1 / 0.6), abs=1e-6)
    assert (found > 0).sum() == 9


@pytest.mark.parametrize("deviation", [1e3, 1e6])
def test_a_huge_gaussian_fills_the_image(deviation):
    rendering = render(plain_cloud([[0, 0, 4]], [RED], [0.8], [deviation]), forward_camera(50, 20))
    np.testing.assert_allclose(rendering.alpha, 0.8, atol=1e-5)
    assert all(np.isfinite(a).all() for a in render_backward(rendering, np.ones((20, 50, 3), np.float32)))


def test_a_long_thin_diagonal_gaussian_keeps_its_width():
    """Its covariance cancels in float32: 1e8 along, 0.3 across."""
    cloud = plain_cloud([[0, 0, 4]], [RED], [0.8], [1e3])
    turn = np.radians(45 / 2)
    cloud.rotations[:] = [np.cos(turn), 0, 0, np.sin(turn)]
    cloud.scales[0, 1:] = -20
    alpha = render(cloud, forward_camera()).alpha
    distance = np.abs(np.subtract(*np.mgrid[0:33, 0:33])) / math.sqrt(2)
    expected = 0.8 * np.exp(-(distance**2) / 0.6)
    expected[expected < 1 / 255] = 0
    np.testing.assert_allclose(alpha, expected, atol=1e-4)


def test_an_empty_cloud_is_the_background():
    rendering = render(random_cloud(0), forward_camera(), GREY)
    assert (rendering.colour == np.float32(GREY)).all()
    assert render_backward(rendering, rendering.colour).positions.shape == (0, 3)


def test_values_that_are_not_finite_are_not_drawn():
    cloud = random_cloud(6, 0)
    cloud.positions[0, 1] = np.nan
    cloud.scales[1, 0] = np.inf
    cloud.rotations[2] = 0
    cloud.rotations[3, 0] = np.nan
    cloud.opacities[4] = np.nan
    cloud.positions[5] = np.inf
    rendering = render(cloud, orbit((0, 0, 0), 3.0, (10, 10), (40, 30)), GREY)
    assert (rendering.colour == np.float32(GREY)).all()


def test_a_gaussian_across_tile_borders_has_no_seam():
    """Shifted by half a tile it must look the same."""
    cloud = plain_cloud([[0, 0, 4]], [GREEN], [0.9], [0.6])
    one = render(cloud, forward_camera(64, 64)).colour
    other = render(cloud, Camera(np.eye(4), 40, 40, 32 + 8, 32 + 8, 64, 64)).colour
    np.testing.assert_allclose(one[:-8, :-8], other[8:, 8:], atol=1e-6)


def test_look_at_puts_the_target_in_the_middle_and_up_above():
    camera = look_at((1, 2, 3), (4, 0, -1), (80, 60), 40.0, (0, 0, 1))
    np.testing.assert_allclose(camera.position, [1, 2, 3], atol=1e-12)
    point = camera.world_to_camera @ [4, 0, -1, 1]
    np.testing.assert_allclose(point[:2], 0, atol=1e-12)
    assert point[2] == pytest.approx(math.sqrt(29))
    assert (camera.world_to_camera @ [4, 0, 0, 1])[1] < 0
    assert camera.fy == pytest.approx(30 / math.tan(math.radians(20)))


@pytest.mark.parametrize("up", [(0, 1, 0), (0, -1, 0), (0, 0, 2), (1, 1, 1)])
def test_orbit_keeps_distance_and_elevation(up):
    target = np.array([0.5, -1.0, 2.0])
    for azimuth in (0, 90, 200):
        camera = orbit(target, 3.0, (azimuth, 25.0), (8, 8), up=up)
        offset = camera.position - target
        assert np.linalg.norm(offset) == pytest.approx(3.0)
        assert offset @ up == pytest.approx(3 * math.sin(math.radians(25)) * np.linalg.norm(up))


def test_orbit_turns_counter_clockwise_seen_from_up():
    here, there = (orbit((0, 0, 0), 1.0, (a, 0.0), (8, 8)).position for a in (0, 90))
    np.testing.assert_allclose(np.cross(here, there), [0, 1, 0], atol=1e-12)


@pytest.mark.parametrize(
    ("matrix", "size", "message"),
    [
        (np.eye(3), (8, 8), "expected \\(4, 4\\)"),
        (np.diag([1, 1, 2, 1]), (8, 8), "not a rotation"),
        (np.diag([1, 1, -1, 1]), (8, 8), "not a rotation"),
        (np.eye(4) + np.diag([np.nan] * 1, 3), (8, 8), "not finite"),
        (np.eye(4), (0, 8), "must be positive"),
    ],
)
def test_impossible_cameras_are_refused(matrix, size, message):
    with pytest.raises(ValueError, match=message):
        Camera(matrix, 10, 10, 4, 4, *size)


def test_looking_along_up_is_refused():
    with pytest.raises(ValueError, match="line of sight"):
        look_at((0, 1, 0), (0, 5, 0), (8, 8))


def test_wrong_shapes_are_refused():
    rendering = render(random_cloud(3), forward_camera())
    with pytest.raises(ValueError, match="expected \\(33, 33, 3\\)"):
        render_backward(rendering, np.ones((33, 32, 3), np.float32))
    with pytest.raises(ValueError, match="background"):
        render(random_cloud(3), forward_camera(), (0, 0))

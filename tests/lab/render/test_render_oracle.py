"""Images and gradients against a dense float64 renderer with autograd."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("numba", reason="the renderer is compiled by numba, from the eval extra")
torch = pytest.importorskip("torch", reason="the oracle needs torch, from the train extra")

from lab.render import Camera, render, render_backward  # noqa: E402
from tests.lab.render.render_oracle import leaves, render_oracle  # noqa: E402
from tests.lab.render.render_scenes import plain_cloud, random_cloud, side_camera  # noqa: E402

BACKGROUND = (0.2, 0.5, 0.9)
NAMES = ("positions", "rotations", "scales", "opacities", "sh_dc", "sh_rest")


def _inside(camera: Camera) -> Camera:
    """The same view from within the cloud: large, near, off-screen and hidden Gaussians."""
    matrix = camera.world_to_camera.copy()
    matrix[2, 3] = 0.3
    return Camera(
        matrix, camera.fx, 1.2 * camera.fy, camera.cx - 5, camera.cy + 3, camera.width, camera.height
    )


def _opaque(cloud):
    return cloud.__class__(*(getattr(cloud, n) + (6 if n == "opacities" else 0) for n in NAMES))


def _large(cloud):
    return cloud.__class__(*(getattr(cloud, n) + (2 if n == "scales" else 0) for n in NAMES))


CASES = {
    "degree 0": (random_cloud(150, 0, 1), side_camera()),
    "degree 1": (random_cloud(150, 1, 2), side_camera()),
    "degree 2": (random_cloud(150, 2, 3), side_camera()),
    "degree 3": (random_cloud(300, 3, 4), side_camera()),
    "within the cloud": (random_cloud(300, 3, 5), _inside(side_camera())),
    "opaque": (_opaque(random_cloud(300, 3, 6)), side_camera()),
    "large": (_large(random_cloud(60, 3, 7)), side_camera()),
    "one": (random_cloud(1, 3, 8), side_camera()),
    "one pixel": (random_cloud(50, 3, 9), side_camera(1, 1)),
}


@pytest.mark.parametrize("case", CASES)
def test_image_equals_oracle(case):
    cloud, camera = CASES[case]
    expected = render_oracle(leaves(cloud), camera, BACKGROUND)
    found = render(cloud, camera, BACKGROUND, threads=1)
    decided = ~expected.undecided.numpy()
    assert decided.mean() > 0.8
    error = np.abs(found.colour - expected.colour.detach().numpy())[decided]
    assert error.max() < 1e-4
    assert np.abs(found.alpha - expected.alpha.detach().numpy())[decided].max() < 1e-4


@pytest.mark.parametrize("case", CASES)
def test_gradient_equals_autograd(case):
    cloud, camera = CASES[case]
    tensors = leaves(cloud)
    expected = render_oracle(tensors, camera, BACKGROUND)
    rng = np.random.default_rng(1)
    weights = rng.normal(size=(camera.height, camera.width, 4)).astype(np.float32)
    # a pixel on which the two renderers may decide differently has no say
    weights[expected.undecided.numpy()] = 0
    image = torch.cat([expected.colour, expected.alpha[:, :, None]], 2)
    (image * torch.tensor(weights, dtype=torch.float64)).sum().backward()
    rendering = render(cloud, camera, BACKGROUND, threads=1)
    found = render_backward(rendering, weights[:, :, :3], weights[:, :, 3], threads=1)
    for name, tensor in zip(NAMES, tensors, strict=True):
        gradient = getattr(found, name)
        assert gradient.shape == getattr(cloud, name).shape
        target = np.zeros(gradient.shape) if tensor.grad is None else tensor.grad.numpy()
        assert np.linalg.norm(gradient - target) <= 1e-3 * np.linalg.norm(target), name


def test_gradient_of_each_gaussian_equals_autograd():
    """Relative per Gaussian, not only over all of them; few Gaussians, none hidden."""
    cloud, camera = random_cloud(25, 3, 11), side_camera()
    tensors = leaves(cloud)
    expected = render_oracle(tensors, camera, BACKGROUND)
    weights = np.where(expected.undecided.numpy()[:, :, None], 0, 1).astype(np.float32) * [1.0, -0.5, 2.0]
    (expected.colour * torch.tensor(weights)).sum().backward()
    found = render_backward(render(cloud, camera, BACKGROUND), weights)
    for name, tensor in zip(NAMES, tensors, strict=True):
        target = tensor.grad.numpy().reshape(25, -1)
        error = np.linalg.norm(getattr(found, name).reshape(25, -1) - target, axis=1)
        size = np.linalg.norm(target, axis=1)
        assert (error <= 1e-3 * size + 1e-5 * size.max()).all(), name


def test_occlusion_equals_oracle_with_equal_depths():
    cloud = plain_cloud([[0, 0, 0]] * 3, [[1, 0, 0], [0, 1, 0], [0, 0, 1]], [0.7] * 3, [0.2] * 3)
    camera = side_camera()
    expected = render_oracle(leaves(cloud), camera, BACKGROUND)
    found = render(cloud, camera, BACKGROUND)
    decided = ~expected.undecided.numpy()
    assert np.abs(found.colour - expected.colour.detach().numpy())[decided].max() < 1e-4

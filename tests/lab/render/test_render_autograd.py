"""The torch functions: the same figures, gradients that flow, no memory shared by accident."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("numba", reason="the renderer is compiled by numba, from the eval extra")
torch = pytest.importorskip("torch", reason="these are torch functions, from the train extra")

from lab.render import render, render_backward, ssim_with_gradient  # noqa: E402
from lab.render.autograd import cloud_tensors, render_tensors, ssim_tensors  # noqa: E402
from tests.lab.render.render_scenes import random_cloud, side_camera  # noqa: E402

BACKGROUND = (0.2, 0.5, 0.9)


def test_render_tensors_equals_render():
    cloud, camera = random_cloud(200), side_camera()
    tensors = cloud_tensors(cloud)
    colour, alpha = render_tensors(tensors, camera, BACKGROUND)
    rendering = render(cloud, camera, BACKGROUND)
    assert np.array_equal(colour.detach().numpy(), rendering.colour)
    assert np.array_equal(alpha.detach().numpy(), rendering.alpha)
    (2 * colour.sum() + 3 * alpha.sum()).backward()
    expected = render_backward(rendering, np.full_like(rendering.colour, 2), np.full_like(rendering.alpha, 3))
    for tensor, gradient in zip(tensors, expected, strict=True):
        assert np.array_equal(tensor.grad.numpy(), gradient)


def test_only_colour_or_only_alpha_may_be_used():
    camera = side_camera()
    for which in (0, 1):
        tensors = cloud_tensors(random_cloud(50))
        render_tensors(tensors, camera)[which].sum().backward()
        assert tensors[3].grad.abs().sum() > 0


def test_backward_is_not_disturbed_by_later_writes():
    cloud, camera = random_cloud(200), side_camera()
    gradients = []
    for disturb in (False, True):
        tensors = cloud_tensors(cloud)
        colour, _ = render_tensors(tensors, camera)
        total = (colour * 1.5).sum()
        if disturb:
            with torch.no_grad():
                colour.zero_()
                for tensor in tensors:
                    tensor.zero_()
        total.backward()
        gradients.append([tensor.grad.numpy().copy() for tensor in tensors])
    for one, other in zip(*gradients, strict=True):
        assert np.array_equal(one, other)


def test_ssim_tensors_equals_ssim():
    rng = np.random.default_rng(0)
    image, reference = (rng.random((20, 30, 3)).astype(np.float32) for _ in range(2))
    tensor = torch.tensor(image, requires_grad=True)
    value = ssim_tensors(tensor, torch.tensor(reference))
    (5 * value).backward()
    expected, gradient = ssim_with_gradient(image, reference)
    assert value.item() == pytest.approx(expected, abs=1e-7)
    np.testing.assert_allclose(tensor.grad.numpy(), 5 * gradient, rtol=1e-6)
    assert ssim_tensors(torch.tensor(image), torch.tensor(reference)).item() == value.item()


def test_a_few_steps_of_adam_bring_the_image_closer():
    camera = side_camera()
    target, _ = render_tensors(cloud_tensors(random_cloud(60, 1, 1)), camera)
    target = target.detach()
    rng = np.random.default_rng(4)
    tensors = cloud_tensors(random_cloud(60, 1, 1))
    with torch.no_grad():
        for tensor in tensors:
            tensor += torch.tensor(rng.normal(0, 0.05, tuple(tensor.shape)).astype(np.float32))
    optimiser = torch.optim.Adam(tensors, lr=0.01)
    losses = []
    for _ in range(30):
        optimiser.zero_grad()
        colour, _ = render_tensors(tensors, camera)
        loss = 0.8 * (colour - target).abs().mean() + 0.2 * (1 - ssim_tensors(colour, target))
        loss.backward()
        optimiser.step()
        losses.append(loss.item())
    assert losses[-1] < 0.4 * losses[0]

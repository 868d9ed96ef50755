"""SSIM against a plain float64 version, against scikit-image where it is installed, and its gradient."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import correlate1d

pytest.importorskip("numba", reason="SSIM is compiled by numba, from the eval extra")

from lab.render import ssim, ssim_with_gradient


def _images(height: int = 37, width: int = 53, channels: int = 3) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(3)
    smooth = correlate1d(rng.random((height, width, channels)), np.ones(5) / 5, axis=0)
    noisy = np.clip(smooth + rng.normal(0, 0.1, smooth.shape), 0, 1)
    return noisy.astype(np.float32), smooth.astype(np.float32)


def _plain_ssim(image: np.ndarray, reference: np.ndarray) -> float:
    a, b = image.astype(np.float64), reference.astype(np.float64)
    taps = np.exp(-(np.arange(-5, 6) ** 2) / (2 * 1.5**2))
    taps /= taps.sum()

    def mean(x: np.ndarray) -> np.ndarray:
        return correlate1d(correlate1d(x, taps, axis=0), taps, axis=1)[5:-5, 5:-5]

    ma, mb = mean(a), mean(b)
    va, vb, cov = mean(a * a) - ma * ma, mean(b * b) - mb * mb, mean(a * b) - ma * mb
    c1, c2 = 0.01**2, 0.03**2
    return float(np.mean((2 * ma * mb + c1) * (2 * cov + c2) / ((ma * ma + mb * mb + c1) * (va + vb + c2))))


@pytest.mark.parametrize("shape", [(37, 53, 3), (11, 11, 1), (11, 40, 3), (64, 12, 2)])
def test_ssim_equals_the_plain_formula(shape):
    image, reference = _images(*shape)
    assert ssim(image, reference) == pytest.approx(_plain_ssim(image, reference), abs=1e-5)


def test_ssim_equals_scikit_image():
    metrics = pytest.importorskip("skimage.metrics", reason="the reference is scikit-image")
    image, reference = _images()
    options = {"gaussian_weights": True, "sigma": 1.5, "use_sample_covariance": False}
    expected = metrics.structural_similarity(
        image.astype(np.float64), reference.astype(np.float64), data_range=1.0, channel_axis=2, **options
    )
    assert ssim(image, reference) == pytest.approx(expected, abs=1e-5)


def test_equal_images_have_ssim_one_and_a_flat_gradient():
    image, _ = _images()
    value, gradient = ssim_with_gradient(image, image)
    assert value == pytest.approx(1.0, abs=1e-6)
    assert np.abs(gradient).max() < 1e-6


def test_gradient_equals_finite_differences_of_the_plain_formula():
    image, reference = _images(16, 18)
    value, gradient = ssim_with_gradient(image, reference)
    assert value == ssim(image, reference)
    assert gradient.shape == image.shape
    step = 1e-5
    expected = np.empty(image.shape)
    for index in np.ndindex(*image.shape):
        moved = image.astype(np.float64)
        moved[index] += step
        up = _plain_ssim(moved, reference)
        moved[index] -= 2 * step
        expected[index] = (up - _plain_ssim(moved, reference)) / (2 * step)
    assert np.linalg.norm(gradient - expected) < 1e-3 * np.linalg.norm(expected)


@pytest.mark.parametrize("shape", [(10, 40, 3), (40, 10, 3), (40, 40)])
def test_wrong_shapes_are_refused(shape):
    image = np.zeros(shape, np.float32)
    with pytest.raises(ValueError, match="at least 11"):
        ssim(image, image)

"""SSIM (Wang et al. 2004) with its gradient: Gaussian window of 11 pixels, sigma 1.5, data range 1.

The figure equals scikit-image's `structural_similarity(gaussian_weights=True, sigma=1.5,
use_sample_covariance=False, data_range=1, channel_axis=2)` and pytorch-msssim's `ssim(data_range=1)`: only
windows that lie wholly inside the image count, and channels are averaged. torchmetrics, which pads, and
scikit-image's default, a 7 x 7 box, give other figures.
"""

from __future__ import annotations

import numpy as np

from dfcgs_codec.array_types import Float32
from lab.render.kernel import kernel, run_in_ranges

WINDOW = 11
SIGMA = 1.5
C1, C2 = np.float32(0.01**2), np.float32(0.03**2)
_taps = np.exp(-((np.arange(WINDOW) - WINDOW // 2) ** 2) / (2 * SIGMA**2))
TAPS = (_taps / _taps.sum()).astype(np.float32)


def ssim(image: Float32, reference: Float32, threads: int | None = None) -> float:
    """Mean SSIM of two (H, W, C) images with values in [0, 1]; H and W at least 11."""
    planes, gradient = _planes(image, reference), np.empty((0, 0, 0), np.float32)
    return _mean_ssim(planes, gradient, threads)


def ssim_with_gradient(
    image: Float32, reference: Float32, threads: int | None = None
) -> tuple[float, Float32]:
    """`ssim`, and its gradient by `image`, (H, W, C) float32."""
    planes = _planes(image, reference)
    gradient = np.empty_like(planes[0])
    value = _mean_ssim(planes, gradient, threads)
    return value, np.ascontiguousarray(gradient.transpose(1, 2, 0))


def _planes(image: Float32, reference: Float32) -> tuple[Float32, Float32]:
    if image.shape != reference.shape or image.ndim != 3 or min(image.shape[:2]) < WINDOW:
        raise ValueError(
            f"ssim: found images of shape {image.shape} and {reference.shape}, "
            f"expected two (H, W, C) with H and W at least {WINDOW}"
        )
    planes = [np.ascontiguousarray(np.moveaxis(a, 2, 0), dtype=np.float32) for a in (image, reference)]
    return planes[0], planes[1]


def _mean_ssim(planes: tuple[Float32, Float32], gradient: Float32, threads: int | None) -> float:
    channels, height, width = planes[0].shape
    sums = np.zeros(channels, np.float64)
    run_in_ranges(_ssim_range, channels, 1, threads, planes[0], planes[1], TAPS, sums, gradient)
    return float(sums.sum() / (channels * (height - WINDOW + 1) * (width - WINDOW + 1)))


@kernel
def _ssim_range(first, stop, images, references, taps, sums, gradient):
    channels, height, width = images.shape
    inner = (height - WINDOW + 1, width - WINDOW + 1)
    scale = np.float32(1.0 / (channels * inner[0] * inner[1]))
    row = np.empty(width + WINDOW - 1, np.float32)
    maps = np.empty((5, inner[0], inner[1]), np.float32)
    for channel in range(first, stop):
        a, b = images[channel], references[channel]
        _blur(a, row, taps, maps[0])
        _blur(b, row, taps, maps[1])
        _blur(a * a, row, taps, maps[2])
        _blur(b * b, row, taps, maps[3])
        _blur(a * b, row, taps, maps[4])
        sums[channel] = _ssim_map(maps)
        if len(gradient) > 0:
            _ssim_gradient(a, b, maps, row, taps, gradient[channel])
            gradient[channel] *= scale


@kernel
def _ssim_map(maps):
    """Sum of the SSIM map; overwrites maps 0, 2 and 4 with its derivatives by the means of a, a^2 and a b."""
    total = 0.0
    for i in range(maps.shape[1]):
        for j in range(maps.shape[2]):
            u, v = maps[0, i, j], maps[1, i, j]
            luminance = np.float32(2) * u * v + C1
            structure = np.float32(2) * (maps[4, i, j] - u * v) + C2
            power = u * u + v * v + C1
            variance = maps[2, i, j] + maps[3, i, j] - u * u - v * v + C2
            inverse = np.float32(1) / (power * variance)
            value = luminance * structure * inverse
            total += value
            maps[0, i, j] = (
                np.float32(2) * inverse * (v * (structure - luminance) - u * value * (variance - power))
            )
            maps[2, i, j] = -value / variance
            maps[4, i, j] = np.float32(2) * luminance * inverse
    return total


@kernel
def _ssim_gradient(a, b, maps, row, taps, out):
    """The gradient by a: the blur is its own adjoint, on maps padded with zeros."""
    edge = WINDOW - 1
    padded = np.zeros((maps.shape[1] + 2 * edge, maps.shape[2] + 2 * edge), np.float32)
    blurred = np.empty(a.shape, np.float32)
    padded[edge:-edge, edge:-edge] = maps[0]
    _blur(padded, row, taps, out)
    padded[edge:-edge, edge:-edge] = maps[2]
    _blur(padded, row, taps, blurred)
    for i in range(a.shape[0]):
        for j in range(a.shape[1]):
            out[i, j] += np.float32(2) * a[i, j] * blurred[i, j]
    padded[edge:-edge, edge:-edge] = maps[4]
    _blur(padded, row, taps, blurred)
    for i in range(a.shape[0]):
        for j in range(a.shape[1]):
            out[i, j] += b[i, j] * blurred[i, j]


@kernel
def _blur(plane, row, taps, out):
    """The windowed mean, (H, W) -> (H - 10, W - 10); row: scratch of at least W values."""
    width = plane.shape[1]
    for i in range(out.shape[0]):
        row[:] = 0
        for k in range(WINDOW):
            _add_scaled(taps[k], plane[i + k], row, width)
        out[i] = 0
        for k in range(WINDOW):
            _add_scaled(taps[k], row[k:], out[i], out.shape[1])


@kernel
def _add_scaled(factor, source, target, count):
    for j in range(count):
        target[j] += factor * source[j]

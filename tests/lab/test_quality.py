"""Identical-source quality and attribute errors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("numba")

from lab.attribute_errors import attribute_errors, mutual_pairs
from lab.quality import FrameQuality, Image, frame_quality, image, summary
from lab.render import orbit
from lab.scenes.stress import blob_cloud

CLOUD = blob_cloud(300, 1, 0)
CAMERAS = [orbit((0, 0, 0), 4.0, (angle, 20.0), (64, 48)) for angle in (0.0, 120.0)]


def flat(colour: float, alpha: float) -> Image:
    return Image(np.full((16, 16, 3), colour, np.float32), np.full((16, 16), alpha, np.float32))


def test_equal_images_have_no_error() -> None:
    sources = [image(CLOUD, camera) for camera in CAMERAS]
    figures = summary([frame_quality(0, sources, CLOUD, CAMERAS)])
    assert figures["psnr"] is None
    assert figures["mse"] == 0.0
    assert figures["ssim"] == pytest.approx(1.0)


def test_psnr_counts_visible_pixels_only() -> None:
    """A tenth of an error on the left half, where something is; the empty right half counts in full only."""
    source, decoded = flat(0.0, 0.0), flat(0.0, 0.0)
    source.alpha[:, :8] = 1.0
    decoded.colour[:, :8] = 0.1
    quality = FrameQuality(0)
    quality.add(source, decoded)
    figures = summary([quality])
    assert figures["psnr"] == pytest.approx(20.0, abs=1e-4)
    assert figures["psnr_full_frame"] == pytest.approx(20.0 + 10 * np.log10(2), abs=1e-4)


def test_every_pixel_of_a_capture_counts() -> None:
    quality = FrameQuality(0, every_pixel=True)
    quality.add(flat(0.0, 0.0), flat(0.0, 0.0))
    quality.add(flat(0.0, 1.0), flat(0.1, 1.0))
    figures = summary([quality])
    assert figures["psnr"] == figures["psnr_full_frame"] == pytest.approx(20.0 + 10 * np.log10(2), abs=1e-4)


def test_a_pixel_that_only_the_decoded_image_covers_counts() -> None:
    source, decoded = flat(0.0, 0.0), flat(0.5, 1.0)
    quality = FrameQuality(0)
    quality.add(source, decoded)
    assert summary([quality])["mse"] == pytest.approx(0.25)


def test_errors_are_pooled_and_the_worst_frame_is_named() -> None:
    frames = []
    for index, error in enumerate((0.1, 0.2, 0.0)):
        quality = FrameQuality(5 * index)
        quality.add(flat(0.0, 1.0), flat(error, 1.0))
        frames.append(quality)
    figures = summary(frames)
    assert figures["mse"] == pytest.approx((0.01 + 0.04) / 3)
    assert figures["worst_frame"] == 5
    assert figures["psnr_by_frame"]["10"] is None


def test_order_does_not_matter() -> None:
    order = np.random.default_rng(0).permutation(CLOUD.num_gaussians)
    moved = replace(CLOUD, positions=CLOUD.positions + np.float32(1e-3))
    errors = attribute_errors(CLOUD, moved.take(order))
    assert errors["matched_share"] == 1.0
    assert errors["position"]["max"] == pytest.approx(1e-3 * 3**0.5, rel=1e-3)
    assert errors["alpha"]["max"] == 0.0
    mine, theirs = mutual_pairs(CLOUD, moved.take(order))
    assert np.array_equal(order[theirs], mine)


def test_renamed_axes_are_no_error() -> None:
    """The axes in cyclic order and the quaternion that undoes it: the same Gaussian."""
    turn = np.array([0.5, 0.5, 0.5, 0.5])
    w, x, y, z = CLOUD.rotations.astype(np.float64).T
    a, b, c, d = turn
    product = np.stack(
        [
            w * a - x * b - y * c - z * d,
            w * b + x * a + y * d - z * c,
            w * c - x * d + y * a + z * b,
            w * d + x * c - y * b + z * a,
        ],
        axis=1,
    )
    # the turn takes axis 0 to 1, 1 to 2, 2 to 0
    renamed = replace(CLOUD, rotations=product.astype(np.float32), scales=CLOUD.scales[:, [1, 2, 0]])
    errors = attribute_errors(CLOUD, renamed)
    assert errors["covariance"]["max"] < 1e-5
    wrong = replace(CLOUD, scales=CLOUD.scales[:, [1, 2, 0]])
    assert attribute_errors(CLOUD, wrong)["covariance"]["rms"] > 0.1

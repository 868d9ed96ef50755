"""The cameras around the stage, the images they take of the truth, and PSNR against them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dfcgs_codec.array_types import Bool, Float32, Float64
from dfcgs_codec.gaussians import GaussianCloud
from lab.render import Camera, View, orbit, render
from training.fitting.sequences import TrueFrame

NUM_TRAINING, NUM_HELD_OUT = 20, 4
#: width and height, pixels
IMAGE_SIZE = (400, 300)
BACKGROUND = (0.45, 0.5, 0.55)
#: scene units and degrees
TARGET = (0.0, 1.0, 0.1)
DISTANCE = 5.0
FIELD_OF_VIEW = 42.0
ELEVATIONS = (6.0, 36.0, 20.0)
HELD_OUT_ELEVATIONS = (13.0, 28.0)
#: SH of degree 0 is this times f_dc, plus 0.5
SH_C0 = 0.28209479177387814


def training_cameras(size: tuple[int, int] = IMAGE_SIZE) -> list[Camera]:
    """A ring of cameras at three heights."""
    return [_camera(360.0 * i / NUM_TRAINING, ELEVATIONS[i % 3], size) for i in range(NUM_TRAINING)]


def held_out_cameras(size: tuple[int, int] = IMAGE_SIZE) -> list[Camera]:
    """Cameras between those of the fit."""
    step = 360.0 / NUM_HELD_OUT
    between = 180.0 / NUM_TRAINING
    return [_camera(step * i + between, HELD_OUT_ELEVATIONS[i % 2], size) for i in range(NUM_HELD_OUT)]


def _camera(azimuth: float, elevation: float, size: tuple[int, int]) -> Camera:
    return orbit(TARGET, DISTANCE, (azimuth, elevation), size, FIELD_OF_VIEW)


def take_views(truth: TrueFrame, cameras: list[Camera]) -> list[View]:
    """What the cameras see of the truth."""
    return [View(camera, picture(truth.cloud, camera), BACKGROUND) for camera in cameras]


def picture(
    cloud: GaussianCloud, camera: Camera, background: tuple[float, float, float] = BACKGROUND
) -> Float32:
    """(H, W, 3) image of a cloud in front of a background, clipped to [0, 1]."""
    return np.minimum(render(cloud, camera, background).colour, 1)


def painted(cloud: GaussianCloud, colours: Float32) -> GaussianCloud:
    """The cloud in the colours (N, 3), the same from all sides."""
    dc = np.ascontiguousarray((colours - 0.5) / SH_C0, dtype=np.float32)
    return replace(cloud, sh_dc=dc, sh_rest=np.zeros((cloud.num_gaussians, 3, 0), np.float32))


def character_mask(truth: TrueFrame, camera: Camera) -> Bool:
    """(H, W): the pixels that show the character more than all else."""
    colours = np.repeat(truth.is_character[:, None], 3, axis=1)
    return render(painted(truth.cloud, colours), camera).colour[:, :, 0] > 0.5


def psnr(cloud: GaussianCloud, views: Sequence[View], masks: Sequence[Bool] | None = None) -> float:
    """PSNR in dB, squared errors pooled over the views; masks: the pixels that count, None for all."""
    errors = [
        ((picture(cloud, view.camera, view.background) - view.image).astype(np.float64) ** 2)[
            ... if masks is None else masks[i]
        ]
        for i, view in enumerate(views)
    ]
    return _decibels(np.concatenate([error.reshape(-1) for error in errors]))


def _decibels(squared_errors: Float64) -> float:
    return float(-10.0 * np.log10(max(squared_errors.mean(), 1e-12)))

"""Pinhole cameras, in the axes of OpenCV and COLMAP: x to the right, y down, z forward."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from dfcgs_codec.array_types import Float32, Float64

Triple = tuple[float, float, float]


class Pinhole(NamedTuple):
    """What the kernels read of a `Camera`; `axis_*` are the rows of the world-to-camera rotation."""

    axis_x: Triple
    axis_y: Triple
    axis_z: Triple
    translation: Triple
    centre: Triple
    fx: float
    fy: float
    cx: float
    cy: float
    width: int
    height: int


@dataclass(frozen=True, eq=False)
class Camera:
    """A pinhole camera without distortion.

    world_to_camera  (4, 4) float64  rigid: rotation and translation, scene units
    fx, fy           pixels          focal lengths
    cx, cy           pixels          principal point; the centre of the first pixel is (0.5, 0.5)
    width, height    pixels
    """

    world_to_camera: Float64
    fx: float
    fy: float
    cx: float
    cy: float
    width: int
    height: int

    def __post_init__(self) -> None:
        matrix = np.asarray(self.world_to_camera, dtype=np.float64)
        if matrix.shape != (4, 4):
            raise ValueError(f"Camera.world_to_camera: found shape {matrix.shape}, expected (4, 4)")
        rotation = matrix[:3, :3]
        if not np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-4) or np.linalg.det(rotation) < 0:
            raise ValueError("Camera.world_to_camera: the upper left 3x3 is not a rotation")
        if not np.isfinite(matrix).all():
            raise ValueError("Camera.world_to_camera: found a value that is not finite")
        if self.width < 1 or self.height < 1 or not (self.fx > 0 and self.fy > 0):
            raise ValueError("Camera: width, height, fx and fy must be positive")
        object.__setattr__(self, "world_to_camera", matrix)

    @property
    def position(self) -> Float64:
        """(3,) float64, scene units: the centre of projection in the world."""
        return -self.world_to_camera[:3, :3].T @ self.world_to_camera[:3, 3]

    def pinhole(self) -> Pinhole:
        """The camera as plain numbers."""
        rows = [_triple(row) for row in self.world_to_camera[:3, :3]]
        return Pinhole(
            *rows,
            _triple(self.world_to_camera[:3, 3]),
            _triple(self.position),
            float(self.fx),
            float(self.fy),
            float(self.cx),
            float(self.cy),
            int(self.width),
            int(self.height),
        )


@dataclass(frozen=True, eq=False)
class View:
    """A camera, what it saw, (H, W, 3) in [0, 1], and the background that a fit has behind its Gaussians."""

    camera: Camera
    image: Float32
    background: Triple


def look_at(
    eye: Sequence[float],
    target: Sequence[float],
    size: tuple[int, int],
    vertical_fov: float = 50.0,
    up: Sequence[float] = (0.0, 1.0, 0.0),
) -> Camera:
    """A camera at `eye` that looks at `target`, with `up` towards the top of the image.

    eye, target: (3,) scene units. size: width and height, pixels. vertical_fov: degrees.
    up: (3,) any length; scenes from COLMAP usually have (0, -1, 0).
    """
    position = np.asarray(eye, dtype=np.float64)
    forward = np.asarray(target, dtype=np.float64) - position
    right = np.cross(forward, np.asarray(up, dtype=np.float64))
    if not np.linalg.norm(right) > 1e-9 * np.linalg.norm(forward) * np.linalg.norm(up):
        raise ValueError("look_at: eye and target are equal, or up is along the line of sight")
    forward /= np.linalg.norm(forward)
    right /= np.linalg.norm(right)
    matrix = np.eye(4)
    matrix[:3, :3] = right, np.cross(forward, right), forward
    matrix[:3, 3] = -matrix[:3, :3] @ position
    width, height = size
    focal = 0.5 * height / math.tan(math.radians(vertical_fov) / 2)
    return Camera(matrix, focal, focal, width / 2, height / 2, width, height)


def orbit(
    target: Sequence[float],
    distance: float,
    angles: tuple[float, float],
    size: tuple[int, int],
    vertical_fov: float = 50.0,
    *,
    up: Sequence[float] = (0.0, 1.0, 0.0),
) -> Camera:
    """A camera on a sphere around `target`, looking at it.

    distance: scene units. angles: azimuth and elevation, degrees; azimuth 0 is along the world axis least
    aligned with `up`, growing counter-clockwise seen from `up`; elevation lies in (-90, 90).
    size, vertical_fov, up: as in `look_at`.
    """
    axis = np.asarray(up, dtype=np.float64) / np.linalg.norm(up)
    least = np.eye(3)[np.argmin(np.abs(axis))]
    first = least - axis * (axis @ least)
    first /= np.linalg.norm(first)
    second = np.cross(axis, first)
    azimuth, elevation = (math.radians(angle) for angle in angles)
    level = math.cos(azimuth) * first + math.sin(azimuth) * second
    eye = np.asarray(target, dtype=np.float64) + distance * (
        math.cos(elevation) * level + math.sin(elevation) * axis
    )
    return look_at(eye.tolist(), target, size, vertical_fov, up)


def _triple(values: Float64) -> Triple:
    return float(values[0]), float(values[1]), float(values[2])

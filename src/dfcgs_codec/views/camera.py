"""A camera that the scene is looked at with, in the convention of COLMAP and of 3DGS."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from dfcgs_codec.arguments import real, refusal, whole
from dfcgs_codec.array_types import Float64
from dfcgs_codec.errors import InputError

#: pixels of a side, at most
MAX_SIDE = 1 << 20
#: how far the product of a rotation with its transpose may be from the identity
ORTHONORMAL = 1e-3
#: world units and pixels beyond which products are no longer safe
LARGEST = 1e15


def _rotation(matrix: Float64) -> Float64:
    """The rotation (3, 3) next to `matrix`; InputError for what is none."""
    error = float(np.abs(matrix @ matrix.T - np.eye(3)).max())
    if not error <= ORTHONORMAL:
        raise InputError(
            f"found a rotation whose product with its transpose is {error:.3g} off the identity, expected a "
            f"rotation, {ORTHONORMAL:g} at most"
        )
    if np.linalg.det(matrix) < 0:
        raise InputError("found a reflection (determinant -1), expected a rotation (determinant 1)")
    u, _, v = np.linalg.svd(matrix)
    nearest: Float64 = u @ v
    return nearest


def _pose(value: object) -> Float64:
    try:
        matrix = np.array(value, np.float64)
    except (TypeError, ValueError):
        raise refusal("world_to_camera", value, "a matrix (4, 4)") from None
    if matrix.shape != (4, 4):
        raise InputError(f"world_to_camera: found the shape {matrix.shape}, expected (4, 4)")
    if not (np.abs(matrix) < LARGEST).all():
        raise InputError("world_to_camera: found NaN, infinite or huge values, expected finite ones")
    if not np.array_equal(matrix[3], [0, 0, 0, 1]):
        raise InputError(f"world_to_camera: found the last row {matrix[3].tolist()}, expected [0, 0, 0, 1]")
    matrix[:3, :3] = _rotation(matrix[:3, :3])
    matrix.setflags(write=False)
    return matrix


def _check_number(name: str, value: float, low: float, high: float, kind: str) -> None:
    if not low < value < high:
        raise InputError(f"{name}: found {value:g}, expected {kind}")


@dataclass(frozen=True, eq=False)
class ViewCamera:
    """A pinhole camera: x right, y down, z forward; InputError for values that are no camera's.

    `width`, `height`: pixels. `fx`, `fy`, `cx`, `cy`: focal lengths and principal point in pixels; the corner
    of the first pixel is (0, 0), so that the middle of the image is (width / 2, height / 2).
    `world_to_camera` (4, 4) float64: rigid, in scene units; kept as a copy that cannot be written.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    world_to_camera: Float64

    def __post_init__(self) -> None:
        for name in ("width", "height"):
            side = whole(name, getattr(self, name))
            _check_number(name, side, 0, MAX_SIDE + 1, f"1 to {MAX_SIDE} pixels")
            object.__setattr__(self, name, side)
        for name in ("fx", "fy", "cx", "cy"):
            value = real(name, getattr(self, name))
            low, kind = (0.0, "a finite number above 0") if name[0] == "f" else (-LARGEST, "a finite number")
            _check_number(name, value, low, LARGEST, kind)
            object.__setattr__(self, name, value)
        object.__setattr__(self, "world_to_camera", _pose(self.world_to_camera))

    def _key(self) -> tuple[object, ...]:
        numbers = (self.width, self.height, self.fx, self.fy, self.cx, self.cy)
        return (*numbers, *self.world_to_camera.ravel().tolist())

    def __eq__(self, other: object) -> bool:
        return self._key() == other._key() if isinstance(other, ViewCamera) else NotImplemented

    def __hash__(self) -> int:
        return hash(self._key())

    @property
    def rotation(self) -> Float64:
        """World to camera (3, 3): its rows are the camera's right, down and forward in the world."""
        return self.world_to_camera[:3, :3]

    @property
    def position(self) -> Float64:
        """Where the camera stands in the world (3,), in scene units."""
        centre: Float64 = -self.rotation.T @ self.world_to_camera[:3, 3]
        return centre

    @property
    def forward(self) -> Float64:
        """The direction in the world (3,), of length 1, in which the camera looks."""
        return self.world_to_camera[2, :3]

    def moved_to(self, position: Float64, rotation: Float64 | None = None) -> ViewCamera:
        """The same camera at `position` (3,), turned to `rotation` (3, 3), world to camera, where given."""
        turned = self.rotation if rotation is None else rotation
        pose = np.eye(4)
        pose[:3, :3] = turned
        pose[:3, 3] = -turned @ position
        return replace(self, world_to_camera=pose)

    def resized(self, longest: int) -> ViewCamera:
        """The same view with fewer pixels: the longest side has `longest` at most; never more than now."""
        most = max(self.width, self.height)
        if most <= longest:
            return self
        width, height = (max(1, round(side * longest / most)) for side in (self.width, self.height))
        x, y = width / self.width, height / self.height
        return replace(
            self, width=width, height=height, fx=self.fx * x, fy=self.fy * y, cx=self.cx * x, cy=self.cy * y
        )


@dataclass(frozen=True)
class Views:
    """Cameras of a scene, one or more, in the frame of its Gaussians; `path`: where they were read."""

    cameras: tuple[ViewCamera, ...]
    path: Path | None = None

    def __post_init__(self) -> None:
        cameras = tuple(self.cameras)
        for index, camera in enumerate(cameras):
            if not isinstance(camera, ViewCamera):
                raise refusal(f"camera {index}", camera, "a ViewCamera")
        if not cameras:
            raise InputError("views: found no camera, expected one or more")
        object.__setattr__(self, "cameras", cameras)

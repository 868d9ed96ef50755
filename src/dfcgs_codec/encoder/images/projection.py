"""Gaussians as ellipses in a camera's image, as renderers of 3DGS place them (EWA splatting)."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from dfcgs_codec.array_types import Bool, Float64, Int64
from dfcgs_codec.encoder.images.splats import Splats, turned
from dfcgs_codec.views.camera import ViewCamera

#: renderers add this variance, in pixels
BLUR = 0.3
#: opacities that renderers draw
LEAST_ALPHA, MOST_ALPHA = 1.0 / 255.0, 0.99
#: projections are taken to be linear about points no farther aside than so many half images
_ASIDE = 1.3
#: axes of more pixels are as flat as can be, and float32 holds their squares
_LONGEST = 1e3


@dataclass(frozen=True)
class Ellipses:
    """Gaussians in an image.

    `middle` (N, 2) in pixels; variances `a`, `c` (N,) of x and of y, and `b` of both, blurred; `depth` (N,),
    scene units; not `is_before` (N,) the camera: nowhere.
    """

    middle: Float64
    a: Float64
    b: Float64
    c: Float64
    depth: Float64
    is_before: Bool

    def take(self, rows: Int64) -> Ellipses:
        """Some of them, in this order."""
        return Ellipses(*(getattr(self, field.name)[rows] for field in fields(self)))

    def reach(self, alpha: Float64) -> Float64:
        """Half the sides (N, 2) of the boxes in which Gaussians of these opacities (N,) are drawn."""
        # alpha exp(-r^2 / 2) is the least that is drawn at r deviations
        wide = np.sqrt(2.0 * np.log(np.maximum(alpha / LEAST_ALPHA, 1.0)))
        boxes: Float64 = wide[:, None] * np.sqrt(np.stack([self.a, self.c], axis=1))
        return np.where((self.is_before & (wide > 0.0))[:, None], boxes, -np.inf)


def project(splats: Splats, camera: ViewCamera, near: float) -> Ellipses:
    """Where the Gaussians appear; what is less than `near` scene units before the camera is not drawn."""
    x, y, z = turned(splats.positions.T, camera.rotation) + camera.world_to_camera[:3, 3:]
    is_before = z > near
    depth = np.where(is_before, z, 1.0)
    focal = np.array([camera.fx, camera.fy])
    ratio = np.stack([x / depth, y / depth], axis=1)
    limit = _ASIDE * 0.5 * np.array([camera.width, camera.height]) / focal
    aside = np.clip(ratio, -limit, limit)
    axes = np.einsum("ij,njk->nik", camera.rotation, splats.axes)
    spread = axes[:, :2] - aside[:, :, None] * axes[:, 2:]
    spread *= splats.deviations[:, None] * (focal / depth[:, None])[:, :, None]
    np.clip(spread, -_LONGEST, _LONGEST, out=spread)
    a, c = (spread[:, 0] ** 2).sum(axis=1) + BLUR, (spread[:, 1] ** 2).sum(axis=1) + BLUR
    middle = ratio * focal + np.array([camera.cx, camera.cy])
    return Ellipses(middle, a, (spread[:, 0] * spread[:, 1]).sum(axis=1), c, depth, is_before)

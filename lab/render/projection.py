"""Gaussians to splats: centre, shape and colour in the image (EWA splatting, Zwicker 2002, as in 3DGS).

A splat's falloff is kept in a form that does not cancel for thin Gaussians. With the image covariance
(cxx, cxy, cyy), a row at height dy over the centre sees the splat as

    exponent(x) = -(slope_precision * dy^2 + precision * (x - u - shear * dy)^2) / 2
    shear = cxy / cyy        precision = 1 / (cxx - cxy^2 / cyy)        slope_precision = 1 / cyy
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from dfcgs_codec.array_types import Float32, Int32
from dfcgs_codec.gaussians import GaussianCloud
from lab.render.camera import Camera
from lab.render.constants import ALPHA_CUT, LOW_PASS, NEAR, TILE
from lab.render.geometry import (
    clamped_slopes,
    dot,
    image_axes,
    image_factor,
    rotation_columns,
    triple,
    unit_quaternion,
    view_direction,
    world_to_camera,
)
from lab.render.kernel import kernel, run_in_ranges
from lab.render.sh import sh_basis

# columns of Splats.values
U, V, PRECISION, SHEAR, ROW_PRECISION, OPACITY, REACH, RED, GREEN, BLUE = range(10)
# added to REACH so that rounding never loses a pixel at the alpha cut; the cut itself decides
_REACH_SLACK = 1e-3
GRAIN = 4096


class CloudArrays(NamedTuple):
    """The arrays of a `GaussianCloud`, C-contiguous, for the kernels."""

    positions: Float32
    rotations: Float32
    scales: Float32
    opacities: Float32
    sh_dc: Float32
    sh_rest: Float32


class Splats(NamedTuple):
    """Gaussians in the image.

    values  (N, 10) float32  u, v (pixels), precision, shear, row precision, alpha at the centre,
                             reach (largest -2 * exponent above the alpha cut), red, green, blue
    rects   (N, 4)  int32    first and end pixel in x, first and end pixel in y
    tiles   (N,)    int32    number of tiles touched; 0: not drawn, the other arrays are undefined there
    depths  (N,)    float32  distance along the optical axis, scene units
    """

    values: Float32
    rects: Int32
    tiles: Int32
    depths: Float32


def cloud_arrays(cloud: GaussianCloud) -> CloudArrays:
    """The arrays of a cloud, copied only where they are not C-contiguous."""
    return CloudArrays(*(np.ascontiguousarray(getattr(cloud, name)) for name in CloudArrays._fields))


def project(arrays: CloudArrays, camera: Camera, threads: int | None = None) -> Splats:
    """The splats of all Gaussians under a camera, in the order of the cloud."""
    n = len(arrays.positions)
    splats = Splats(
        np.empty((n, 10), np.float32),
        np.empty((n, 4), np.int32),
        np.empty(n, np.int32),
        np.empty(n, np.float32),
    )
    run_in_ranges(_project_range, n, GRAIN, threads, arrays, camera.pinhole(), splats)
    return splats


@kernel
def _project_range(first, stop, arrays, pinhole, splats):
    basis = np.empty(16, np.float64)
    for n in range(first, stop):
        splats.tiles[n] = 0
        position = triple(arrays.positions, n)
        point = world_to_camera(pinhole, position)
        opacity = 1.0 / (1.0 + math.exp(-float(arrays.opacities[n])))
        # written so that NaN is not drawn
        if not (point[2] >= NEAR and opacity >= ALPHA_CUT):
            continue
        if _place(n, arrays, pinhole, point, opacity, splats):
            splats.depths[n] = point[2]
            _colour(n, arrays, view_direction(pinhole, position)[0], basis, splats.values)


@kernel
def image_covariance(n, arrays, pinhole, point):
    """Covariance of Gaussian n in the image, square pixels, low-pass included: cxx, cxy, cyy."""
    columns = rotation_columns(unit_quaternion(arrays.rotations, n)[0])
    log_x, log_y, log_z = triple(arrays.scales, n)
    deviations = (math.exp(log_x), math.exp(log_y), math.exp(log_z))
    axis_u, axis_v = image_axes(pinhole, point[2], clamped_slopes(pinhole, point))
    factor_u = image_factor(axis_u, columns, deviations)
    factor_v = image_factor(axis_v, columns, deviations)
    cxx = dot(factor_u, factor_u) + LOW_PASS
    cyy = dot(factor_v, factor_v) + LOW_PASS
    return cxx, dot(factor_u, factor_v), cyy


@kernel
def _place(n, arrays, pinhole, point, opacity, splats):
    """Write centre, shape and bounds; false where no pixel can reach the alpha cut."""
    cxx, cxy, cyy = image_covariance(n, arrays, pinhole, point)
    conditional = cxx - cxy * cxy / cyy
    if not (conditional > 0.0 and cxx < 1e30 and cyy < 1e30):
        return False
    u = pinhole.fx * point[0] / point[2] + pinhole.cx
    v = pinhole.fy * point[1] / point[2] + pinhole.cy
    reach = 2.0 * math.log(opacity / ALPHA_CUT) + _REACH_SLACK
    left, right = _bounds(u, math.sqrt(reach * cxx), pinhole.width)
    top, bottom = _bounds(v, math.sqrt(reach * cyy), pinhole.height)
    if left >= right or top >= bottom:
        return False
    rect = splats.rects[n]
    rect[0], rect[1], rect[2], rect[3] = left, right, top, bottom
    columns = (right - 1) // TILE - left // TILE + 1
    splats.tiles[n] = columns * ((bottom - 1) // TILE - top // TILE + 1)
    values = splats.values[n]
    values[U], values[V] = u, v
    values[PRECISION], values[SHEAR], values[ROW_PRECISION] = 1.0 / conditional, cxy / cyy, 1.0 / cyy
    values[OPACITY], values[REACH] = opacity, reach
    return True


@kernel
def _bounds(centre, extent, size):
    """First and end pixel whose centre lies within `extent` of `centre`, clipped to the image."""
    first = math.ceil(min(max(centre - extent - 0.5, 0.0), float(size)))
    last = math.floor(min(max(centre + extent - 0.5, -1.0), size - 1.0))
    return int(first), int(last) + 1


@kernel
def _colour(n, arrays, direction, basis, values):
    sh_rest = arrays.sh_rest
    sh_basis(1 + sh_rest.shape[2], direction, basis)
    for channel in range(3):
        value = 0.5 + basis[0] * arrays.sh_dc[n, channel]
        for k in range(sh_rest.shape[2]):
            value += basis[k + 1] * sh_rest[n, channel, k]
        values[n, RED + channel] = max(value, 0.0)

"""From sums per splat to gradients of the Gaussians: the projection's derivative, step by step backwards."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from dfcgs_codec.array_types import Float32
from lab.render.blend_gradient import SUM_D, SUM_D_DY, SUM_DD, SUM_DY, SUM_DY_DY, SUM_E, SUM_RED
from lab.render.camera import Camera
from lab.render.geometry import (
    clamped_slopes,
    combine,
    dot,
    image_axes,
    image_factor,
    rotation_columns,
    scaled,
    triple,
    unit_quaternion,
    view_direction,
    world_to_camera,
)
from lab.render.kernel import kernel, run_in_ranges
from lab.render.projection import GRAIN, OPACITY, PRECISION, RED, ROW_PRECISION, SHEAR, CloudArrays, Splats
from lab.render.sh import sh_basis, sh_direction_gradient


class CloudGradient(NamedTuple):
    """Derivatives by the arrays of a `GaussianCloud`, in its spaces (logits, log-scales, raw quaternions)."""

    positions: Float32
    rotations: Float32
    scales: Float32
    opacities: Float32
    sh_dc: Float32
    sh_rest: Float32


def project_gradient(
    arrays: CloudArrays, camera: Camera, splats: Splats, sums: Float32, threads: int | None = None
) -> CloudGradient:
    """The gradient of the cloud; sums: (N, 9) float32 of `blend_gradient`."""
    gradient = CloudGradient(*(np.zeros_like(array) for array in arrays))
    run_in_ranges(
        _project_range,
        len(arrays.positions),
        GRAIN,
        threads,
        arrays,
        camera.pinhole(),
        splats,
        sums,
        gradient,
    )
    return gradient


@kernel
def _project_range(first, stop, arrays, pinhole, splats, sums, gradient):
    basis = np.empty(16, np.float64)
    weights = np.empty(1 + arrays.sh_rest.shape[2], np.float64)
    for n in range(first, stop):
        if splats.tiles[n] == 0:
            continue
        value, total = splats.values[n], sums[n]
        gradient.opacities[n] = total[SUM_E] * (1 - value[OPACITY])
        g_centre, g_covariance = _splat_shape(value, total)
        position = triple(arrays.positions, n)
        g_shape = _shape(n, arrays, pinhole, position, g_centre, g_covariance, gradient)
        g_view = _colour(n, arrays, pinhole, position, value, total, (basis, weights), gradient)
        for axis in range(3):
            gradient.positions[n, axis] = g_shape[axis] + g_view[axis]


@kernel
def _splat_shape(value, total):
    """Gradients by the centre (u, v) and by the image covariance (cxx, cxy, cyy)."""
    precision, shear = float(value[PRECISION]), float(value[SHEAR])
    row_precision = float(value[ROW_PRECISION])
    g_u = precision * total[SUM_D]
    g_v = row_precision * total[SUM_DY] - shear * g_u
    g_shear = precision * total[SUM_D_DY]
    # precision = 1 / (cxx - cxy^2 / cyy), so its derivative by that difference is -precision^2
    g_xx = 0.5 * precision * precision * total[SUM_DD]
    g_xy = row_precision * g_shear - 2 * shear * g_xx
    g_yy = 0.5 * row_precision * row_precision * total[SUM_DY_DY]
    g_yy += shear * (shear * g_xx - row_precision * g_shear)
    return (g_u, g_v), (g_xx, g_xy, g_yy)


@kernel
def _shape(n, arrays, pinhole, position, g_centre, g_covariance, gradient):
    """Write the gradients of scales and rotation; returns that of the position through centre and shape."""
    point = world_to_camera(pinhole, position)
    quaternion, inverse_length = unit_quaternion(arrays.rotations, n)
    columns = rotation_columns(quaternion)
    log_x, log_y, log_z = triple(arrays.scales, n)
    deviations = (math.exp(log_x), math.exp(log_y), math.exp(log_z))
    axis_u, axis_v = image_axes(pinhole, point[2], clamped_slopes(pinhole, point))
    factor_u = image_factor(axis_u, columns, deviations)
    factor_v = image_factor(axis_v, columns, deviations)
    g_xx, g_xy, g_yy = g_covariance
    g_u = combine(2 * g_xx, factor_u, g_xy, factor_v)
    g_v = combine(g_xy, factor_u, 2 * g_yy, factor_v)
    for j in range(3):
        gradient.scales[n, j] = g_u[j] * factor_u[j] + g_v[j] * factor_v[j]
    g_u = (g_u[0] * deviations[0], g_u[1] * deviations[1], g_u[2] * deviations[2])
    g_v = (g_v[0] * deviations[0], g_v[1] * deviations[1], g_v[2] * deviations[2])
    g_columns = (
        combine(g_u[0], axis_u, g_v[0], axis_v),
        combine(g_u[1], axis_u, g_v[1], axis_v),
        combine(g_u[2], axis_u, g_v[2], axis_v),
    )
    _rotation(n, quaternion, inverse_length, g_columns, gradient.rotations)
    return _position(pinhole, point, g_centre, _rotate(columns, g_u), _rotate(columns, g_v))


@kernel
def _rotate(columns, a):
    return combine(1.0, combine(a[0], columns[0], a[1], columns[1]), a[2], columns[2])


@kernel
def _rotation(n, quaternion, inverse_length, g, rotations):
    """Gradient by the stored quaternion; g[j][i] is that by row i, column j of the matrix."""
    w, x, y, z = quaternion
    g_w = 2 * (x * (g[1][2] - g[2][1]) + y * (g[2][0] - g[0][2]) + z * (g[0][1] - g[1][0]))
    g_x = 2 * (y * (g[1][0] + g[0][1]) + z * (g[2][0] + g[0][2]) + w * (g[1][2] - g[2][1]))
    g_y = 2 * (x * (g[1][0] + g[0][1]) + z * (g[2][1] + g[1][2]) + w * (g[2][0] - g[0][2]))
    g_z = 2 * (x * (g[2][0] + g[0][2]) + y * (g[2][1] + g[1][2]) + w * (g[0][1] - g[1][0]))
    g_x -= 4 * x * (g[1][1] + g[2][2])
    g_y -= 4 * y * (g[0][0] + g[2][2])
    g_z -= 4 * z * (g[0][0] + g[1][1])
    # the length has no effect, so only the part across the quaternion counts
    along = g_w * w + g_x * x + g_y * y + g_z * z
    rotations[n, 0] = (g_w - along * w) * inverse_length
    rotations[n, 1] = (g_x - along * x) * inverse_length
    rotations[n, 2] = (g_y - along * y) * inverse_length
    rotations[n, 3] = (g_z - along * z) * inverse_length


@kernel
def _position(pinhole, point, g_centre, g_axis_u, g_axis_v):
    """Gradient by the world position, from those of the centre and of the two image axes."""
    depth = point[2]
    slopes = clamped_slopes(pinhole, point)
    fx, fy = pinhole.fx / depth, pinhole.fy / depth
    along_u, along_v = dot(g_axis_u, pinhole.axis_z), dot(g_axis_v, pinhole.axis_z)
    g_slope_x, g_slope_y = -fx * along_u, -fy * along_v
    g_fx = dot(g_axis_u, pinhole.axis_x) - slopes[0] * along_u
    g_fy = dot(g_axis_v, pinhole.axis_y) - slopes[1] * along_v
    # a clamped slope no longer moves with the position
    if slopes[0] != point[0] / depth:
        g_slope_x = 0.0
    if slopes[1] != point[1] / depth:
        g_slope_y = 0.0
    g_x = (pinhole.fx * g_centre[0] + g_slope_x) / depth
    g_y = (pinhole.fy * g_centre[1] + g_slope_y) / depth
    g_z = -(g_x * point[0] + g_y * point[1] + g_fx * fx + g_fy * fy) / depth
    across = combine(g_x, pinhole.axis_x, g_y, pinhole.axis_y)
    return combine(1.0, across, g_z, pinhole.axis_z)


@kernel
def _colour(n, arrays, pinhole, position, value, total, scratch, gradient):
    """Write the gradients of SH; returns that of the position through the view direction."""
    basis, weights = scratch
    direction, inverse_distance = view_direction(pinhole, position)
    sh_basis(len(weights), direction, basis)
    weights[:] = 0
    for channel in range(3):
        # a channel that was clamped at zero is flat
        g = float(total[SUM_RED + channel]) if value[RED + channel] > 0 else 0.0
        gradient.sh_dc[n, channel] = g * basis[0]
        for k in range(1, len(weights)):
            gradient.sh_rest[n, channel, k - 1] = g * basis[k]
            weights[k] += g * arrays.sh_rest[n, channel, k - 1]
    g_direction = sh_direction_gradient(direction, weights)
    radial = dot(g_direction, direction)
    return scaled(inverse_distance, combine(1.0, g_direction, -radial, direction))

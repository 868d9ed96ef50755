"""Small vector algebra on tuples, and the steps of the projection that forward and backward share.

Everything here is float64: per Gaussian it costs little, and the 2x2 covariance of a thin Gaussian cancels.
"""

from __future__ import annotations

import math

from lab.render.constants import JACOBIAN_MARGIN
from lab.render.kernel import kernel


@kernel
def triple(array, n):
    """Row n of an (N, 3) array, as float64."""
    return float(array[n, 0]), float(array[n, 1]), float(array[n, 2])


@kernel
def dot(a, b):
    """Scalar product of two 3-tuples."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@kernel
def scaled(factor, a):
    """The 3-tuple factor * a."""
    return factor * a[0], factor * a[1], factor * a[2]


@kernel
def combine(p, a, q, b):
    """The 3-tuple p * a + q * b."""
    return p * a[0] + q * b[0], p * a[1] + q * b[1], p * a[2] + q * b[2]


@kernel
def world_to_camera(pinhole, position):
    """A world position in the camera's axes."""
    x, y, z = pinhole.translation
    return (
        dot(pinhole.axis_x, position) + x,
        dot(pinhole.axis_y, position) + y,
        dot(pinhole.axis_z, position) + z,
    )


@kernel
def unit_quaternion(rotations, n):
    """Quaternion n, normalised, and one over its stored length."""
    w, x = float(rotations[n, 0]), float(rotations[n, 1])
    y, z = float(rotations[n, 2]), float(rotations[n, 3])
    inverse = 1.0 / math.sqrt(w * w + x * x + y * y + z * z)
    return (w * inverse, x * inverse, y * inverse, z * inverse), inverse


@kernel
def rotation_columns(quaternion):
    """The three columns of the rotation matrix of a unit quaternion w, x, y, z."""
    w, x, y, z = quaternion
    return (
        (1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)),
        (2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)),
        (2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)),
    )


@kernel
def clamped_slopes(pinhole, point):
    """x/z and y/z of a point in camera axes, kept near the image, as the perspective Jacobian uses them."""
    margin_x = JACOBIAN_MARGIN * pinhole.width
    margin_y = JACOBIAN_MARGIN * pinhole.height
    right = (pinhole.width - pinhole.cx + margin_x) / pinhole.fx
    left = (pinhole.cx + margin_x) / pinhole.fx
    bottom = (pinhole.height - pinhole.cy + margin_y) / pinhole.fy
    top = (pinhole.cy + margin_y) / pinhole.fy
    x = min(max(point[0] / point[2], -left), right)
    y = min(max(point[1] / point[2], -top), bottom)
    return x, y


@kernel
def image_axes(pinhole, depth, slopes):
    """The two rows of (perspective Jacobian) x (world-to-camera rotation), pixels per scene unit."""
    fx, fy = pinhole.fx / depth, pinhole.fy / depth
    return (
        combine(fx, pinhole.axis_x, -fx * slopes[0], pinhole.axis_z),
        combine(fy, pinhole.axis_y, -fy * slopes[1], pinhole.axis_z),
    )


@kernel
def image_factor(axis, columns, deviations):
    """One row of the 2x3 factor whose product with its transpose is the covariance in the image."""
    return (
        dot(axis, columns[0]) * deviations[0],
        dot(axis, columns[1]) * deviations[1],
        dot(axis, columns[2]) * deviations[2],
    )


@kernel
def view_direction(pinhole, position):
    """Unit vector from the camera to a position, and one over their distance."""
    offset = combine(1.0, position, -1.0, pinhole.centre)
    inverse = 1.0 / math.sqrt(max(dot(offset, offset), 1e-30))
    return scaled(inverse, offset), inverse

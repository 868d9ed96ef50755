"""Quaternion helpers; quaternions are (N, 4) float64, order w, x, y, z, as in `dfcgs_codec.gaussians`."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from dfcgs_codec.array_types import Float64, Floats


def multiply(left: Floats, right: Floats) -> Float64:
    """Hamilton product: `right` is applied first. Lengths multiply and are not normalised."""
    w, x, y, z = np.moveaxis(np.asarray(left, np.float64), -1, 0)
    a, b, c, d = np.moveaxis(np.asarray(right, np.float64), -1, 0)
    return np.stack(
        [
            w * a - x * b - y * c - z * d,
            w * b + x * a + y * d - z * c,
            w * c - x * d + y * a + z * b,
            w * d + x * c - y * b + z * a,
        ],
        axis=-1,
    )


def conjugate(quaternions: Floats) -> Float64:
    """The inverse of unit quaternions."""
    return np.asarray(quaternions, np.float64) * np.array([1.0, -1.0, -1.0, -1.0])


def normalised(quaternions: Floats) -> Float64:
    """Quaternions of any length but zero -> unit quaternions."""
    q = np.asarray(quaternions, np.float64)
    return q / np.linalg.norm(q, axis=-1, keepdims=True)


def from_vectors(rotation_vectors: Floats) -> Float64:
    """(N, 3) axis times angle in radians -> unit quaternions, w >= 0 for angles up to pi."""
    return Rotation.from_rotvec(rotation_vectors).as_quat(scalar_first=True)


def from_matrices(matrices: Float64) -> Float64:
    """(N, 3, 3) proper rotation matrices -> unit quaternions of either sign."""
    return Rotation.from_matrix(matrices, assume_valid=True).as_quat(scalar_first=True)


def from_deformations(matrices: Float64) -> Float64:
    """The rotation nearest to each (N, 3, 3) matrix of positive determinant (its polar factor), w >= 0."""
    # scipy solves the orthogonal Procrustes problem for matrices that are not declared valid
    return continuous_sign(Rotation.from_matrix(matrices).as_quat(scalar_first=True), None)


def to_matrices(quaternions: Floats) -> Float64:
    """Quaternions of any length but zero -> (N, 3, 3) rotation matrices."""
    return Rotation.from_quat(quaternions, scalar_first=True).as_matrix()


def rotate(quaternions: Floats, vectors: Floats) -> Float64:
    """Rotate each of the (N, 3) vectors by its own unit quaternion."""
    q = np.asarray(quaternions, np.float64)
    w, axis = q[..., :1], q[..., 1:]
    twice = 2.0 * np.cross(axis, vectors)
    return vectors + w * twice + np.cross(axis, twice)


def angles(left: Floats, right: Floats) -> Float64:
    """(N,) angle in radians, 0 to pi, between two rotations; q and -q count as the same."""
    a = np.asarray(left, np.float64)
    b = np.asarray(right, np.float64)
    between = multiply(conjugate(a), b)
    # atan2 stays accurate for tiny angles, where arccos of the dot product loses half the digits
    return 2.0 * np.arctan2(np.linalg.norm(between[..., 1:], axis=-1), np.abs(between[..., 0]))


def continuous_sign(quaternions: Float64, previous: Float64 | None) -> Float64:
    """Choose between q and -q: nearest to `previous`, or w >= 0 where there is none."""
    side = quaternions[:, 0] if previous is None else np.einsum("ni,ni->n", quaternions, previous)
    return np.where(side[:, None] < 0.0, -quaternions, quaternions)

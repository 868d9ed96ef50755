"""Gaussians as they are drawn, in floats: what an encoder looks at to choose steps."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from dfcgs_codec.array_types import Float64, Floats, Int64
from dfcgs_codec.gaussians import GaussianCloud

_MAX_LOG_SCALE = 30.0
_MAX_LOGIT = 50.0


def rotation_matrices(quaternions: Floats) -> Float64:
    """Rotation matrices (N, 3, 3), axes in columns, of quaternions (N, 4) of any length but zero."""
    wide = quaternions.astype(np.float64)
    w, x, y, z = (wide / np.linalg.norm(wide, axis=1, keepdims=True)).T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.stack([np.stack(row, axis=1) for row in rows], axis=1)


def deviations(log_scales: Floats) -> Float64:
    """Standard deviations, any shape; absurd ones are clipped."""
    return np.exp(np.clip(log_scales.astype(np.float64), -_MAX_LOG_SCALE, _MAX_LOG_SCALE))


def turned(columns: Float64, matrix: Float64) -> Float64:
    """Points (3, N) of which the rows are x, y and z, times `matrix` (3, 3).

    Without a matrix product: threads of linear algebra on many short rows cost more than they do.
    """
    x, y, z = columns
    return np.stack([row[0] * x + row[1] * y + row[2] * z for row in matrix])


def alpha_of(logits: Floats) -> Float64:
    """Opacities, any shape."""
    found: Float64 = 1.0 / (1.0 + np.exp(-np.clip(logits.astype(np.float64), -_MAX_LOGIT, _MAX_LOGIT)))
    return found


def extent(positions: Float64) -> float:
    """Size of the scene: the longest side of the box that 96 % of the coordinates (N, 3) lie in."""
    corners = np.percentile(positions, [2, 98], axis=0)
    return float((corners[1] - corners[0]).max())


@dataclass(frozen=True)
class Splats:
    """`positions` (N, 3), scene units; `axes` (N, 3, 3) in columns; `deviations` (N, 3); `alpha` (N,).

    `colours` (N, 3, K): coefficients of the real spherical harmonics.
    """

    positions: Float64
    axes: Float64
    deviations: Float64
    alpha: Float64
    colours: Float64

    @staticmethod
    @np.errstate(all="ignore")
    def of(cloud: GaussianCloud) -> Splats:
        """Those of a frame."""
        colours = np.concatenate([cloud.sh_dc[:, :, None], cloud.sh_rest], axis=2).astype(np.float64)
        turns = rotation_matrices(cloud.rotations)
        spread, alpha = deviations(cloud.scales), alpha_of(cloud.opacities)
        return Splats(cloud.positions.astype(np.float64), turns, spread, alpha, colours)

    def take(self, rows: Int64) -> Splats:
        """Some of them."""
        return Splats(*(getattr(self, field.name)[rows] for field in fields(self)))


def harmonics(directions: Float64, count: int) -> Float64:
    """The first `count` (1 to 16) real spherical harmonics of unit vectors (N, 3), signed as in 3DGS."""
    x, y, z = directions.T
    xx, yy, zz = x * x, y * y, z * z
    columns = [
        np.full_like(x, 0.28209479177387814),
        -0.4886025119029199 * y,
        0.4886025119029199 * z,
        -0.4886025119029199 * x,
        1.0925484305920792 * x * y,
        -1.0925484305920792 * y * z,
        0.31539156525252005 * (2.0 * zz - xx - yy),
        -1.0925484305920792 * x * z,
        0.5462742152960396 * (xx - yy),
        -0.5900435899266435 * y * (3.0 * xx - yy),
        2.890611442640554 * x * y * z,
        -0.4570457994644658 * y * (4.0 * zz - xx - yy),
        0.3731763325901154 * z * (2.0 * zz - 3.0 * xx - 3.0 * yy),
        -0.4570457994644658 * x * (4.0 * zz - xx - yy),
        1.445305721320277 * z * (xx - yy),
        -0.5900435899266435 * x * (xx - 3.0 * yy),
    ]
    return np.stack(columns[:count], axis=1)

"""Errors of the Gaussians themselves, for decoded frames in any order.

Who is who is found again by position: pairs that are each other's nearest neighbour. Where the errors are
small against the spacing that is nearly everyone; the share is reported with the figures.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from dfcgs_codec.array_types import Float64, Floats, Int64
from dfcgs_codec.gaussians import GaussianCloud


def mutual_pairs(source: GaussianCloud, decoded: GaussianCloud) -> tuple[Int64, Int64]:
    """Indices (M,) into both of Gaussians that are each other's nearest."""
    forward = cKDTree(decoded.positions).query(source.positions)[1]
    backward = cKDTree(source.positions).query(decoded.positions)[1]
    mine = np.flatnonzero(backward[forward] == np.arange(source.num_gaussians))
    return mine, forward[mine]


def _covariances(cloud: GaussianCloud) -> Float64:
    """(N, 3, 3), scene units squared: what rotation and scale mean together, whatever the axes are called."""
    q = cloud.rotations.astype(np.float64)
    w, x, y, z = (q / np.linalg.norm(q, axis=1)[:, None]).T
    columns = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    scaled = np.moveaxis(np.array(columns), 2, 0) * np.exp(cloud.scales.astype(np.float64))[:, None, :]
    return scaled @ scaled.transpose(0, 2, 1)


def _figures(errors: Floats) -> dict[str, float]:
    flat = np.abs(errors.astype(np.float64)).ravel()
    return {
        "rms": float(np.sqrt(np.mean(flat**2))),
        "p99": float(np.percentile(flat, 99.0)),
        "max": float(flat.max()),
    }


def attribute_errors(source: GaussianCloud, decoded: GaussianCloud) -> dict[str, Any]:
    """RMS, 99th percentile and maximum by attribute, in the units of `GaussianCloud`; alpha in 0 .. 1.

    Scales are compared sorted, and rotations as part of the covariance (relative error in the Frobenius
    norm), because a codec may rename the axes of a Gaussian.
    """
    mine, theirs = mutual_pairs(source, decoded)
    a, b = source.take(mine), decoded.take(theirs)
    result: dict[str, Any] = {"matched_share": len(mine) / max(source.num_gaussians, decoded.num_gaussians)}
    if not len(mine):
        return result
    alphas = [1.0 / (1.0 + np.exp(-np.clip(c.opacities.astype(np.float64), -700, 700))) for c in (a, b)]
    result["position"] = _figures(np.linalg.norm(a.positions - b.positions, axis=1))
    first, second = _covariances(a), _covariances(b)
    norms = np.linalg.norm(first, axis=(1, 2))
    result["covariance"] = _figures(np.linalg.norm(first - second, axis=(1, 2)) / norms)
    result["log_scale"] = _figures(np.sort(a.scales, axis=1) - np.sort(b.scales, axis=1))
    result["alpha"] = _figures(alphas[0] - alphas[1])
    result["sh_dc"] = _figures(a.sh_dc - b.sh_dc)
    if a.sh_rest.size:
        result["sh_rest"] = _figures(a.sh_rest - b.sh_rest)
    return result

"""The first Gaussians: random points in what the cameras see, as 3DGS begins without a point cloud."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from dfcgs_codec.array_types import Float64
from dfcgs_codec.gaussians import SH_REST_COEFFICIENTS, GaussianCloud
from lab.captures.captures import Capture
from lab.render import Camera

#: nearest and farthest first point, shares of the rig's distance to its target
DEPTHS = (0.3, 2.5)
#: opacity 0.1 as a logit
OPACITY = -2.197
NEIGHBOURS = 3
#: keeps the random numbers apart from those of other stages with the same seed
START_STREAM = 61


def random_cloud(capture: Capture, cameras: list[Camera]) -> GaussianCloud:
    """`capture.start` round, faint Gaussians of random colours, as large as their neighbours are far."""
    rng = np.random.default_rng([capture.seed, START_STREAM])
    n = capture.start
    points = points_in_view(
        cameras, n, (DEPTHS[0] * capture.rig.distance, DEPTHS[1] * capture.rig.distance), rng
    )
    spacing = cKDTree(points).query(points, NEIGHBOURS + 1)[0][:, 1:].mean(axis=1)
    arrays = (
        points,
        np.tile([1.0, 0.0, 0.0, 0.0], (n, 1)),
        np.tile(np.log(np.maximum(spacing, 1e-4))[:, None], (1, 3)),
        np.full(n, OPACITY),
        rng.uniform(-1.0, 1.0, (n, 3)),
        np.zeros((n, 3, SH_REST_COEFFICIENTS[capture.sh_degree])),
    )
    return GaussianCloud(*(np.ascontiguousarray(array, dtype=np.float32) for array in arrays))


def points_in_view(
    cameras: list[Camera], count: int, depths: tuple[float, float], rng: np.random.Generator
) -> Float64:
    """(count, 3) points on random rays of random cameras, at depths that are uniform in their logarithm."""
    whose = rng.integers(len(cameras), size=count)
    place = rng.random((count, 2))
    depth = np.exp(rng.uniform(*np.log(depths), count))
    points = np.empty((count, 3))
    for index, camera in enumerate(cameras):
        rows = np.flatnonzero(whose == index)
        u, v = place[rows, 0] * camera.width, place[rows, 1] * camera.height
        rays = np.stack(
            [(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, np.ones(len(rows))], axis=1
        )
        points[rows] = depth[rows, None] * rays @ camera.world_to_camera[:3, :3] + camera.position
    return points

"""Small clouds and cameras for the renderer's tests."""

from __future__ import annotations

import numpy as np

from dfcgs_codec.gaussians import SH_REST_COEFFICIENTS, GaussianCloud
from lab.render import Camera, orbit

SH_C0 = 0.28209479177387814


def random_cloud(n: int, sh_degree: int = 3, seed: int = 0) -> GaussianCloud:
    """Gaussians of all shapes in a ball, quaternions of any length."""
    rng = np.random.default_rng(seed)
    return _cloud(
        positions=rng.normal(size=(n, 3)) * 0.7,
        rotations=rng.normal(size=(n, 4)) * rng.uniform(0.3, 2.0, (n, 1)),
        scales=rng.normal(-2.2, 0.7, (n, 3)),
        opacities=rng.normal(1.0, 2.0, n),
        sh_dc=rng.normal(size=(n, 3)),
        sh_rest=rng.normal(size=(n, 3, SH_REST_COEFFICIENTS[sh_degree])) * 0.3,
    )


def plain_cloud(positions: list, colours: list, alpha: list, deviation: list) -> GaussianCloud:
    """Round Gaussians of one colour each, SH degree 0; colour, alpha in [0, 1], deviation in scene units."""
    n = len(positions)
    opacity = np.asarray(alpha, dtype=np.float64)
    return _cloud(
        positions=np.asarray(positions, dtype=np.float64).reshape(n, 3),
        rotations=np.tile([1.0, 0, 0, 0], (n, 1)),
        scales=np.log(np.repeat(np.asarray(deviation, dtype=np.float64)[:, None], 3, axis=1)),
        opacities=np.log(opacity) - np.log1p(-opacity),
        sh_dc=(np.asarray(colours, dtype=np.float64).reshape(n, 3) - 0.5) / SH_C0,
        sh_rest=np.zeros((n, 3, 0)),
    )


def forward_camera(width: int = 33, height: int = 33, focal: float = 40.0) -> Camera:
    """At the origin, looking along +z; with odd sizes a pixel's centre lies on the axis."""
    return Camera(np.eye(4), focal, focal, width / 2, height / 2, width, height)


def side_camera(width: int = 53, height: int = 37) -> Camera:
    """Looks at the origin from the side; the size is no multiple of a tile, nor of eight."""
    return orbit((0.0, 0.1, 0.0), 3.0, (30.0, 20.0), (width, height), 50.0)


def _cloud(**arrays: np.ndarray) -> GaussianCloud:
    return GaussianCloud(**{name: np.ascontiguousarray(a, dtype=np.float32) for name, a in arrays.items()})

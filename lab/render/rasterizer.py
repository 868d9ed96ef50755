"""One image of a cloud, and the way back from the image's gradient to the cloud's."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dfcgs_codec.array_types import Float32
from dfcgs_codec.gaussians import GaussianCloud
from lab.render.binning import TileLists, bin_splats
from lab.render.blend import Frame, blend
from lab.render.blend_gradient import blend_gradient
from lab.render.camera import Camera
from lab.render.projection import CloudArrays, Splats, cloud_arrays, project
from lab.render.projection_gradient import CloudGradient, project_gradient


@dataclass(frozen=True, eq=False)
class Rendering:
    """An image and what its backward pass needs; do not change its arrays, nor the cloud's, in between."""

    camera: Camera
    background: Float32
    arrays: CloudArrays
    splats: Splats
    tiles: TileLists
    frame: Frame

    @property
    def colour(self) -> Float32:
        """(H, W, 3) float32, red, green, blue; never below 0 over a background that is not, may exceed 1."""
        return self.frame.colour

    @property
    def alpha(self) -> Float32:
        """(H, W) float32 in [0, 1]: how much the Gaussians hide the background."""
        return 1 - self.frame.transmittance


def render(
    cloud: GaussianCloud,
    camera: Camera,
    background: Sequence[float] = (0.0, 0.0, 0.0),
    threads: int | None = None,
) -> Rendering:
    """The image of a cloud: 3DGS (Kerbl et al. 2023) with gsplat 1.5's bounds, alpha cap and cut.

    background: red, green, blue. threads: None for all cores; the result does not depend on it.
    Gaussians with NaN or infinite position, shape or opacity are not drawn.
    """
    colour = np.asarray(background, dtype=np.float32)
    if colour.shape != (3,):
        raise ValueError(f"render: found a background of shape {colour.shape}, expected (3,)")
    arrays = cloud_arrays(cloud)
    splats = project(arrays, camera, threads)
    tiles = bin_splats(splats, camera.width, camera.height)
    frame = blend(splats, tiles, camera, colour, threads)
    return Rendering(camera, colour, arrays, splats, tiles, frame)


def render_backward(
    rendering: Rendering,
    colour_gradient: Float32,
    alpha_gradient: Float32 | None = None,
    threads: int | None = None,
) -> CloudGradient:
    """The gradient by the cloud of a function whose gradient by the image is given.

    colour_gradient: (H, W, 3). alpha_gradient: (H, W), None for zero. Analytic; which pixels a splat reaches
    and the depth order count as constant, as in every 3DGS rasteriser.
    """
    shape = rendering.frame.transmittance.shape
    g_colour = np.ascontiguousarray(colour_gradient, dtype=np.float32)
    g_alpha = np.zeros(shape, np.float32) if alpha_gradient is None else alpha_gradient
    g_alpha = np.ascontiguousarray(g_alpha, dtype=np.float32)
    if g_colour.shape != (*shape, 3) or g_alpha.shape != shape:
        raise ValueError(
            f"render_backward: found gradients of shape {g_colour.shape} and {g_alpha.shape}, "
            f"expected {(*shape, 3)} and {shape}"
        )
    sums = blend_gradient(
        rendering.splats, rendering.tiles, rendering.frame, (g_colour, g_alpha, rendering.background), threads
    )
    return project_gradient(rendering.arrays, rendering.camera, rendering.splats, sums, threads)

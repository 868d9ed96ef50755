"""A 3DGS rasteriser for the CPU, with analytic gradients, and SSIM; needs numba.

    rendering = render(cloud, orbit(target, distance, (azimuth, elevation), (width, height)))
    rendering.colour, rendering.alpha
    gradient = render_backward(rendering, colour_gradient)

`evaluation.render.autograd` has the same for torch and is imported by name only.
"""

from __future__ import annotations

from evaluation.render.camera import Camera, look_at, orbit
from evaluation.render.projection_gradient import CloudGradient
from evaluation.render.rasterizer import Rendering, render, render_backward
from evaluation.render.ssim import ssim, ssim_with_gradient

__all__ = [
    "Camera",
    "CloudGradient",
    "Rendering",
    "look_at",
    "orbit",
    "render",
    "render_backward",
    "ssim",
    "ssim_with_gradient",
]

"""A 3DGS rasteriser for the CPU, with analytic gradients, and SSIM; needs numba.

    rendering = render(cloud, orbit(target, distance, (azimuth, elevation), (width, height)))
    rendering.colour, rendering.alpha
    gradient = render_backward(rendering, colour_gradient)

`lab.render.autograd` has the same for torch and is imported by name only.
"""

from __future__ import annotations

from lab.render.camera import Camera, View, look_at, orbit
from lab.render.projection_gradient import CloudGradient
from lab.render.rasterizer import Rendering, render, render_backward
from lab.render.ssim import ssim, ssim_with_gradient

__all__ = [
    "Camera",
    "CloudGradient",
    "Rendering",
    "View",
    "look_at",
    "orbit",
    "render",
    "render_backward",
    "ssim",
    "ssim_with_gradient",
]

"""Which Gaussians move: those whose pixels differ between the images of this frame and of the last.

Images against images, not against the last fit: what the fit has always got wrong would look like motion.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dfcgs_codec.array_types import Float32
from dfcgs_codec.gaussians import GaussianCloud
from lab.render import View, render, render_backward
from training.fitting.capture import SH_C0, painted

#: mean change of brightness (0 to 1) that counts as motion
THRESHOLD = 0.008
#: Gaussians whose neighbours' activity counts too, so that hidden parts follow those that are seen
NEIGHBOURS = 8


def activity(cloud: GaussianCloud, views: Sequence[View], before: Sequence[View]) -> Float32:
    """(N,) mean absolute change of brightness in the pixels that a Gaussian makes up, over all views.

    `cloud` is the frame before, which shows what each Gaussian covers; `before` are that frame's images.
    """
    white = painted(cloud, np.ones((cloud.num_gaussians, 3), np.float32))
    total = np.zeros((cloud.num_gaussians, 2), np.float32)
    for view, old in zip(views, before, strict=True):
        rendering = render(white, view.camera)
        change = np.abs(view.image - old.image).mean(axis=2)
        # the image is linear in the colours: their gradient is the sum over a Gaussian's pixels, weighted by
        # how much of each pixel it makes up
        paint = np.stack([change, np.ones_like(change), np.zeros_like(change)], axis=2)
        total += render_backward(rendering, paint).sh_dc[:, :2] / np.float32(SH_C0)
    return total[:, 0] / np.maximum(total[:, 1], np.float32(1.0))

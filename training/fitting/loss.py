"""The loss of 3DGS and its gradient by a cloud, for one view."""

from __future__ import annotations

import numpy as np

from dfcgs_codec.gaussians import GaussianCloud
from lab.render import CloudGradient, View, render, render_backward, ssim_with_gradient

#: weight of 1 - SSIM; the rest is that of the mean absolute error
SSIM_WEIGHT = 0.2


def loss_gradient(cloud: GaussianCloud, view: View) -> tuple[float, CloudGradient]:
    """0.8 L1 + 0.2 (1 - SSIM) between the cloud's image and the view's, and its gradient."""
    rendering = render(cloud, view.camera, view.background)
    difference = rendering.colour - view.image
    similarity, gradient = ssim_with_gradient(rendering.colour, view.image)
    gradient *= np.float32(-SSIM_WEIGHT)
    gradient += np.float32((1.0 - SSIM_WEIGHT) / difference.size) * np.sign(difference)
    loss = (1.0 - SSIM_WEIGHT) * float(np.abs(difference).mean()) + SSIM_WEIGHT * (1.0 - similarity)
    return loss, render_backward(rendering, gradient)

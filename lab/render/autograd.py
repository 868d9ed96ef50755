"""The rasteriser and SSIM as differentiable torch functions, on CPU tensors; needs torch."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from torch import Tensor

from dfcgs_codec.gaussians import GaussianCloud
from lab.render.camera import Camera
from lab.render.rasterizer import render, render_backward
from lab.render.ssim import ssim, ssim_with_gradient


class _Render(torch.autograd.Function):
    @staticmethod
    def forward(
        ctx: Any, camera: Camera, background: Sequence[float], *arrays: Tensor
    ) -> tuple[Tensor, Tensor]:
        # copies: an optimiser that steps before backward must not change what backward reads
        cloud = GaussianCloud(*(array.detach().numpy().copy() for array in arrays))
        ctx.rendering = render(cloud, camera, background)
        # the tensors must not share the rendering's memory: the caller may write to them
        return torch.tensor(ctx.rendering.colour), torch.from_numpy(ctx.rendering.alpha)

    @staticmethod
    def backward(ctx: Any, colour: Tensor, alpha: Tensor) -> tuple[Tensor | None, ...]:
        gradient = render_backward(ctx.rendering, colour.numpy(), alpha.numpy())
        return None, None, *(torch.from_numpy(array) for array in gradient)


class _Ssim(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, image: Tensor, reference: Tensor) -> Tensor:
        images = image.detach().numpy(), reference.detach().numpy()
        if ctx.needs_input_grad[0]:
            value, gradient = ssim_with_gradient(*images)
            ctx.save_for_backward(torch.from_numpy(gradient))
        else:
            value = ssim(*images)
        return torch.tensor(value, dtype=torch.float32)

    @staticmethod
    def backward(ctx: Any, value: Tensor) -> tuple[Tensor | None, None]:
        return (ctx.saved_tensors[0] * value if ctx.needs_input_grad[0] else None), None


def render_tensors(
    cloud: Sequence[Tensor], camera: Camera, background: Sequence[float] = (0.0, 0.0, 0.0)
) -> tuple[Tensor, Tensor]:
    """Colour (H, W, 3) and alpha (H, W) of a cloud, differentiable by its tensors.

    cloud: positions, rotations, scales, opacities, sh_dc, sh_rest: float32, with the shapes and spaces of
    `dfcgs_codec.gaussians`. The gradient is that of `render_backward`.
    """
    colour, alpha = _Render.apply(camera, tuple(background), *cloud)
    return colour, alpha


def ssim_tensors(image: Tensor, reference: Tensor) -> Tensor:
    """`ssim` of two (H, W, C) float32 images, a scalar, differentiable by the first."""
    return _Ssim.apply(image, reference)


def cloud_tensors(cloud: GaussianCloud) -> list[Tensor]:
    """The arrays of a cloud as leaf tensors with gradients, in the order that `render_tensors` takes."""
    arrays = (cloud.positions, cloud.rotations, cloud.scales, cloud.opacities, cloud.sh_dc, cloud.sh_rest)
    return [torch.tensor(np.ascontiguousarray(array), requires_grad=True) for array in arrays]

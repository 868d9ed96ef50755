"""A dense 3DGS renderer in float64 torch: every pixel against every Gaussian, derivatives by autograd.

Written from the published formulas, independent of `lab.render` except for the `Camera` it is given.
SH come from the associated Legendre polynomials in Cartesian form, shapes from an explicit 2x2 inverse.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from dfcgs_codec.gaussians import GaussianCloud
from lab.render import Camera


@dataclass
class OracleImage:
    colour: Tensor
    alpha: Tensor
    # (H, W) bool: a splat at the alpha cut or cap, or the transmittance at the stop, to 1e-4 relative:
    # a float32 renderer may decide otherwise there
    undecided: Tensor


def leaves(cloud: GaussianCloud) -> list[Tensor]:
    arrays = (cloud.positions, cloud.rotations, cloud.scales, cloud.opacities, cloud.sh_dc, cloud.sh_rest)
    return [torch.tensor(array.astype(np.float64), requires_grad=True) for array in arrays]


def render_oracle(tensors: list[Tensor], camera: Camera, background: tuple[float, ...]) -> OracleImage:
    positions, rotations, scales, opacities, sh_dc, sh_rest = tensors
    view = torch.tensor(camera.world_to_camera)
    points = positions @ view[:3, :3].T + view[:3, 3]
    keep = (points[:, 2] >= 0.01).nonzero()[:, 0]
    depth32 = points[keep, 2].detach().numpy().astype(np.float32)
    keep = keep[torch.tensor(np.argsort(depth32, kind="stable"))]
    covariance = _image_covariance(points[keep], rotations[keep], scales[keep], camera)
    centres = torch.stack(
        [
            camera.fx * points[keep, 0] / points[keep, 2] + camera.cx,
            camera.fy * points[keep, 1] / points[keep, 2] + camera.cy,
        ],
        1,
    )
    directions = positions[keep] - torch.tensor(camera.position)
    directions = directions / directions.norm(dim=1, keepdim=True)
    coefficients = torch.cat([sh_dc[keep][:, :, None], sh_rest[keep]], 2)
    colours = torch.einsum("nk,nck->nc", _harmonics(directions, coefficients.shape[2]), coefficients) + 0.5
    return _composite(
        centres, covariance, torch.sigmoid(opacities[keep]), colours.clamp_min(0), camera, background
    )


def _image_covariance(points: Tensor, rotations: Tensor, scales: Tensor, camera: Camera) -> Tensor:
    w, x, y, z = (rotations / rotations.norm(dim=1, keepdim=True)).unbind(1)
    # v' = v + 2 w (q x v) + 2 q x (q x v), as a matrix
    zero = torch.zeros_like(w)
    cross = torch.stack([zero, -z, y, z, zero, -x, -y, x, zero], 1).view(-1, 3, 3)
    matrix = torch.eye(3, dtype=torch.float64) + 2 * w[:, None, None] * cross + 2 * cross @ cross
    world = matrix @ torch.diag_embed(torch.exp(2 * scales)) @ matrix.transpose(1, 2)
    rotation = torch.tensor(camera.world_to_camera[:3, :3])
    px, py, pz = points.unbind(1)
    slope_x = (px / pz).clamp(
        -(camera.cx + 0.15 * camera.width) / camera.fx, (1.15 * camera.width - camera.cx) / camera.fx
    )
    slope_y = (py / pz).clamp(
        -(camera.cy + 0.15 * camera.height) / camera.fy, (1.15 * camera.height - camera.cy) / camera.fy
    )
    zero = torch.zeros_like(pz)
    jacobian = torch.stack(
        [camera.fx / pz, zero, -camera.fx * slope_x / pz, zero, camera.fy / pz, -camera.fy * slope_y / pz], 1
    ).view(-1, 2, 3)
    full = jacobian @ rotation @ world @ rotation.T @ jacobian.transpose(1, 2)
    return full + 0.3 * torch.eye(2, dtype=torch.float64)


def _harmonics(directions: Tensor, count: int) -> Tensor:
    """Real SH with the Condon-Shortley phase, order m = -l ... l, from their general formula."""
    x, y, z = directions.unbind(1)
    columns = []
    for degree in range(math.isqrt(count)):
        for order in range(-degree, degree + 1):
            m = abs(order)
            norm = math.sqrt(
                (2 * degree + 1) / (4 * math.pi) * math.factorial(degree - m) / math.factorial(degree + m)
            )
            norm *= math.sqrt(2) if m else 1
            # Re and Im of (x + i y)^m carry the azimuth, and sin(theta)^m with it
            real, imaginary = torch.ones_like(x), torch.zeros_like(x)
            for _ in range(m):
                real, imaginary = real * x - imaginary * y, real * y + imaginary * x
            columns.append(norm * _legendre(degree, m, z) * (imaginary if order < 0 else real))
    return torch.stack(columns, 1)


def _legendre(degree: int, m: int, z: Tensor) -> Tensor:
    """P_l^m(z) / sin(theta)^m, with (-1)^m."""
    current = torch.full_like(z, (-1.0) ** m * math.prod(range(1, 2 * m, 2)))
    previous = torch.zeros_like(z)
    for step in range(m + 1, degree + 1):
        current, previous = (
            ((2 * step - 1) * z * current - (step + m - 1) * previous) / (step - m),
            current,
        )
    return current


def _composite(
    centres: Tensor,
    covariance: Tensor,
    opacity: Tensor,
    colours: Tensor,
    camera: Camera,
    background: tuple[float, ...],
) -> OracleImage:
    height, width = camera.height, camera.width
    ys, xs = torch.meshgrid(
        torch.arange(height, dtype=torch.float64) + 0.5,
        torch.arange(width, dtype=torch.float64) + 0.5,
        indexing="ij",
    )
    pixels = torch.stack([xs, ys], 2)
    transmittance = torch.ones(height, width, dtype=torch.float64)
    colour = torch.zeros(height, width, 3, dtype=torch.float64)
    open_ = torch.ones(height, width, dtype=torch.bool)
    undecided = torch.zeros(height, width, dtype=torch.bool)
    inverse = torch.linalg.inv(covariance)
    for n in range(len(centres)):
        offset = pixels - centres[n]
        raw = opacity[n] * torch.exp(-0.5 * torch.einsum("hwi,ij,hwj->hw", offset, inverse[n], offset))
        alpha = raw.clamp_max(0.999)
        seen = alpha >= 1 / 255
        after = transmittance * (1 - alpha)
        for value, limit in ((alpha, 1 / 255), (raw, 0.999), (after, 1e-4)):
            undecided |= open_ & ((value / limit - 1).abs() < 1e-4)
        open_ = open_ & ~(seen & (after <= 1e-4))
        drawn = seen & open_
        colour = colour + torch.where(drawn, alpha * transmittance, 0.0)[:, :, None] * colours[n]
        transmittance = torch.where(drawn, after, transmittance)
    colour = colour + transmittance[:, :, None] * torch.tensor(background, dtype=torch.float64)
    return OracleImage(colour, 1 - transmittance, undecided)

"""Reference images for `lab.render` from gsplat's own torch code, on the CPU.

    python -m venv other && other/bin/pip install gsplat==1.5.3 torch==2.13.0 plyfile numpy
    PYTHONPATH=src other/bin/python tools/make_render_reference.py

writes tests/lab/render/data/gsplat_reference.npz. gsplat's projection (`_fully_fused_projection`) and
spherical harmonics (`_spherical_harmonics`) run as they are, in float64. Its rasteriser needs CUDA, so the
composite below is written from the kernel (rasterize_to_pixels), all pixels against all Gaussians:

* the centre of pixel (0, 0) is (0.5, 0.5);
* 0.3 square pixels are added to both image variances, without opacity compensation (the "classic" mode);
* alpha = min(0.999, opacity * exp(-sigma)); below 1/255 the Gaussian leaves the pixel alone;
* the Gaussian that would take the transmittance to 1e-4 or below is left out, and all behind it;
* near to far by float32 depth, equal depths in the order of the cloud.

Nothing of `evaluation` is imported here.
"""

from __future__ import annotations

import sys
from importlib.metadata import version
from pathlib import Path

import numpy as np
import torch
from gsplat.cuda._torch_impl import (
    _fully_fused_projection,
    _quat_scale_to_covar_preci,
    _spherical_harmonics,
)
from torch import Tensor

from dfcgs_codec.ply import read_ply

ROOT = Path(__file__).parent.parent
TARGET = ROOT / "tests" / "lab" / "render" / "data" / "gsplat_reference.npz"
NUM_GAUSSIANS = 1500
BACKGROUND = (0.2, 0.5, 0.9)
WIDTH, HEIGHT = 96, 72
#: relative distance to a threshold at which a float32 renderer may decide otherwise
UNDECIDED = 1e-5
Arrays = dict[str, np.ndarray]


def make_cloud() -> Arrays:
    """Some Gaussians of the trained splat, enlarged, with a random third SH band, in few bits."""
    rng = np.random.default_rng(7)
    splat, _ = read_ply(ROOT / "assets" / "playbot_31k_sh2.ply")
    part = splat.take(np.sort(rng.choice(splat.num_gaussians, NUM_GAUSSIANS, replace=False)))
    rest = np.concatenate([part.sh_rest, rng.normal(0, 0.05, (NUM_GAUSSIANS, 3, 7))], axis=2)
    arrays = {
        "positions": part.positions,
        "rotations": part.rotations,
        "scales": part.scales + 1.0,
        "opacities": part.opacities,
        "sh_dc": part.sh_dc,
        "sh_rest": np.rint(rest * 64) / 64,
    }
    return {name: array.astype(np.float16) for name, array in arrays.items()}


def look_at(eye: np.ndarray, target: np.ndarray) -> np.ndarray:
    """(4, 4) world to camera: x to the right, y down, z forward; y points down in this splat's world too."""
    forward = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross(forward, [0.0, -1.0, 0.0])
    right /= np.linalg.norm(right)
    matrix = np.eye(4)
    matrix[:3, :3] = right, np.cross(forward, right), forward
    matrix[:3, 3] = -matrix[:3, :3] @ eye
    return matrix


def make_views(positions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """World-to-camera (V, 4, 4) and fx, fy, cx, cy (V, 4): a view from outside and one from within."""
    low, high = np.quantile(positions.astype(np.float64), [0.01, 0.99], axis=0)
    middle, size = (low + high) / 2, float(np.linalg.norm(high - low))
    outside = look_at(middle + size * np.array([0.5, -0.4, 0.4]), middle)
    # from here, Gaussians lie behind the camera, near it and far outside the image
    within = look_at(middle + size * np.array([-0.1, -0.12, 0.2]), middle)
    focal = [[95.0, 95.0, WIDTH / 2, HEIGHT / 2], [60.0, 66.0, 43.5, 38.25]]
    return np.stack([outside, within]), np.array(focal)


def composite(splats: tuple[Tensor, ...], size: tuple[int, int]) -> tuple[Tensor, Tensor]:
    """Colour (H, W, 3) and whether each pixel is undecided (H, W), from splats near to far."""
    width, height = size
    ys, xs = torch.meshgrid(torch.arange(height) + 0.5, torch.arange(width) + 0.5, indexing="ij")
    transmittance = torch.ones(height, width, dtype=torch.float64)
    colour = torch.zeros(height, width, 3, dtype=torch.float64)
    finished = torch.zeros(height, width, dtype=torch.bool)
    undecided = finished.clone()
    for (u, v), (a, b, c), opacity, rgb in zip(*splats, strict=True):
        dx, dy = xs.double() - u, ys.double() - v
        uncapped = opacity * torch.exp(-(0.5 * (a * dx * dx + c * dy * dy) + b * dx * dy))
        alpha = uncapped.clamp_max(0.999)
        counts = ~finished & (alpha >= 1 / 255)
        after = transmittance * (1 - alpha)
        for value, limit in ((alpha, 1 / 255), (after, 1e-4)):
            undecided |= ~finished & ((value / limit - 1).abs() < UNDECIDED)
        finished |= counts & (after <= 1e-4)
        counts &= ~finished
        colour += torch.where(counts, alpha * transmittance, 0.0)[:, :, None] * rgb
        transmittance = torch.where(counts, after, transmittance)
    return colour + transmittance[:, :, None] * torch.tensor(BACKGROUND, dtype=torch.float64), undecided


def render(cloud: Arrays, view: np.ndarray, intrinsics: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """One image by gsplat's functions."""
    tensors = {name: torch.tensor(array.astype(np.float64)) for name, array in cloud.items()}
    fx, fy, cx, cy = intrinsics
    camera = torch.tensor(view)[None]
    matrix = torch.tensor([[[fx, 0, cx], [0, fy, cy], [0, 0, 1]]], dtype=torch.float64)
    covariances, _ = _quat_scale_to_covar_preci(
        tensors["rotations"], torch.exp(tensors["scales"]), True, False
    )
    radii, means, depths, conics, _ = _fully_fused_projection(
        tensors["positions"], covariances, camera, matrix, WIDTH, HEIGHT
    )
    coefficients = torch.cat([tensors["sh_dc"][:, :, None], tensors["sh_rest"]], 2).transpose(1, 2)
    directions = tensors["positions"] - torch.linalg.inv(camera)[0, :3, 3]
    colours = (_spherical_harmonics(3, directions, coefficients) + 0.5).clamp_min(0)
    seen = (radii[0] > 0).all(dim=1).nonzero()[:, 0]
    order = seen[torch.argsort(depths[0, seen].float(), stable=True)]
    splats = means[0], conics[0], torch.sigmoid(tensors["opacities"]), colours
    image, undecided = composite(tuple(values[order] for values in splats), (WIDTH, HEIGHT))
    return image.numpy(), undecided.numpy()


def main() -> None:
    """Write the reference."""
    cloud = make_cloud()
    views, intrinsics = make_views(cloud["positions"])
    images, undecided = zip(
        *(render(cloud, *view) for view in zip(views, intrinsics, strict=True)), strict=True
    )
    colours = np.stack(images)
    # 16 bits: an error of at most half a unit
    unit = float(colours.max()) / 65535
    versions = f"gsplat {version('gsplat')}, torch {version('torch')}"
    TARGET.parent.mkdir(exist_ok=True)
    np.savez_compressed(
        TARGET,
        **cloud,
        world_to_camera=views,
        intrinsics=intrinsics,
        size=np.array([WIDTH, HEIGHT]),
        background=np.array(BACKGROUND),
        colour_units=np.rint(colours / unit).astype(np.uint16),
        unit=np.array(unit),
        undecided=np.stack(undecided),
        made_with=np.array(versions),
    )
    print(f"{TARGET}: {TARGET.stat().st_size} bytes, {versions}, unit {unit:.3g}, ", end="")
    print(f"{int(np.stack(undecided).sum())} undecided pixels")


if __name__ == "__main__":
    sys.exit(main())

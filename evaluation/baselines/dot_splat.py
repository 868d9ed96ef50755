"""`.splat` files: 32 bytes per Gaussian, the input and output of splats4d.

    12 bytes  position, f32 scene units
    12 bytes  standard deviations, f32 scene units (linear)
     4 bytes  red, green, blue, alpha, u8 of 0 .. 1
     4 bytes  quaternion w, x, y, z, u8: (b - 128) / 128 of unit length

What it loses by itself: SH above degree 0 (there is no place for them), colours outside 0 .. 1, 8-bit colour
and alpha (alpha 0 and 1 come back as the ends of ALPHA_RANGE), and rotations up to about half a degree.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from dfcgs_codec.array_types import Float32, Float64
from dfcgs_codec.gaussians import GaussianCloud
from evaluation.baselines.colour import alpha_of, logit_of, rgb_of, sh_dc_of

_ROW = np.dtype([("position", "<f4", 3), ("scale", "<f4", 3), ("rgba", "u1", 4), ("rotation", "u1", 4)])


def unit_rotations(rotations: Float32, before: Float64 | None) -> Float64:
    """Quaternions (N, 4) of unit length, of the sign that differs less from `before`.

    Without a frame before, the largest component is negative: bytes reach -1 but not 1.
    """
    unit = rotations.astype(np.float64)
    unit /= np.linalg.norm(unit, axis=1, keepdims=True)
    if before is None or len(before) != len(unit):
        leading = unit[np.arange(len(unit)), np.abs(unit).argmax(axis=1)]
        return np.where((leading > 0)[:, None], -unit, unit)
    return np.where(((unit * before).sum(axis=1) < 0)[:, None], -unit, unit)


def write_splat(path: Path, cloud: GaussianCloud, rotations: Float64) -> None:
    """Write a cloud of SH degree 0 with its `rotations` (N, 4) of unit length."""
    rows = np.empty(cloud.num_gaussians, _ROW)
    rows["position"], rows["scale"] = cloud.positions, np.exp(cloud.scales)
    rows["rgba"][:, :3] = np.rint(255.0 * rgb_of(cloud.sh_dc))
    rows["rgba"][:, 3] = np.rint(255.0 * alpha_of(cloud.opacities))
    rows["rotation"] = np.clip(np.rint(128.0 * rotations) + 128.0, 0, 255)
    path.write_bytes(rows.tobytes())


def read_splat(path: Path) -> GaussianCloud:
    """The Gaussians of a file; rotations are not normalised again."""
    rows = np.frombuffer(path.read_bytes(), _ROW)
    rgba = rows["rgba"].astype(np.float64) / 255.0
    return GaussianCloud(
        positions=rows["position"].astype(np.float32),
        rotations=((rows["rotation"].astype(np.float32) - 128.0) / 128.0).astype(np.float32),
        scales=np.log(np.maximum(rows["scale"], np.finfo(np.float32).tiny)),
        opacities=logit_of(rgba[:, 3]),
        sh_dc=sh_dc_of(rgba[:, :3]),
        sh_rest=np.zeros((len(rows), 3, 0), np.float32),
    )

"""Colour of sampled surfaces: base textures, baked light and view-dependent SH.

Colours are display (sRGB) values, as in a 3DGS PLY; SH follow the sign convention of INRIA's renderer, where
a direction points from the camera to the Gaussian.
"""

from __future__ import annotations

import numpy as np

from dfcgs_codec.array_types import Float64, Int64, UInt8
from dfcgs_codec.encoder.images.splats import harmonics
from dfcgs_codec.gaussians import SH_REST_COEFFICIENTS
from lab.meshes.asset import Primitive

#: SH basis function of degree 0: colour = 0.5 + SH_C0 * f_dc
SH_C0 = 0.28209479177387814
#: direction towards the baked light; glTF's y axis points up
LIGHT = np.array([0.4, 0.8, 0.45]) / np.linalg.norm([0.4, 0.8, 0.45])
#: width of the highlight: SH degree l is damped by exp(-l (l + 1) / (2 SHARPNESS))
SHARPNESS = 6.0
#: f_rest of degrees 1 and 2 then has a standard deviation of 0.12 and 0.08 and a correlation between channels
#: of 0.85; measured on the trained splats playbot and sushi: 0.08-0.26, 0.06-0.15 and 0.5-0.9
HIGHLIGHT = 0.35
CHANNEL_NOISE = 0.04


def to_srgb(linear: Float64) -> Float64:
    """Linear light 0..1 -> display value (IEC 61966-2-1)."""
    clipped = np.clip(linear, 0.0, 1.0)
    return np.where(clipped <= 0.0031308, 12.92 * clipped, 1.055 * clipped ** (1.0 / 2.4) - 0.055)


def to_linear(srgb: Float64) -> Float64:
    """Display value 0..1 -> linear light."""
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)


def sample_texture(texture: UInt8, uv: Float64) -> Float64:
    """Bilinear, repeating lookup: (H, W, 4) and (N, 2) -> (N, 4), colour linear, alpha as it is."""
    height, width = texture.shape[:2]
    place = uv * (width, height) - 0.5
    corner = np.floor(place).astype(np.int64)
    fraction = place - corner
    total = np.zeros((len(uv), 4))
    for dx in (0, 1):
        for dy in (0, 1):
            texel = texture[(corner[:, 1] + dy) % height, (corner[:, 0] + dx) % width] / 255.0
            texel[:, :3] = to_linear(texel[:, :3])
            weight = np.abs(1 - dx - fraction[:, 0]) * np.abs(1 - dy - fraction[:, 1])
            total += weight[:, None] * texel
    return total


def primitive_colors(primitive: Primitive, faces: Int64, barycentric: Float64) -> Float64:
    """(N, 4) linear RGBA at points of one primitive: `faces` (N,) are its own, `barycentric` (N, 3)."""
    corners = primitive.faces[faces]
    rgba = np.einsum("nc,ncd->nd", barycentric, primitive.colors[corners]) * primitive.material.factor
    if primitive.material.texture is not None and primitive.uv is not None:
        uv = np.einsum("nc,ncd->nd", barycentric, primitive.uv[corners])
        rgba = rgba * sample_texture(primitive.material.texture, uv)
    if not primitive.material.uses_alpha:
        rgba[:, 3] = 1.0
    return rgba


def sh_dc(linear_rgb: Float64, normals: Float64) -> Float64:
    """(N, 3) f_dc of a surface under a soft directional light baked into its colour."""
    shade = 0.7 + 0.3 * (normals @ LIGHT)
    return (to_srgb(linear_rgb) * shade[:, None] - 0.5) / SH_C0


def sh_basis(directions: Float64) -> Float64:
    """(N, 3) unit vectors -> (N, 15) basis functions of degrees 1 to 3, in the order of f_rest."""
    return harmonics(directions, 16)[:, 1:]


def sh_rest(normals: Float64, sh_degree: int, rng: np.random.Generator) -> Float64:
    """(N, 3, K) f_rest: a highlight of varying strength around the mirrored light, and noise."""
    count = SH_REST_COEFFICIENTS[sh_degree]
    degrees = np.repeat([1, 2, 3], [3, 5, 7])[:count]
    damping = np.exp(-degrees * (degrees + 1) / (2.0 * SHARPNESS))
    mirrored = 2.0 * (normals @ LIGHT)[:, None] * normals - LIGHT
    lobe = sh_basis(-mirrored)[:, :count] * damping
    strength = HIGHLIGHT * rng.lognormal(0.0, 0.5, (len(normals), 1, 1))
    tint = 1.0 + 0.1 * rng.standard_normal((len(normals), 3, 1))
    noise = rng.standard_normal((len(normals), 3, count)) * (CHANNEL_NOISE * damping)
    return strength * (tint * lobe[:, None, :] + noise / HIGHLIGHT)

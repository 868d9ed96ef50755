"""Colour and alpha of formats that store them as seen, from and to the SH coefficient and the logit."""

from __future__ import annotations

import numpy as np

from dfcgs_codec.array_types import Float32, Float64
from dfcgs_codec.encoder.plan.quantiser_steps import SH_C0
from evaluation.baselines.spz import ALPHA_RANGE


def rgb_of(sh_dc: Float32) -> Float64:
    """RGB (N, 3), clipped to 0 .. 1, of SH degree 0 coefficients."""
    rgb: Float64 = np.clip(0.5 + SH_C0 * sh_dc.astype(np.float64), 0.0, 1.0)
    return rgb


def sh_dc_of(rgb: Float64) -> Float32:
    """Inverse of `rgb_of` inside its range."""
    return ((rgb - 0.5) / SH_C0).astype(np.float32)


def alpha_of(opacities: Float32) -> Float64:
    """alpha (N,) of logits."""
    alpha: Float64 = 1.0 / (1.0 + np.exp(-np.clip(opacities.astype(np.float64), -60.0, 60.0)))
    return alpha


def logit_of(alpha: Float64) -> Float32:
    """Logits (N,) of alpha, which is kept inside ALPHA_RANGE: those of 0 and 1 are infinite."""
    inside = np.clip(alpha, *ALPHA_RANGE)
    return np.log(inside / (1.0 - inside)).astype(np.float32)

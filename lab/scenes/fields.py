"""Smooth random functions of space and time, and the size of a scene."""

from __future__ import annotations

import numpy as np

from dfcgs_codec.array_types import Float64, Floats
from dfcgs_codec.gaussians import GaussianCloud

#: random Fourier features per field: enough for a sum that looks Gaussian, few enough to be fast
NUM_WAVES = 12


def scene_size(positions: Floats) -> float:
    """Longest side of the box around the central 98 %: far outliers do not count. 1 for a single place."""
    low, high = np.percentile(positions, [1.0, 99.0], axis=0)
    size = float(np.max(high - low))
    return size if size > 0.0 else 1.0


class SmoothField:
    """C random functions, smooth in space and time; mean 0 and variance 1 over all fields.

    A sum of plane waves with random directions and phases (random Fourier features; Rahimi and Recht, 2007).
    """

    def __init__(
        self, rng: np.random.Generator, channels: int, wavelength: float, *, period: float = np.inf
    ) -> None:
        """`wavelength` in scene units and `period` in the caller's unit of time are typical values."""
        self.waves = rng.standard_normal((3, NUM_WAVES)) * (2.0 * np.pi / wavelength / np.sqrt(3.0))
        self.rates = rng.uniform(-2.0, 2.0, NUM_WAVES) * (2.0 * np.pi / period)
        self.phases = rng.uniform(0.0, 2.0 * np.pi, NUM_WAVES)
        self.amplitudes = rng.standard_normal((NUM_WAVES, channels)) * np.sqrt(2.0 / NUM_WAVES)

    def __call__(self, positions: Floats, time: float = 0.0) -> Float64:
        """(N, 3) positions -> (N, C)."""
        # einsum, not @: threads of a BLAS that other processes disturb make thin products ten times slower
        phases = np.einsum("nd,dw->nw", np.asarray(positions, np.float64), self.waves)
        phases += self.phases + self.rates * time
        return np.einsum("nw,wc->nc", np.cos(phases), self.amplitudes)


def field_for(
    cloud: GaussianCloud,
    rng: np.random.Generator,
    channels: int,
    *,
    wavelength: float,
    period: float = np.inf,
) -> SmoothField:
    """A SmoothField whose `wavelength` is given as a share of the scene's size."""
    return SmoothField(rng, channels, wavelength * scene_size(cloud.positions), period=period)
